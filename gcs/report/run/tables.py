"""Tables of a run: rows of text, each column with its unit.

All numbers come from the evaluator, the timeline and the traffic.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from gcs.model import NS_PER_S, vehicle_name
from gcs.planning.terrain.ground import Terrain
from gcs.report.run.evaluation import Summary
from gcs.report.run.timeline import KINDS, Timeline
from gcs.report.telemetry.flights import Flight, least_agl_m

_ROWS: Final = 300
NONE: Final = "–"
_LEAST_AGL: Final = "least AGL is that between the first and the last time above the floor of the flight band"


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text with column names that give the unit."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    left: frozenset[str] = frozenset()
    """Left-aligned columns of text; numbers are right-aligned."""
    note: str = ""


def agents(timeline: Timeline, summary: Summary, flights: Mapping[int, Flight]) -> Table:
    """Return the outcome of each agent."""
    rows = []
    for agent in summary.agents:
        vehicle = agent.system_id
        path = timeline.paths["agents"].get(vehicle)
        lost_s = float(path.t_s[-1]) if path is not None and path.is_lost else None
        called = [t_s for v, t_s, status in timeline.statuses if v == vehicle and status == "lost"]
        retasks = sum(vehicle in retask.vehicles for retask in summary.retask_list)
        flown_m = flights[vehicle].length_m if vehicle in flights else None
        if path is not None:
            flown_m = float(np.hypot(*np.diff(path.points_m, axis=0).T).sum())
        target = NONE if agent.target is None else str(agent.target)
        rows.append((
            str(vehicle), agent.status, target, number(lost_s), number(called[0] if called else None),
            str(retasks), number(flown_m, 0),
        ))  # fmt: skip
    columns = ("agent", "status", "true target", "last alive, s", "detected lost, s", "re-tasks", "flown, m")
    return _table("Agents", columns, rows, {"status"})


def tracking(timeline: Timeline) -> Table:
    """Return the errors of the trackers; needs ground truth."""
    rows = []
    for kind in KINDS:
        series = timeline.ospa[kind]
        if series.t_ns:
            right = np.mean(np.equal(series.true_count, series.estimated_count))
            total = series.total_m
            rows.append((
                kind, str(len(total)), number(series.mean_m, 2), number(float(np.median(total)), 2),
                number(float(np.percentile(total, 95)), 2), number(float(total.max()), 2),
                number(float(series.localisation_m.mean()), 2), number(float(series.cardinality_m.mean()), 2),
                number(100.0 * float(right)),
            ))  # fmt: skip
    columns = (
        "tracker", "scans", "OSPA mean, m", "median, m", "95 %, m", "worst, m", "localisation, m",
        "cardinality, m", "cardinality correct, % of scans",
    )  # fmt: skip
    return _table("Trackers against ground truth", columns, rows, {"tracker"})


def plans(timeline: Timeline) -> Table:
    """Return every plan and its triggers."""
    rows = [
        (
            number(decision.t_s), ", ".join(map(str, decision.changed)) or NONE,
            ", ".join(decision.triggers), decision.reason,
        )
        for decision in timeline.decisions
    ]  # fmt: skip
    columns = ("at, s", "agents with new routes", "trigger", "reason")
    return _table("Plans", columns, rows, {"agents with new routes", "trigger", "reason"})


def uploads(timeline: Timeline) -> Table:
    """Return the mission transfers of each vehicle."""
    rows = []
    for vehicle in sorted({report.vehicle for _, report in timeline.uploads}):
        of = [report for _, report in timeline.uploads if report.vehicle == vehicle]
        times = np.array([report.duration_s for report in of if report.ok])
        quantiles = [number(float(np.percentile(times, q)), 2) if len(times) else NONE for q in (50, 95, 100)]
        rows.append((
            str(vehicle), str(len(of)), str(sum(not report.ok for report in of)),
            str(sum(report.items for report in of)), str(sum(report.retries for report in of)), *quantiles,
        ))  # fmt: skip
    columns = ("vehicle", "transfers", "failed", "items", "retries", "median, s", "95 %, s", "worst, s")
    return _table("Mission transfers by vehicle", columns, rows, note="times of those verified by read-back")


def sensors(timeline: Timeline) -> Table:
    """Return the scans of each sensor."""
    rows = []
    for name, of in timeline.sensors.items():
        period = np.median(np.diff(np.sort(of.t_s))) if len(of.t_s) > 1 else None
        late = [number(1e3 * float(np.percentile(of.delay_s, q)), 1) for q in (50, 99, 100)]
        rows.append((
            name, str(len(of.t_s)), number(None if period is None else float(period), 2),
            number(float(of.detections.mean())), number(float(of.detections.max()), 0), *late,
        ))  # fmt: skip
    columns = (
        "sensor", "scans", "period, s", "detections, mean", "most", "delay median, ms", "99 %, ms",
        "worst, ms",
    )  # fmt: skip
    return _table("Scans by sensor", columns, rows, {"sensor"})


def work(work_ms: Mapping[str, Sequence[float]]) -> Table:
    """Return the computing times of scans and plans."""
    rows = [
        (
            name, str(len(values)), number(float(np.median(values)), 2),
            number(float(np.percentile(values, 99)), 2), number(max(values), 2),
        )
        for name, values in work_ms.items() if len(values)
    ]  # fmt: skip
    columns = ("task", "count", "median, ms", "99 %, ms", "worst, ms")
    note = "measured in a replay on the machine that made this page"
    return _table("Computing times of central command", columns, rows, {"task"}, note)


def notices(timeline: Timeline) -> Table:
    """Return warnings and alarms."""
    rows = [
        (number(t_s), of.level, NONE if of.vehicle is None else str(of.vehicle), of.text)
        for t_s, of in timeline.notices
    ]
    return _table("Warnings and alarms", ("at, s", "level", "vehicle", "text"), rows, {"level", "text"})


def losses(timeline: Timeline) -> Table:
    """Return the losses of separation."""
    rows = [
        (
            " and ".join(map(vehicle_name, one.vehicles)), number(timeline.seconds(one.begin_t_ns)),
            number(None if one.end_t_ns is None else timeline.seconds(one.end_t_ns)),
            number(one.distance_m, 0), number(one.height_m, 0),
            ", ".join(number(place_m, 0) for place_m in one.place_m),
        )
        for one in timeline.losses
    ]  # fmt: skip
    columns = ("agents", "from, s", "apart again, s", "nearest, m", "height there, m", "began at, m")
    note = "by the positions that vehicles reported; places are east, north"
    return _table("Losses of separation", columns, rows, {"agents"}, note)


def flown(flights: Mapping[int, Flight], terrain: Terrain | None = None) -> Table:
    """Return the telemetry of each vehicle."""
    rows = []
    for vehicle, of in flights.items():
        times = f"{number(float(of.t_s[0]))} – {number(float(of.t_s[-1]))}" if len(of.t_s) else NONE
        modes = list(dict.fromkeys(mode for _, mode, _ in of.modes))
        height = number(float(of.alt_rel_m.max())) if len(of.t_s) else NONE
        speed = number(float(of.ground_speed_m_s.max())) if len(of.t_s) else NONE
        above = () if terrain is None else (number(least_agl_m(of, terrain), 0),)
        rows.append((
            str(vehicle), str(len(of.t_s)), times, number(of.length_m, 0), height, *above, speed,
            "yes" if any(armed for _, _, armed in of.modes) else "no", ", ".join(modes),
        ))  # fmt: skip
    columns = (
        "vehicle", "positions kept", "from – to, s", "flown, m", "highest, m",
        *(() if terrain is None else ("least AGL, m",)), "fastest, m/s", "armed", "modes",
    )  # fmt: skip
    note = "" if terrain is None else _LEAST_AGL
    return _table("Vehicles by their telemetry", columns, rows, {"from – to, s", "armed", "modes"}, note)


def senders(traffic: Mapping[str, Any]) -> Table:
    """Return the systems that sent MAVLink frames."""
    rows = []
    for of in (*traffic["vehicles"], *traffic["ground_stations"]):
        lost = of["lost"]
        frames = of["frames"]
        share = NONE if lost is None else f"{100.0 * lost / max(1, lost + frames):.2f}"
        longest = max((gap["seconds"] for gap in of["gaps"]), default=None)
        rows.append((
            f"{of['system']}/{of['component']}", of["type"] or NONE, of["autopilot"] or NONE,
            of["firmware"] or NONE, of["mavlink"], str(frames), number(of["rate_hz"]), share,
            str(of["gap_count"]), number(longest),
        ))  # fmt: skip
    columns = (
        "system", "type", "autopilot", "firmware", "MAVLink", "frames", "rate, Hz", "lost, %",
        "gaps > 5 s", "longest, s",
    )  # fmt: skip
    return _table("Senders", columns, rows, {"system", "type", "autopilot", "firmware"})


def transfers(traffic: Mapping[str, Any], start_t_ns: int) -> Table:
    """Return the mission transfers seen in the traffic."""
    rows = [
        (
            number((of["t_ns"] - start_t_ns) / NS_PER_S), str(of["from"]), str(of["to"]), of["kind"],
            str(of["items"]), str(of["items_seen"]), of["result"].lower(),
        )
        for of in traffic["missions"]
    ]  # fmt: skip
    columns = ("at, s", "from", "to", "kind", "items", "seen", "result")
    return _table("Mission transfers in the traffic", columns, rows, {"kind", "result"})


def versions(of: Mapping[str, str]) -> Table:
    """Return the software versions of a recording."""
    return _table("Versions", ("component", "version"), list(of.items()), {"component", "version"})


def number(value: float | None, digits: int = 1) -> str:
    """Return a number as text; a dash for none."""
    return NONE if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def _table(
    title: str,
    columns: tuple[str, ...],
    rows: Sequence[tuple[str, ...]],
    left: set[str] | frozenset[str] = frozenset(),
    note: str = "",
) -> Table:
    if len(rows) > _ROWS:
        note = f"{note + '; ' if note else ''}the first {_ROWS} of {len(rows)}"
    return Table(title, columns, tuple(rows[:_ROWS]), frozenset(left), note)
