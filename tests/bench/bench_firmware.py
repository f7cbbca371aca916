"""Whole missions flown by real firmware, over seeds, calm and in wind.

``python tests/bench/bench_firmware.py --sitl arduplane=PATH [SCENARIO ...] [--seeds 10] [--winds 0 6]`` flies
each mission with ``gcs demo --sitl`` and prints one row for each scenario and wind: missions complete;
survivors that arrived; the least distance of any vehicle from an obstacle before the end of its route, and
missions in which a vehicle was inside one; how far vehicles were from their lines in the first seconds after
a re-task in the air, by their own reports (NAV_CONTROLLER_OUTPUT, which PX4 does not send) and by their true
positions; and mission uploads. Without ``--sitl`` the same
missions are flown by the simulated vehicles.

``--faults`` flies the table of `bench_faults` instead: one flight for each kind, firmware and seed, with
a fault in the climb to the layer, one en route and one near the target, each of another vehicle.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import numpy as np
from bench_faults import KINDS, Job, Result, field_text, print_table, result_of
from fault_watch import FaultWatch
from helpers.flown_clearance import distance_to_obstacle_m

from gcs.config import parse, read_text
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.io.recording.reader import read
from gcs.mavlink.frames.codec import scan
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Datagram,
    FloatArray,
    MissionEnded,
    Notice,
    Order,
    Plan,
    Send,
    Truth,
    UploadReport,
)
from gcs.planning.map.grid import Grid

SCENARIOS = ("deterministic", "prescribed", "random-obstacles", "random-targets")
FIRST_LEG_NS = (1.0 * NS_PER_S, 3.0 * NS_PER_S)
"""After the verified upload: what the vehicle reports then belongs to the first leg."""
BETWEEN_SCANS = 5
AUTOPILOT = {"arduplane": "ardupilot", "px4": "px4"}
SPEED_M_S = {"ardupilot": 18.0, "px4": 12.0}
FAULTS_AT_S = {"ardupilot": {4: 12.0, 1: 50.0, 2: 85.0}, "px4": {4: 14.0, 1: 75.0, 3: 135.0}}
"""Vehicle and time of the faults: in the climb, en route, near the target."""
AFTER_S = 60.0
STARTED_S = 0.8
"""Run time of the first record, at most."""
FIRMWARE_FAILSAFES = {
    "ardupilot": {"FS_LONG_ACTN": 1.0, "BATT_LOW_VOLT": 10.5, "BATT_FS_LOW_ACT": 1.0, "FENCE_ACTION": 1.0},
    "px4": {"COM_LOW_BAT_ACT": 3.0, "NAV_RCL_ACT": 2.0, "GF_ACTION": 3.0},
}
"""Without failsafes for the ground station, which is not there when the vehicles take off."""
WATCHED = {Datagram, Order, Notice, Plan, AgentStatus, Send, MissionEnded}


@dataclass
class Flown:
    """What one mission came to."""

    complete: bool = False
    survivors: int = 0
    arrived: int = 0
    uploads: int = 0
    failed: int = 0
    nearest_m: float = math.inf
    nearest: str = ""
    cross_track_m: list[float] = field(default_factory=list)
    off_route_m: list[float] = field(default_factory=list)


def scenario_file(name: str, wind_m_s: float, folder: Path) -> Path:
    """Write the scenario with a wind from the north-west, and routes that allow for it."""
    text, _ = read_text(name)
    if wind_m_s:
        east, north = 0.625 * wind_m_s, -0.78 * wind_m_s
        text = text.replace("[airframe]\n", f"[airframe]\nwind_m_s = {wind_m_s}\n", 1)
        lines = []
        table = ""
        for line in text.splitlines():
            table = line if line.startswith("[") else table
            if table.startswith("[simulation.wind]") and line.startswith(("east_m_s", "north_m_s")):
                line = f"{line.split(' ')[0]} = {east if line.startswith('east') else north}"
            lines.append(line)
        text = "\n".join(lines)
        if "[simulation.wind]" not in text:
            text += f"\n[simulation.wind]\neast_m_s = {east}\nnorth_m_s = {north}\n"
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    return path


def fly(scenario: Path, seed: int, speed: float, sitl: list[str], folder: Path) -> Flown:
    """Fly one mission and read its recording."""
    out = folder / f"{scenario.stem}-{seed}"
    command = [sys.executable, "-P", "-c", "from gcs.cli import main; main()", "demo", str(scenario)]
    command += ["--headless", "--json", "--seed", str(seed), "--speed", str(speed), "--out", str(out)]
    for one in sitl:
        command += ["--sitl", one]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = done.stdout.strip().splitlines()
    if not lines:
        print(done.stderr[-2000:], file=sys.stderr)
        return Flown()
    if "of the run's speed" in done.stderr:
        print(f"{out.name}: the firmware fell behind the clock; lower --speed", file=sys.stderr)
    summary = json.loads(lines[-1])
    flown = read_flown(out, scenario, seed)
    flown.complete = summary["outcome"] == "complete"
    statuses = [agent["status"] for agent in summary["agents"]]
    flown.arrived, flown.survivors = statuses.count("arrived"), len(statuses) - statuses.count("lost")
    flown.uploads, flown.failed = summary["uploads"], summary["upload_failures"]
    if not flown.complete:
        print(f"{out.name}: {summary['reason']}", file=sys.stderr)
    return flown


def read_flown(recording: Path, scenario: Path, seed: int) -> Flown:
    """Take distances from obstacles and cross-track errors out of a recording."""
    config = parse(scenario.read_text(encoding="utf-8"), str(scenario))
    grid = mission_grid(config, seed)
    cells = np.argwhere(grid.blocked)[:, ::-1].astype(np.float64)
    near_m = 2.0 * config.planning.capture_radius_m
    flown, ends, done = Flown(), dict[int, FloatArray](), set[int]()
    uploaded_ns, tasked = dict[int, int](), defaultdict[int, int](int)
    last, start_ns = dict[int, tuple[float, float]](), 0
    routes, legs = dict[int, FloatArray](), dict[int, FloatArray]()
    for record in read(recording, only={Datagram, Plan, AgentStatus, Truth, UploadReport}):
        value, start_ns = record.value, start_ns or record.t_ns
        if isinstance(value, Plan):
            ends.update({route.vehicle: route.points_m[-1] for route in value.routes})
            routes.update({route.vehicle: route.points_m for route in value.routes})
        elif isinstance(value, AgentStatus) and value.status != "active":
            done.add(value.vehicle)
        elif isinstance(value, UploadReport) and value.ok:
            tasked[value.vehicle] += 1
            uploaded_ns[value.vehicle] = value.t_ns
            if tasked[value.vehicle] > 1 and value.vehicle in last:
                legs[value.vehicle] = np.vstack((last[value.vehicle], routes[value.vehicle]))
        elif isinstance(value, Datagram):
            take_cross_track(flown, value, uploaded_ns, tasked)
        elif isinstance(value, Truth):
            for thing in value.objects:
                if thing.kind == "agents" and thing.alive and thing.id in ends and thing.id not in done:
                    here = (thing.east_m, thing.north_m)
                    end = (ends[thing.id], near_m)
                    t_ns = record.t_ns - start_ns
                    take_distance(flown, grid, cells, last.get(thing.id, here), here, thing.id, t_ns, end)
                    since_ns = record.t_ns - uploaded_ns.get(thing.id, record.t_ns)
                    if thing.id in legs and FIRST_LEG_NS[0] <= since_ns < FIRST_LEG_NS[1]:
                        flown.off_route_m.append(distance_to_route_m(legs[thing.id], here))
                    last[thing.id] = here
    return flown


def take_distance(
    flown: Flown, grid: Grid, cells: FloatArray, before: tuple[float, float], now: tuple[float, float],
    vehicle: int, t_ns: int, end: tuple[FloatArray, float],
) -> None:  # fmt: skip
    for part in np.linspace(0.0, 1.0, BETWEEN_SCANS + 1)[1:]:
        place = (before[0] + part * (now[0] - before[0]), before[1] + part * (now[1] - before[1]))
        if math.dist(place, end[0]) <= end[1]:
            return
        distance_m = distance_to_obstacle_m(grid, cells, place)
        if distance_m < flown.nearest_m:
            where = f"({place[0]:.0f}, {place[1]:.0f})"
            flown.nearest_m, flown.nearest = (
                distance_m,
                f"agent {vehicle} at {where}, t {t_ns / NS_PER_S:.0f}",
            )


def distance_to_route_m(points_m: FloatArray, here: tuple[float, float]) -> float:
    """Return the least distance of a place from a route's legs."""
    starts, legs = points_m[:-1], np.diff(points_m, axis=0)
    squared = np.maximum((legs**2).sum(axis=1), 1e-9)
    part = np.clip(((np.asarray(here) - starts) * legs).sum(axis=1) / squared, 0.0, 1.0)
    return float(np.hypot(*(starts + part[:, None] * legs - here).T).min())


def quantiles(values: list[float]) -> str:
    """Return the median, the 95 % quantile and the greatest of some numbers."""
    if not values:
        return "none reported"
    return ", ".join(f"{value:.1f}" for value in np.quantile(values, (0.5, 0.95, 1.0)))


def take_cross_track(
    flown: Flown, datagram: Datagram, uploaded_ns: dict[int, int], tasked: dict[int, int]
) -> None:
    for frame in scan(datagram.data).frames:
        vehicle = frame.system_id
        if frame.message_id != 62 or tasked.get(vehicle, 0) < 2:  # the first mission is not a re-task
            continue
        after_ns = datagram.t_ns - uploaded_ns[vehicle]
        message = frame.message()
        if message is not None and FIRST_LEG_NS[0] <= after_ns < FIRST_LEG_NS[1]:
            flown.cross_track_m.append(abs(message.xtrack_error))


def fly_faults(kind: str, seed: int, speed: float, sitl: str, folder: Path) -> Result:
    """Fly one mission with faults of a kind at three moments, and read its recording."""
    autopilot = AUTOPILOT[sitl.partition("=")[0]]
    path = folder / f"{autopilot}.toml"
    path.write_text(field_text(autopilot, FIRMWARE_FAILSAFES[autopilot], SPEED_M_S[autopilot]))
    out, at_s = folder / f"{autopilot}-{kind}-{seed}", FAULTS_AT_S[autopilot]
    command = [sys.executable, "-P", "-c", "from gcs.cli import main; main()", "demo", str(path)]
    command += ["--headless", "--json", "--seed", str(seed), "--speed", str(speed), "--out", str(out)]
    command += ["--sitl", sitl, "--duration", str(max(at_s.values()) + AFTER_S)]
    for vehicle, when_s in at_s.items():
        command += ["--faults", f"{kind}:{vehicle}@{when_s}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    job, text = Job(seed, kind, autopilot), f"{autopilot} {kind} seed {seed}"
    if not out.exists():
        return Result(job, text, stuck=done.stderr.strip()[-200:] or "no recording")
    watches = {vehicle: FaultWatch(kind, vehicle) for vehicle in at_s}
    start_ns = None
    for record in read(out, only=WATCHED):
        start_ns = start_ns or record.t_ns
        for vehicle, watch in watches.items():
            if watch.fault_ns is None and record.t_ns - start_ns >= (at_s[vehicle] - STARTED_S) * NS_PER_S:
                broken = [other for other, one in watches.items() if one.fault_ns is not None]
                watch.begin(record.t_ns, broken)
            if isinstance(record.value, (Datagram, Order)):
                watch.event(record.value)
            else:
                watch.effect(record.t_ns, record.value)
    if any(watch.fault_ns is None for watch in watches.values()):
        return Result(job, text, stuck=f"it ended before its faults: {done.stderr.strip()[-200:]}")
    return result_of(job, text, list(watches.values()))


def fly_fault_table(options: argparse.Namespace) -> None:
    results = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        seeds = range(options.first, options.first + options.seeds)
        for sitl, kind, seed in product(options.sitl, options.kinds, seeds):
            results.append(fly_faults(kind, seed, options.speed, sitl, folder))
            print(f"{results[-1].text}: {'; '.join(results[-1].problems) or 'good'}", file=sys.stderr)
            for notice in results[-1].notices:
                print(f"    {notice}", file=sys.stderr)
    print_table(results, is_random=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", default=SCENARIOS)
    parser.add_argument("--sitl", action="append", default=[], help="arduplane=PATH or px4=PATH")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="the first seed; default 1")
    parser.add_argument("--winds", type=float, nargs="*", default=[0.0, 6.0], help="m/s; default 0 6")
    parser.add_argument("--speed", type=float, default=4.0)
    parser.add_argument("--keep", type=Path, help="folder for the recordings; none is kept without it")
    parser.add_argument("--faults", action="store_true", help="fly the table of faults")
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=KINDS, help="of faults; default all")
    options = parser.parse_args()
    if options.faults:
        fly_fault_table(options)
        return
    print("| scenario | wind, m/s | complete | survivors arrived | least distance, m | inside an obstacle "
          "| first legs: reported cross-track, median, 95 %, most, m | true distance from them "
          "| uploads, failed |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    for name, wind in product(options.scenarios, options.winds):
        with tempfile.TemporaryDirectory() as temporary:
            folder = (options.keep or Path(temporary)) / f"wind-{wind:g}"
            folder.mkdir(parents=True, exist_ok=True)
            path = scenario_file(name, wind, folder)
            seeds = range(options.first, options.first + options.seeds)
            every = [fly(path, seed, options.speed, options.sitl, folder) for seed in seeds]
        for seed, one in zip(seeds, every, strict=True):
            print(
                f"{name}-{seed} wind {wind:g}: nearest {one.nearest_m:.1f} m, {one.nearest}", file=sys.stderr
            )
        reported = [error for one in every for error in one.cross_track_m]
        true = [error for one in every for error in one.off_route_m]
        print(
            f"| {name} | {wind:g} | {sum(one.complete for one in every)} of {len(every)} "
            f"| {sum(one.arrived for one in every)} of {sum(one.survivors for one in every)} "
            f"| {min(one.nearest_m for one in every):.1f} | {sum(one.nearest_m <= 0.0 for one in every)} "
            f"| {quantiles(reported)} | {quantiles(true)} "
            f"| {sum(one.uploads for one in every)}, {sum(one.failed for one in every)} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
