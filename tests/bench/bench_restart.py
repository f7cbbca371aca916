"""Kill central command at random times, restart it, and compare with the same flight without a restart.

``python tests/bench/bench_restart.py [--runs 200] [--outage 2] [--loss 0.2]`` flies missions of the paper on
virtual time. Each difference is printed with its run.

The restarted service continues from what the journal has then. Some seconds later labels of confirmed
targets, agent statuses, targets of routes and authorities are compared with those of the uninterrupted
flight. Uploads of missions that the vehicle stores already are counted. With loss, other datagrams are lost
after the restart than in the uninterrupted flight.
"""

import argparse
import itertools
from types import SimpleNamespace

import numpy as np
from helpers.chaos_checks import operational_picture
from rich.console import Console
from rich.table import Table

from gcs.core.snapshot import encode_state
from gcs.mavlink.frames.codec import decode
from gcs.model import Effect, Event, Send, Snapshot, UploadReport
from gcs.planning.warm_up import warm_up as warm_up_planning
from gcs.service.journal import JournalSink
from gcs.tracking.glmb.filter import warm_up as warm_up_tracking
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import Scenario, load

SCENARIOS = ("prescribed", "random-obstacles", "random-targets", "radars")


class MemoryJournal(JournalSink):
    """The journal of a flight on virtual time, in memory."""

    def __init__(self, run: VirtualRun) -> None:
        super().__init__(SimpleNamespace(engine=run.engine), None)
        self.snapshot: Snapshot | None = None

    def write(self, t_ns: int) -> None:
        """Keep the state."""
        self._written_t_ns, self._is_changed = t_ns, False
        self.snapshot = Snapshot(t_ns, encode_state(self._engine.state))


def fly(scenario: Scenario, seed: int, loss: float, at_s: float, outage_s: float | None, end_s: float):
    """Fly to `end_s`; return the run, and the uploads from `at_s` on of a mission that was stored already."""
    stored: dict[int, tuple] = {}
    uploaded: set[int] = set()
    repeated = 0

    def mission(vehicle: int) -> tuple:
        return tuple(run.vehicles[f"vehicle:{vehicle}"].autopilot.mission)

    def on_event(event: Event) -> None:
        if not stored:
            journal.event(event)

    def on_effect(t_ns: int, effect: Effect) -> None:
        nonlocal repeated
        if not stored:
            journal.effect(t_ns, effect)
        elif isinstance(effect, Send):
            items = [m for m in decode(effect.data)[0] if m.get_type() == "MISSION_ITEM_INT"]
            uploaded.update(item.target_system for item in items)
        elif isinstance(effect, UploadReport) and effect.ok:
            repeated += effect.vehicle in uploaded and stored[effect.vehicle] == mission(effect.vehicle)
            stored[effect.vehicle] = mission(effect.vehicle)
            uploaded.discard(effect.vehicle)

    run = VirtualRun(scenario, seed, on_event, on_effect, loss=loss)
    journal = MemoryJournal(run)
    run.run(at_s)
    stored |= {vehicle: mission(vehicle) for vehicle in run.engine.state.agents}
    if outage_s is not None and not run.ended:
        run.restart(outage_s, journal.snapshot)
    run.run(end_s)
    return run, repeated


def compare(runs: int, outage_s: float, settle_s: float, loss: float, seed: int = 1):
    """Return the equal pictures by part, the flights compared, repeated uploads, and their number without."""
    rng = np.random.default_rng(seed)
    scenarios = {name: load(name) for name in SCENARIOS}
    equal: dict[str, int] = {}
    compared = repeated = without = 0
    for n, name in zip(range(runs), itertools.cycle(SCENARIOS)):
        at_s = float(rng.uniform(8.0, 110.0))
        end_s = at_s + outage_s + settle_s
        whole, before = fly(scenarios[name], 1 + n // 4, loss, at_s, None, end_s)
        broken, after = fly(scenarios[name], 1 + n // 4, loss, at_s, outage_s, end_s)
        if whole.ended or broken.ended:
            continue
        compared, repeated, without = compared + 1, repeated + after, without + before
        expected, found = operational_picture(whole.engine), operational_picture(broken.engine)
        if after > before:
            print(f"{name}, seed {1 + n // 4}, at {at_s:.2f} s: {after} uploads of a stored mission")
        for part, value in expected.items():
            equal[part] = equal.get(part, 0) + (found[part] == value)
            if found[part] != value:
                print(f"{name}, seed {1 + n // 4}, at {at_s:.2f} s: {part} {value}, restarted {found[part]}")
    return equal, compared, repeated, without


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--outage", type=float, default=2.0, help="seconds without central command")
    parser.add_argument("--loss", type=float, default=0.0, help="probability that a datagram is lost")
    parser.add_argument("--settle", type=float, default=6.0, help="seconds until the comparison")
    options = parser.parse_args()
    warm_up_tracking()
    warm_up_planning()
    equal, compared, repeated, without = compare(options.runs, options.outage, options.settle, options.loss)
    table = Table("part", "equal", title=f"{compared} restarts after {options.outage:g} s")
    for part, count in equal.items():
        table.add_row(part, f"{count} ({100.0 * count / max(1, compared):.1f} %)")
    Console(width=100).print(table)
    print(f"uploads of a mission that the vehicle stored already: {repeated} ({without} without restarts)")


if __name__ == "__main__":
    main()
