"""A day's worth of flight on virtual time, and whether anything grows meanwhile.

``python tests/bench/soak.py [--hours 6] [--loss 0.05] [--seed 1]`` prints a table: resident memory and the
size of every table that the service keeps, after a warm-up and at the end.

One service runs all the time. Its mission never ends, because arrivals are not counted: agents that reach
a moving target circle there until they get the next route. Meanwhile agents are lost and replaced a while
later, others reboot in the air, targets vanish and appear, datagrams are lost each way, an operator holds and
resumes vehicles and closes and opens an area, and a recorder and a journal write.
"""

import argparse
import gc
import math
import sys
import tempfile
import time
from collections import Counter, deque
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import psutil
from rich.console import Console
from rich.table import Table

from gcs.config import read_text
from gcs.config.key_overrides import override_keys
from gcs.core.engine import Engine
from gcs.core.perception import arrival_and_loss
from gcs.io.recording.folder import Run, versions
from gcs.io.recording.recorder import DiskBudget, Recorder
from gcs.model import NS_PER_S, AgentStatus, NoFlyZone, Order, Plan, UploadReport
from gcs.planning.warm_up import warm_up as warm_up_planning
from gcs.service.journal import Journal, fingerprint
from gcs.tracking.glmb.filter import warm_up as warm_up_tracking
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import parse_scenario
from sim_vehicles.world.targets import Target

SETTINGS = (
    "simulation.death.survival_probability=0.9992",
    "recording.rotate_mb=1",
)
WARM_UP_S = 1800.0
STEP_S = 20.0
GONE_S = (20.0, 120.0)
MOST_GONE = 2  # when no vehicle flies any more, the mission ends
REBOOTS_PER_H, TARGETS_PER_H, ORDERS_PER_H = 6.0, 20.0, 30.0
LEAF = (
    str,
    bytes,
    bytearray,
    int,
    float,
    complex,
    type(None),
    np.ndarray,
    np.generic,
    np.random.Generator,
    type,
)


def tables(root: object, name: str) -> dict[str, int]:
    """Lengths of all containers below an object, by the path to them; those in rows of a table are summed."""
    sizes: Counter[str] = Counter()
    seen: set[int] = set()
    todo = deque([(root, name)])  # breadth first: the shortest path to each
    while todo:
        value, path = todo.popleft()
        if isinstance(value, LEAF) or callable(value) or id(value) in seen:
            continue
        seen.add(id(value))
        if isinstance(value, dict):
            sizes[path] += len(value)
            todo += [(row, f"{path}[]") for row in value.values()]
        elif isinstance(value, list | tuple | set | frozenset | deque):
            if not isinstance(value, tuple):
                sizes[path] += len(value)
            todo += [(row, f"{path}[]") for row in value]
        else:
            todo += [(part, f"{path}.{key}") for key, part in parts(value)]
    return dict(sizes)


def parts(value: object) -> list[tuple[str, object]]:
    names = [key for kind in type(value).__mro__ for key in getattr(kind, "__slots__", ())]
    found = {key: getattr(value, key) for key in names if hasattr(value, key)}
    found |= getattr(value, "__dict__", {})
    if is_dataclass(value):
        found |= {f.name: getattr(value, f.name) for f in fields(value) if hasattr(value, f.name)}
    return [(key.lstrip("_"), part) for key, part in found.items()]


@dataclass
class Soak:
    """An endless run, and what happens to it."""

    seed: int
    loss: float
    folder: Path
    loads: tuple[str, ...] = SETTINGS
    keeps_recording: bool = False
    counts: Counter[str] = field(default_factory=Counter)
    _gone_until: dict[str, float] = field(default_factory=dict)
    _held: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        text = override_keys(read_text("random-targets")[0], self.loads, "soak")
        self.scenario = parse_scenario(text, "soak")
        self._rng = np.random.default_rng(self.seed)
        self.recorder = Recorder(self.folder, text, versions(), Run("soak", self.seed), DiskBudget(1_000_000))
        self.journal = Journal(self.folder / "journal", "soak", fingerprint(text, self.seed))
        self.run = VirtualRun(
            self.scenario,
            self.seed,
            self.recorder.record_event,
            self._effect,
            loss=self.loss,
            on_snapshot=self.recorder.record_snapshot,
        )

    @property
    def command(self) -> Engine:
        return self.run.engine

    def _effect(self, t_ns: int, effect: object) -> None:
        self.recorder.record_effect(t_ns, effect)
        if isinstance(effect, Plan):
            self.counts["plans"] += 1
        elif isinstance(effect, UploadReport):
            self.counts["missions that arrived" if effect.ok else "missions that did not"] += 1
        elif isinstance(effect, AgentStatus):
            self.counts[f"seen {effect.status}"] += 1

    def fly(self, to_s: float) -> None:
        """Fly on, with everything that happens on the way."""
        while self.now_s < to_s:
            self.run.run(min(self.now_s + STEP_S, to_s))
            if self.run.ended:
                statuses = {v: one.perception.status.status for v, one in self.engine.state.agents.items()}
                raise SystemExit(f"the mission ended after {self.now_s:.0f} s: {statuses}")
            self._replace_lost()
            for per_h, happens in (
                (REBOOTS_PER_H, self._reboot),
                (TARGETS_PER_H, self._another_target),
                (ORDERS_PER_H, self._order),
            ):
                if self._rng.random() < per_h * STEP_S / 3600.0:
                    happens()
            self.journal.write(self.run.snapshot())
            self.recorder.flush()
            # The harness itself must not grow: old parts of the recording go, times are not kept.
            old = sorted(self.folder.glob("*.mcap"))[:-2] + sorted(self.folder.glob("*.tlog"))[:-2]
            for part in () if self.keeps_recording else old:
                part.unlink()
            self.run.timings.scan_ms.clear()
            self.run.timings.plan_ms.clear()

    @property
    def now_s(self) -> float:
        return (self.run.t_ns - START_T_NS) / NS_PER_S

    def _replace_lost(self) -> None:
        for peer, vehicle in self.run.vehicles.items():
            if vehicle.alive:
                continue
            if peer not in self._gone_until:
                self.counts["deaths"] += 1
                self._gone_until[peer] = self.now_s + self._rng.uniform(*GONE_S)
            elif self.now_s >= self._gone_until[peer] or len(self._gone_until) > MOST_GONE:
                del self._gone_until[peer]
                self._start(peer, vehicle, vehicle.spec.east_m, vehicle.spec.north_m)

    def _reboot(self) -> None:
        alive = [(peer, vehicle) for peer, vehicle in self.run.vehicles.items() if vehicle.alive]
        peer, vehicle = alive[self._rng.integers(len(alive))]
        self.counts["reboots in the air"] += 1
        self._start(peer, vehicle, vehicle.east_m, vehicle.north_m)

    def _start(self, peer: str, vehicle: SimVehicle, east_m: float, north_m: float) -> None:
        seed = int(self._rng.integers(2**31))
        spec = replace(vehicle.spec, east_m=east_m, north_m=north_m, seed=seed)
        self.run.vehicles[peer] = SimVehicle(spec, self.scenario.frame, self.run.t_ns)

    def _another_target(self) -> None:
        targets = self.run._world.targets
        births = self.scenario.config.births
        birth = births[self._rng.integers(len(births))]
        east_m, north_m = self._rng.normal((birth.east_m, birth.north_m), birth.std_m)
        v_east_m_s, v_north_m_s = self._rng.normal(0.0, 2.0, 2)
        self.counts["other targets"] += 1
        number = max(target.id for target in targets) + 1
        targets[self._rng.integers(len(targets))] = Target(
            number, float(east_m), float(north_m), float(v_east_m_s), float(v_north_m_s), self.now_s
        )

    def _order(self) -> None:
        self.counts["orders"] += 1
        number = f"order-{self.counts['orders']}"
        if self._rng.random() < 0.3:
            disc = (
                (*self._rng.uniform(600.0, 1400.0, 2).tolist(), 80.0) if self.counts["orders"] % 2 else None
            )
            order = Order(self.run.t_ns, number, "no-fly-zone", None, no_fly_zone=NoFlyZone("fire", disc))
        elif self._held:
            order = Order(self.run.t_ns, number, "resume", (self._held.pop(),))
        else:
            vehicle = int(self._rng.integers(1, 5))
            self._held.append(vehicle)
            order = Order(self.run.t_ns, number, "hold", (vehicle,))
        self.run.order(order)

    def sizes(self) -> dict[str, int]:
        whole = {"engine": self.engine, "recorder": self.recorder, "vehicles": self.run.vehicles}
        return {path: size for name, part in whole.items() for path, size in tables(part, name).items()}

    def close(self) -> None:
        self.recorder.close()


def rss_mb() -> float:
    gc.collect()
    return psutil.Process().memory_info().rss / 1e6


def soak(hours: float, loss: float, seed: int, warm_up_s: float = WARM_UP_S, samples: int = 12):
    """Fly; return the rows (hour, memory, rows in all tables), the sizes after the warm-up and at the end."""
    warm_up_tracking()
    warm_up_planning()
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.object(arrival_and_loss, "ARRIVAL_EPOCHS", math.inf),
    ):
        run = Soak(seed, loss, Path(folder))
        run.fly(warm_up_s)
        before, peak = run.sizes(), Counter(run.sizes())
        rows = [(run.now_s / 3600.0, rss_mb(), sum(before.values()))]
        for n in range(1, samples + 1):
            run.fly(warm_up_s + (hours * 3600.0 - warm_up_s) * n / samples)
            now = run.sizes()
            peak |= Counter(now)
            rows.append((run.now_s / 3600.0, rss_mb(), sum(now.values())))
            print(f"{rows[-1][0]:6.2f} h  {rows[-1][1]:7.1f} MB  {rows[-1][2]:6d} rows", file=sys.stderr)
        run.close()
        return rows, before, run.sizes(), peak, run.counts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=6.0)
    parser.add_argument("--loss", type=float, default=0.05)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    began_s = time.process_time()
    rows, before, after, peak, counts = soak(options.hours, options.loss, options.seed)
    cpu_s = time.process_time() - began_s
    console = Console(width=110)
    memory = Table("hours flown", "resident MB", "rows in all tables", title="soak", title_justify="left")
    for hour, mb, size in rows:
        memory.add_row(f"{hour:.1f}", f"{mb:.1f}", str(size))
    console.print(memory)
    sizes = Table("table", "after warm-up", "peak", "at the end", title="tables with ten rows and more")
    for path in sorted(after):
        if max(before.get(path, 0), after[path], peak[path]) >= 10:
            sizes.add_row(path, str(before.get(path, 0)), str(peak[path]), str(after[path]))
    console.print(sizes)
    console.print(", ".join(f"{count} {name}" for name, count in sorted(counts.items())))
    console.print(f"{options.hours * 3600.0 / cpu_s:.0f} times real time ({cpu_s:.0f} s of CPU)")


if __name__ == "__main__":
    main()
