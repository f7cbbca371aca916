"""Two bridges with 200 vehicles each at 10 Hz and four sensors, into one command: losses and times by stage.

``python tests/bench/bench_two_bridges.py [--vehicles 200] [--hz 10] [--targets 380] [--deaths 8]`` starts
`gcs run --role bridge` twice and `gcs run`. This process plays the vehicles, each at a socket of its own:
scripted ArduPlanes (`helpers.plane_double`) that fly straight to their waypoints, with GLOBAL_POSITION_INT at
the rate given. Four sensors of a quarter of the map each scan once a second, all agents and targets in it,
with 5 % of misses and five false detections. When missions are flown, vehicles die one after the other: they
are silent and no sensor sees them. Meanwhile an operator orders one to hold and to resume. Times are from the
scan to the pictures, and from a death to the loss, the plan, and the last upload of that plan. CPU is that of
each process in per cent of a core.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import selectors
import socket
import subprocess
import tempfile
import threading
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil
from helpers.plane_double import AUTO, Plane
from helpers.processes import GCS, free_port
from rich.console import Console
from rich.table import Table
from telemetry import with_crc

from gcs.errors import NoAnswerError
from gcs.geo import LocalFrame
from gcs.io.record_json import decode
from gcs.io.zenoh.discovery import ServiceAddress
from gcs.io.zenoh.key_expressions import scan_key
from gcs.io.zenoh.order_client import send_order
from gcs.io.zenoh.order_messages import OrderMessage
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import AgentStatus, OrderAnswer, Picture, Plan, UploadReport

NAME: Final = "two-bridges"
SIDE_M: Final = 12_000.0
SPEED_M_S: Final = 16.0
FRAME: Final = LocalFrame(33.2, -87.6, 70.0)
_REACHED_M: Final = 40.0
_SENSORS: Final = 4
_MISSED: Final = 0.05
_FALSE: Final = 5.0
_NOISE_M: Final = 2.0
_POSITION: Final = 33
_EXTRA_CRC: Final = 104
_START_S: Final = 300.0
_NO_MORE_S: Final = 30.0
"""Time without another vehicle in a mission after which it goes on."""
_KINDS: Final = {"plan": Plan, "upload": UploadReport, "agent_status": AgentStatus, "answer": OrderAnswer}


def grid(count: int, west_m: float, east_m: float) -> np.ndarray:
    """Return places between two meridians of the map, (count, 2)."""
    rows = int(np.ceil(np.sqrt(count * (SIDE_M - 400.0) / (east_m - west_m))))
    columns = -(-count // rows)
    north_m, places_m = np.meshgrid(
        np.linspace(200.0, SIDE_M - 200.0, rows), np.linspace(west_m, east_m, columns)
    )
    return np.column_stack((places_m.ravel(), north_m.ravel()))[:count]


def mission(vehicles: int, hz: float, ports: tuple[int, int], zenoh: str, bridges: tuple[str, str]) -> str:
    """Return the mission file."""
    starts_m = grid(2 * vehicles, 200.0, 4000.0)
    text = f"""
name = "{NAME}"
[frame]
lat_deg = {FRAME.lat_deg}
lon_deg = {FRAME.lon_deg}
alt_msl_m = {FRAME.alt_msl_m}
[map]
width_m = {SIDE_M}
height_m = {SIDE_M}
nodes_east = 151
nodes_north = 151
[tracking.targets]
accel_psd_m2_s3 = 0.25
[tracking.targets.anywhere]
per_s = 0.1
[telemetry]
rate_hz = {hz}
[airframe]
speed_m_s = {SPEED_M_S}
[planning]
clearance_m = 20.0
shape = "flyable"
switch_gain_m = 50.0
[links]
zenoh = "{zenoh}"
mavlink = [
    {{ endpoint = "udpin:127.0.0.1:{ports[0]}", bridge = "hill" }},
    {{ endpoint = "udpin:127.0.0.1:{ports[1]}", bridge = "mast", network = 1 }},
]
[[links.bridges]]
name = "hill"
zenoh = "{bridges[0]}"
[[links.bridges]]
name = "mast"
zenoh = "{bridges[1]}"
"""
    for number, (east_m, north_m) in enumerate(starts_m):
        network, system = divmod(number, vehicles)
        text += f"[[agents]]\nsystem_id = {system + 1}\nnetwork = {network}\n"
        text += f"east_m = {east_m}\nnorth_m = {north_m}\ncourse_deg = 90.0\n"
    return text


class Vehicles:
    """All vehicles, on a thread."""

    def __init__(self, vehicles: int, hz: float, ports: tuple[int, int]) -> None:
        self.place_m = grid(2 * vehicles, 200.0, 4000.0)
        count = len(self.place_m)
        self.is_alive = np.ones(count, bool)
        self.sent = 0
        self.late_s = 0.0
        """Longest delay of a round of reports."""
        self.course = np.full((count, 2), (1.0, 0.0))
        self.ids = [256 * (n // vehicles) + n % vehicles + 1 for n in range(count)]
        self._hz = hz
        self._ends = threading.Event()
        self._planes = []
        self._links = []
        self._selector = selectors.DefaultSelector()
        lat_deg, lon_deg = FRAME.to_geodetic(0.0, 0.0)
        north_deg, _ = FRAME.to_geodetic(0.0, SIDE_M)
        _, east_deg = FRAME.to_geodetic(SIDE_M, 0.0)
        self._origin = np.array([lat_deg, lon_deg])
        self._scale = np.array([(north_deg - lat_deg) / SIDE_M, (east_deg - lon_deg) / SIDE_M])
        for number in range(count):
            home = (*map(int, self._degrees(self.place_m[number]) * 1e7), FRAME.alt_msl_m)
            self._planes.append(Plane(number % vehicles + 1, home=home))
            link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            link.connect(("127.0.0.1", ports[number // vehicles]))
            link.setblocking(False)
            self._links.append(link)
            self._selector.register(link, selectors.EVENT_READ, number)
        self._goal_m = np.full((count, 2), np.nan)
        self._sequence = np.zeros(count, np.int64)
        self._systems = np.array([plane.system_id for plane in self._planes])
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _degrees(self, place_m: np.ndarray) -> np.ndarray:
        """Return latitude and longitude; the map is small enough for a plane."""
        return self._origin + place_m[..., ::-1] * self._scale

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        self._ends.set()
        self._thread.join(10.0)

    def flying(self) -> int:
        """Return the number of vehicles in a mission."""
        return sum(plane.mode == AUTO and len(plane.store) > 1 for plane in self._planes)

    def _run(self) -> None:
        period_s = 1.0 / self._hz
        began_s = due_s = time.monotonic()
        while not self._ends.is_set():
            now_s = time.monotonic()
            if now_s >= due_s:
                self.late_s = max(self.late_s, now_s - due_s)
                self._move(period_s)
                self._report(int((now_s - began_s) * 1e3) + 1000)
                due_s = max(due_s + period_s, now_s)
            for key, _ in self._selector.select(max(0.0, due_s - time.monotonic())):
                self._receive(key.data)

    def _receive(self, number: int) -> None:
        try:
            data = self._links[number].recv(65_536)
        except OSError:  # the bridge is not there yet
            return
        if self.is_alive[number]:
            for frame in self._planes[number].receive(data, time.monotonic_ns()):
                self._send(number, frame)

    def _send(self, number: int, frame: bytes) -> None:
        try:
            self._links[number].send(frame)
            self.sent += 1
        except OSError:
            pass

    def _move(self, period_s: float) -> None:
        """Fly on: straight to the waypoint, in a circle at the last one and before the first."""
        for number, plane in enumerate(self._planes):
            item = plane.cached if plane.mode == AUTO else None
            if item is None or not item.x:
                self._goal_m[number] = np.nan
                continue
            degrees = np.array([item.x, item.y]) * 1e-7
            self._goal_m[number] = ((degrees - self._origin) / self._scale)[::-1]
        away_m = self._goal_m - self.place_m
        distance_m = np.hypot(*away_m.T)
        near = np.nan_to_num(distance_m, nan=0.0) < _REACHED_M
        for number in np.flatnonzero(near & ~np.isnan(distance_m)):
            plane = self._planes[number]
            if plane.cached.command == 16 and plane.current + 1 < len(plane.store):
                plane._fly_to(plane.current + 1)
        turn = SPEED_M_S * period_s / 60.0
        turned = self.course @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        straight = away_m / np.maximum(distance_m, 1.0)[:, None]
        self.course = np.where(near[:, None], turned, straight)
        self.place_m += self.course * SPEED_M_S * period_s * self.is_alive[:, None]

    def _report(self, boot_ms: int) -> None:
        count = len(self._planes)
        frames = np.zeros((count, 40), np.uint8)
        frames[:, [0, 1, 6, 7]] = (0xFD, 28, 1, _POSITION)
        self._sequence += 1
        frames[:, 4] = self._sequence % 256
        frames[:, 5] = self._systems
        fields = np.zeros((count, 7), "<i4")
        fields[:, 0] = boot_ms
        fields[:, 1:3] = self._degrees(self.place_m) * 1e7
        fields[:, 3] = int((FRAME.alt_msl_m + 100.0) * 1e3)
        fields[:, 4] = 100_000
        velocity = np.zeros((count, 4), "<i2")
        velocity[:, :2] = self.course[:, ::-1] * SPEED_M_S * 100.0
        heading = np.degrees(np.arctan2(self.course[:, 0], self.course[:, 1])) % 360.0
        velocity[:, 3] = (heading * 100.0).astype(np.uint16).view(np.int16)
        fields[:, 5:] = velocity.view("<i4")
        frames[:, 10:38] = fields.view(np.uint8)
        frames = with_crc(frames, _EXTRA_CRC)
        t_ns = time.monotonic_ns()
        for number in np.flatnonzero(self.is_alive):
            self._send(number, frames[number].tobytes())
            for frame in self._planes[number].poll(t_ns):
                self._send(number, frame)


@dataclass
class Seen:
    """What command published, with the times at which it came."""

    pictures: dict[tuple[str, int], float] = field(default_factory=dict)
    effects: list[tuple[float, Any]] = field(default_factory=list)

    def take(self, key: str, payload: bytes) -> None:
        now_s = time.monotonic()
        what = key.split("/", 2)[2]
        if what.startswith("picture"):
            picture = decode(key, payload, Picture)
            self.pictures.setdefault((picture.kind, picture.scan_t_ns), now_s)
        elif what in _KINDS:
            self.effects.append((now_s, decode(key, payload, _KINDS[what])))

    def of(self, kind: type) -> list[tuple[float, Any]]:
        return [(at_s, one) for at_s, one in self.effects if isinstance(one, kind)]


class Sensors:
    """Four sensors on a thread, each of a quarter of the map."""

    def __init__(self, bus: ZenohSession, vehicles: Vehicles, targets_m: np.ndarray) -> None:
        self.sent: dict[int, float] = {}
        """Monotonic times of sending, by time of the scan."""
        self._bus = bus
        self._vehicles = vehicles
        self._targets_m = targets_m
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        rng = np.random.default_rng(1)
        due_s = time.monotonic()
        number = 0
        while not self._ends.wait(max(0.0, due_s - time.monotonic())):
            self._scan(number % _SENSORS, rng)
            number += 1
            due_s += 1.0 / _SENSORS

    def _scan(self, number: int, rng: np.random.Generator) -> None:
        half_m = SIDE_M / 2.0
        low_m = np.array([number % 2, number // 2]) * half_m - 1000.0 * np.array(
            [number % 2 == 0, number // 2 == 0]
        )
        high_m = low_m + half_m + 1000.0
        vehicles = self._vehicles
        objects_m = np.vstack((vehicles.place_m[vehicles.is_alive], self._targets_m))
        inside = ((objects_m > low_m) & (objects_m < high_m)).all(1) & (rng.random(len(objects_m)) > _MISSED)
        z_m = objects_m[inside] + rng.normal(0.0, _NOISE_M, (int(inside.sum()), 2))
        z_m = np.vstack((z_m, rng.uniform(low_m, high_m, (rng.poisson(_FALSE), 2))))
        z_m = z_m[((z_m > low_m) & (z_m < high_m)).all(1)]
        t_ns = time.time_ns()
        name = f"radar-{number}"
        scan = {
            "sensor": {
                "name": name,
                "detection_probability": 1.0 - _MISSED,
                "clutter_density_per_m2": _FALSE / float(np.prod(high_m - low_m)),
                "noise_cov_m2": [[_NOISE_M**2, 0.0], [0.0, _NOISE_M**2]],
                "field_of_view_m": [*low_m.tolist(), *high_m.tolist()],
            },
            "origin": {"lat_deg": FRAME.lat_deg, "lon_deg": FRAME.lon_deg},
            "measured_t_ns": t_ns,
            "z_m": z_m.tolist(),
        }
        payload = json.dumps(scan).encode()
        self.sent[t_ns] = time.monotonic()
        self._bus.publish(scan_key(NAME, name), payload)

    def end(self) -> None:
        self._ends.set()
        self._thread.join(5.0)


class Bench:
    """All processes of a run."""

    def __init__(self, folder: Path, options: argparse.Namespace) -> None:
        self._folder = folder
        self._options = options
        self._ports = (free_port(), free_port())
        self._zenoh = free_endpoint()
        ends = (free_endpoint(), free_endpoint())
        self._file = folder / "mission.toml"
        self._file.write_text(mission(options.vehicles, options.hz, self._ports, self._zenoh, ends))
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self.seen = Seen()
        self.deaths: list[tuple[float, int]] = []
        self.orders: list[str] = []
        """Actions with their last answers."""
        """Given, and carried out."""
        self.cpu: dict[str, float] = {}
        self.measured_s = (0.0, 0.0)

    def _serve(self, name: str, *arguments: str) -> None:
        command = [*GCS, "run", str(self._file), "--headless", "--out", str(self._folder / name)]
        command += ["--journal", str(self._folder / "journal"), "--console", "off", *arguments]
        with (self._folder / f"{name}.log").open("wb") as log:
            environment = {**os.environ, "XDG_RUNTIME_DIR": str(self._folder)}
            self._running[name] = subprocess.Popen(command, stdout=log, stderr=log, env=environment)

    def run(self) -> tuple[Vehicles, Sensors]:
        """Fly."""
        options = self._options
        vehicles = Vehicles(options.vehicles, options.hz, self._ports)
        targets_m = grid(options.targets, SIDE_M / 2.0 + 200.0, SIDE_M - 200.0)  # within the view of a sensor
        for name in ("hill", "mast"):
            self._serve(name, "--role", "bridge", "--bridge", name)
        self._serve("command")
        with ZenohSession(connect=self._zenoh) as bus:
            for what in ("picture/*", *_KINDS):
                bus.subscribe(f"swarm/{NAME}/{what}", self.seen.take)
            vehicles.start()
            sensors = Sensors(bus, vehicles, targets_m)
            self._wait_for_missions(vehicles)
            self._kill_vehicles(vehicles)
            sensors.end()
            time.sleep(3.0)
        vehicles.end()
        return vehicles, sensors

    def _wait_for_missions(self, vehicles: Vehicles) -> None:
        until_s = time.monotonic() + _START_S
        wanted = self._options.targets
        flying = 0
        more_s = time.monotonic()
        while flying < wanted and time.monotonic() < min(until_s, more_s + _NO_MORE_S):
            before = flying
            flying = vehicles.flying()
            if flying > before or flying == 0:
                more_s = time.monotonic()
            if (code := self._running["command"].poll()) is not None:
                raise SystemExit(
                    f"command ended ({code}): " + (self._folder / "command.log").read_text()[-1000:]
                )
            time.sleep(1.0)
        print(f"{flying} of {wanted} vehicles fly a mission", flush=True)
        time.sleep(10.0)

    def _kill_vehicles(self, vehicles: Vehicles) -> None:
        processes = {name: psutil.Process(one.pid) for name, one in self._running.items()}
        processes["vehicles and sensors"] = psutil.Process()
        before = {name: sum(one.cpu_times()[:2]) for name, one in processes.items()}
        begun_s = time.monotonic()
        orders = threading.Thread(target=self._order, args=(vehicles.ids[-1],), daemon=True)
        orders.start()
        rng = np.random.default_rng(2)
        for victim in rng.choice(len(vehicles.ids) - 1, self._options.deaths, replace=False):
            vehicles.is_alive[victim] = False
            self.deaths.append((time.monotonic(), vehicles.ids[victim]))
            time.sleep(self._options.every + float(rng.uniform(0.0, 1.0)))
        self.measured_s = (begun_s, time.monotonic())
        orders.join(60.0)
        passed_s = time.monotonic() - begun_s
        self.cpu = {
            name: 100.0 * (sum(one.cpu_times()[:2]) - before[name]) / passed_s
            for name, one in processes.items()
        }

    def _order(self, vehicle: int) -> None:
        """Let one vehicle hold and resume, for as long as others die."""
        address = ServiceAddress(NAME, self._zenoh, None)
        for number in range(int(self._options.deaths * self._options.every / 6.0)):
            action = ("hold", "resume")[number % 2]
            order = OrderMessage(
                order_id=f"order-{number}", action=action, vehicles=[vehicle], origin="bench"
            )
            last = "no answer"
            with contextlib.suppress(NoAnswerError):  # counted
                for answer in send_order(address, order, 5.0, 20.0):
                    last = f"{answer.state}: {answer.detail}"
            self.orders.append(f"{action} {last}")
            time.sleep(3.0)

    def end(self) -> None:
        for one in self._running.values():
            one.kill()
            one.wait()


def figures(bench: Bench, sensors: Sensors, vehicles: Vehicles) -> dict[str, Any]:
    """Return the times of each stage in seconds, and what was lost."""
    stages = defaultdict[str, list[float]](list)
    begun_s, ended_s = bench.measured_s
    sent = {t_ns: at_s for t_ns, at_s in sensors.sent.items() if begun_s <= at_s <= ended_s}
    lost = 0
    for t_ns, at_s in sent.items():
        for kind in ("agents", "targets"):
            shown_s = bench.seen.pictures.get((kind, t_ns))
            if shown_s is None:
                lost += 1
            else:
                stages[f"scan to picture of {kind}"].append(shown_s - at_s)
    plans = bench.seen.of(Plan)
    for died_s, vehicle in bench.deaths:
        gone = [at_s for at_s, one in bench.seen.of(AgentStatus)
                if one.vehicle == vehicle and one.status in ("lost", "down") and at_s > died_s]  # fmt: skip
        if not gone:
            stages["deaths not seen"].append(died_s)
            continue
        stages["death to loss"].append(gone[0] - died_s)
        after = [(at_s, plan) for at_s, plan in plans if at_s >= gone[0] - 0.01]
        if not after:
            continue
        plan_s, plan = after[0]
        stages["death to plan"].append(plan_s - died_s)
        uploads = [at_s for at_s, one in bench.seen.of(UploadReport)
                   if one.vehicle in plan.changed and one.ok and at_s >= plan_s]  # fmt: skip
        if plan.changed:
            stages["death to last upload"].append(max(uploads[: len(plan.changed)], default=np.nan) - died_s)
    return {
        "scans": len(sent),
        "pictures missing": lost,
        "orders": bench.orders,
        "datagrams sent": vehicles.sent,
        "reports late by s": round(vehicles.late_s, 2),
        "cpu": {name: round(value, 1) for name, value in bench.cpu.items()},
        "load": os.getloadavg()[0],
        "stages": {name: [round(one, 3) for one in values] for name, values in stages.items()},
    }


def table_of(found: dict[str, Any]) -> Table:
    """Return the quantiles of each stage."""
    title = ", ".join(f"{name} {value}" for name, value in found.items() if name != "stages")
    table = Table("stage, s", "number", "median", "99 %", "most", title=title)
    for name, values in found["stages"].items():
        table.add_row(name, str(len(values)), *(f"{np.nanquantile(values, q):.3f}" for q in (0.5, 0.99, 1.0)))
    return table


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicles", type=int, default=200, help="of each bridge")
    parser.add_argument("--hz", type=float, default=10.0)
    parser.add_argument("--targets", type=int, default=380)
    parser.add_argument("--deaths", type=int, default=8)
    parser.add_argument("--every", type=float, default=12.0, help="seconds between deaths")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--keep", type=Path, help="folder for logs and recordings")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="two-bridges-") as temporary:
        bench = Bench(options.keep or Path(temporary), options)
        try:
            vehicles, sensors = bench.run()
        finally:
            bench.end()
    found = figures(bench, sensors, vehicles)
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
    Console(width=120).print(table_of(found))


if __name__ == "__main__":
    main()
