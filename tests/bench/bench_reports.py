"""Position reports between scans: what they give the agents' tracker, and what they cost.

    python tests/bench/bench_reports.py [--runs 20]

Agents fly legs with turns and report at 4 Hz. Half of them are lost in flight; in a third of the runs the
link of one agent is silent for 3 s. Each line is a way to use the reports, on the same draws:

* scans: the newest reports at the time of each scan, as the service does
* own time: epochs of reports between scans as well, and the newest reports again at each scan
* own time only: epochs of reports between scans, and no reports at scans

It prints OSPA at the scans (c = 100 m, p = 1), the delay from the first scan after a loss until the track is
lost, false losses, and milliseconds of CPU for each scan with the epochs before it. The GPS error is white,
as the simulator's, or drifts over 30 s, as a receiver's does.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from gcs.config import Config
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.perception.perception_state import PerceptionState
from gcs.core.perception.report_history import ReportHistory
from gcs.core.state import State
from gcs.model import NS_PER_S, Scan, Sensor, VehicleState
from gcs.tracking.glmb.filter import warm_up
from gcs.tracking.metrics import ospa
from sim_vehicles.world.scenario import load

LAG_S, TICK_S, DURATION_S, SPEED_M_S, SIDE_M = 0.1, 0.05, 100.0, 15.0, 2000.0
MODES = ("scans", "own time", "own time only")


class Flight:
    """Truth of one agent: positions at each tick, the time of its loss, and its silences."""

    def __init__(self, start_m: np.ndarray, rng: np.random.Generator, lost_s: float, drifts: bool) -> None:
        steps = round(DURATION_S / TICK_S) + 1
        rates = np.repeat(rng.choice([0.0, 0.0, 0.15, -0.15], steps // 100 + 1), 100)[:steps]
        self.course = np.cumsum(rates * TICK_S)
        v = SPEED_M_S * np.column_stack((np.sin(self.course), np.cos(self.course)))
        self.place_m = start_m + np.vstack((np.zeros(2), np.cumsum(v * TICK_S, axis=0)[:-1]))
        self.lost_s, self.phase = lost_s, int(rng.integers(5))
        self.silent_s = (math.inf, math.inf)
        self.error_m = rng.normal(0.0, 1.0, (steps, 2))
        if drifts:
            keep = math.exp(-TICK_S / 30.0)
            for k in range(1, steps):
                self.error_m[k] = keep * self.error_m[k - 1] + math.sqrt(1 - keep**2) * self.error_m[k]
            self.error_m *= 2.0


def run(config: Config, mode: str, seed: int, period_s: float, drifts: bool) -> Iterator[tuple[str, float]]:
    """Yield (figure, value) of one run."""
    rng = np.random.default_rng(seed)
    flights = [
        Flight(
            np.array([one.east_m, one.north_m]), rng,
            float(rng.uniform(20.0, 80.0)) if n % 2 else math.inf, drifts,
        )
        for n, one in enumerate(config.agents)
    ]  # fmt: skip
    if seed % 3 == 0:
        flights[0].silent_s = (40.0, 43.0)
    sensor = Sensor("radar", 0.98, 25 / SIDE_M**2, 10.0 * np.eye(2), (-SIDE_M, -SIDE_M, SIDE_M, SIDE_M))
    trackers, agents = MultiSensorTracker(config), State.initial(a.vehicle for a in config.agents).agents
    history = ReportHistory(agents, PerceptionState())
    newest: dict[int, VehicleState] = {}
    labels: dict[int, tuple[int, int]] = {}
    called: dict[int, float] = {}
    jitter_s = rng.uniform(0.0, 0.1, round(DURATION_S / period_s) + 1)
    next_scan, spent_s = 1, 0.0
    scans_s: list[float] = []
    for k in range(1, round(DURATION_S / TICK_S)):
        t_s, t_ns = k * TICK_S, round(k * TICK_S * NS_PER_S)
        for n, flight in enumerate(flights):
            silent = flight.silent_s[0] <= t_s < flight.silent_s[1]
            if (k + flight.phase) % 5 == 0 and t_s < flight.lost_s and not silent:
                east_m, north_m = flight.place_m[k] + flight.error_m[k]
                vehicle = config.agents[n].vehicle
                newest[vehicle] = VehicleState(
                    vehicle, t_ns, east_m, north_m, 100.0, SPEED_M_S, flight.course[k], "AUTO", True, 0
                )
        states = tuple(newest.values())
        history.add(t_ns, states)
        scan_s = next_scan * period_s + jitter_s[next_scan]
        if t_s >= scan_s + LAG_S:
            at = round(scan_s / TICK_S)
            scans_s.append(scan_s)
            alive = [n for n, one in enumerate(flights) if scan_s < one.lost_s]
            seen = [n for n in alive if rng.random() < 0.98]
            z = np.reshape([flights[n].place_m[at] for n in seen], (-1, 2))
            clutter = rng.uniform(-SIDE_M, SIDE_M, (rng.poisson(25), 2))
            z = np.vstack((z + rng.normal(0, 10**0.5, z.shape), clutter))
            measured_t_ns = round(at * TICK_S * NS_PER_S)
            begin = time.process_time()
            if mode == "own time":
                trackers.state.reports_t_ns = -1
            elif mode == "own time only":
                trackers.state.reports_t_ns = measured_t_ns
            scan = Scan(t_ns, measured_t_ns, sensor, z)
            picture, _ = trackers.scan(scan, history.at(measured_t_ns, states))
            if mode == "own time only":
                trackers.state.reports_t_ns = -1
            spent_s += time.process_time() - begin
            yield "cpu_ms", spent_s * 1e3
            spent_s, next_scan = 0.0, next_scan + 1
            tracks = {track.label: track for track in picture.tracks}
            truth_m = np.reshape([flights[n].place_m[at] for n in alive], (-1, 2))
            shown_m = np.reshape([track.mean[:2] for track in tracks.values() if track.estimated], (-1, 2))
            if scan_s > 5.0:
                yield "ospa_m", ospa(shown_m, truth_m).total_m
            for n, flight in enumerate(flights):
                near = [
                    label
                    for label, one in tracks.items()
                    if one.existence > 0.9 and math.dist(one.mean[:2], flight.place_m[at]) < 50.0
                ]
                if n not in labels and near and n in alive:
                    labels[n] = near[0]
                is_lost = n in labels and (labels[n] not in tracks or tracks[labels[n]].existence < 0.01)
                if is_lost and n not in called:
                    called[n] = scan_s
                    if n in alive:
                        yield "false", 1.0
                        del labels[n]
                        del called[n]
                    else:
                        first_s = min(at_s for at_s in scans_s if at_s >= flight.lost_s)
                        yield "delay_s", scan_s - first_s
        elif mode != "scans":
            measured_t_ns = t_ns - round((LAG_S + 0.2) * NS_PER_S)
            if measured_t_ns > 0 and trackers.is_report_epoch_due(measured_t_ns):
                begin = time.process_time()
                trackers.report_epoch(t_ns, measured_t_ns, history.at(measured_t_ns, states))
                spent_s += time.process_time() - begin
    for n, flight in enumerate(flights):
        if flight.lost_s < DURATION_S and n not in called:
            yield "missed", 1.0


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--scenario", default="prescribed")
    parser.add_argument("--periods", default="1,4")
    arguments = parser.parse_args()
    warm_up()
    config = replace(load(arguments.scenario).config, births=())
    for period_s in map(float, arguments.periods.split(",")):
        for drifts in (False, True):
            kind = "drifts" if drifts else "white"
            print(f"{len(config.agents)} agents, scans every {period_s:g} s, GPS error {kind}")
            for mode in MODES:
                found: dict[str, list[float]] = {}
                for seed in range(1, arguments.runs + 1):
                    for name, value in run(config, mode, seed, period_s, drifts):
                        found.setdefault(name, []).append(value)
                delays, ospas, cpu = (np.array(found.get(k, [0.0])) for k in ("delay_s", "ospa_m", "cpu_ms"))
                print(
                    f"  {mode:14} OSPA {ospas.mean():5.2f} m  delay {delays.mean():4.2f} s "
                    f"(max {delays.max():.1f}, n {delays.size})  missed {len(found.get('missed', []))}  "
                    f"false {len(found.get('false', []))}  CPU {cpu.mean():5.2f} ms a scan", flush=True
                )  # fmt: skip


if __name__ == "__main__":
    main()
