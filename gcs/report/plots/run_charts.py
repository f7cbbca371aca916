"""Charts of a run over time: cardinality, OSPA, decisions, transfers, delays, flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from gcs.model import FloatArray, read_only
from gcs.planning.terrain.ground import Terrain
from gcs.report.plots.style import (
    INK,
    KINDS,
    LABELLED,
    RED,
    TRIGGERS,
    colours,
    heading,
    legend,
    new_figure,
    say,
    size_for,
    tidy,
)
from gcs.report.plots.terrain_shading import BAND
from gcs.report.run.evaluation import OSPA_CUTOFF_M
from gcs.report.run.timeline import Timeline
from gcs.report.telemetry.flights import Flight, agl_m

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MODE_COLOURS: Final = (
    "#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#0072b2", "#d55e00", "#7a5cc0", "#8c6d31",
)  # fmt: skip


def quality_figure(timeline: Timeline) -> Figure:
    """Draw cardinality, and OSPA of both trackers with its two parts, over time."""
    figure = new_figure(11.0, 7.6)
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    draw_cardinality(top, timeline)
    for axes, (kind, colour) in zip((middle, bottom), KINDS.items(), strict=True):
        series = timeline.ospa[kind]
        tidy(axes)
        mean = f", mean {series.mean_m:.2f} m" if series.t_ns else ""
        heading(axes, f"OSPA of {kind}, m (c = {OSPA_CUTOFF_M:.0f} m, p = 1){mean}")
        if not series.t_ns:
            say(axes, "no ground truth in this recording")
            continue
        t_s = _seconds(timeline, series.t_ns)
        parts = (series.localisation_m, series.cardinality_m)
        axes.stackplot(
            t_s, *parts, colors=[colour + "66", "#cc79a7aa"], labels=["of places", "of the number"], lw=0
        )
        axes.plot(t_s, series.total_m, color=colour, lw=1.2, label="OSPA")
        late = timeline.late_ospa[kind]
        if late.t_ns:
            label = f"OSPA some scans late, mean {late.mean_m:.2f} m"
            axes.plot(_seconds(timeline, late.t_ns), late.total_m, color=INK, lw=1.0, ls=":", label=label)
        axes.set_ylim(0.0, max(5.0, 1.1 * float(series.total_m.max())))
        legend(axes, ncol=4, loc="upper right")
    bottom.set_xlabel("time, s")
    bottom.set_xlim(0.0, max(timeline.duration_s, 1.0))
    return figure


def draw_cardinality(axes: Axes, timeline: Timeline) -> None:
    """Draw the true and estimated cardinality of both kinds over time."""
    from matplotlib.ticker import MaxNLocator

    most = 1
    for kind, colour in KINDS.items():
        series = timeline.ospa[kind]
        scans = timeline.estimates[kind]
        if series.t_ns:
            t_s = _seconds(timeline, series.t_ns)
            line: dict[str, Any] = {"color": colour, "lw": 2.6, "alpha": 0.35, "label": f"{kind}, true"}
            axes.step(t_s, series.true_count, where="post", **line)
        counts = [len(estimate.points_m) for estimate in scans]
        if scans:
            axes.plot([e.t_s for e in scans], counts, ".", ms=4.0, color=colour, label=f"{kind}, estimated")
        most = max([most, *series.true_count, *counts])
    axes.set_ylim(0.0, most + 1.0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=6))
    tidy(axes)
    heading(axes, "number of objects")
    if any(timeline.estimates.values()):
        legend(axes, ncol=2, loc="lower right")
    else:
        say(axes, "no tracker ran: a telemetry log without a mission (see --config)")


def timeline_figure(timeline: Timeline) -> Figure:
    """Draw the triggers of plans and the status of each agent over time."""
    agents = agents_of(timeline)
    named = {trigger for decision in timeline.decisions for trigger in decision.triggers}
    rows = [row for row in TRIGGERS.items() if row[0] in named]
    row_height = 0.34 if len(agents) <= LABELLED else 0.16
    heights = (0.3 * max(len(rows), 1) + 0.5, row_height * max(len(agents), 2) + 0.6)
    figure = new_figure(11.0, sum(heights) + 0.9)
    top, bottom = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": heights})
    for row, (trigger, colour) in enumerate(rows):
        times = [d.t_s for d in timeline.decisions if trigger in d.triggers]
        retasks = [d.t_s for d in timeline.decisions if trigger in d.triggers and d.changed]
        top.plot(times, [row] * len(times), "o", ms=7, mfc="none", color=colour, mew=1.4)
        top.plot(retasks, [row] * len(retasks), "o", ms=7, color=colour)
    top.set_ylim(len(rows) - 0.4, -0.6)
    top.set_yticks(range(len(rows)), [name for name, _ in rows])
    tidy(top)
    heading(top, "plans by trigger (filled: vehicles got new routes)")
    draw_agent_rows(bottom, timeline, agents)
    bottom.set_xlabel("time, s")
    bottom.set_xlim(0.0, 1.015 * max(timeline.duration_s, 1.0))
    return figure


def agents_of(timeline: Timeline) -> list[int]:
    """Return all known agents."""
    tasked = (vehicle for decision in timeline.decisions for vehicle in decision.targets)
    return sorted({*timeline.paths["agents"], *tasked, *(v for v, _, _ in timeline.statuses)})


def draw_agent_rows(axes: Axes, timeline: Timeline, agents: Sequence[int]) -> None:
    """Draw one row for each agent: active, re-tasked, mission uploaded, arrived, true and detected loss."""
    size = size_for(len(agents))
    row_of = {vehicle: row for row, vehicle in enumerate(agents)}
    colour = colours(agents)
    for vehicle, row in row_of.items():
        path = timeline.paths["agents"].get(vehicle)
        end_s = float(path.t_s[-1]) if path is not None else timeline.duration_s
        line: dict[str, Any] = {"color": colour[vehicle], "alpha": 0.3, "solid_capstyle": "butt"}
        axes.plot((0.0, end_s), (row, row), lw=6.0 * size, **line)
        if path is not None and path.is_lost:
            axes.plot(end_s, row, marker="X", ms=11 * size, color=INK, mec="white", mew=1.0, zorder=6)
    for decision in timeline.decisions:
        rows = [row_of[v] for v in decision.changed if v in row_of]
        axes.plot([decision.t_s] * len(rows), [r - 0.3 for r in rows], "v", ms=5 * size, color=INK, zorder=4)
    for t_s, report in timeline.uploads:
        if report.vehicle in row_of:
            row = row_of[report.vehicle]
            span_s = (t_s - report.duration_s, t_s)
            shade = INK if report.ok else RED
            axes.plot(span_s, (row, row), color=shade, lw=2.6 * size, solid_capstyle="butt", zorder=4)
    for vehicle, t_s, status in timeline.statuses:
        if vehicle in row_of and status != "active":
            style: dict[str, Any] = {"marker": "*", "ms": 15 * size, "color": colour[vehicle], "mec": INK}
            if status in ("lost", "down"):
                style = {"marker": "o", "ms": 11 * size, "mfc": "none", "mec": RED, "mew": 1.8}
            axes.plot(t_s, row_of[vehicle], zorder=7, **style)
    axes.set_ylim(max(len(agents), 1) - 0.4, -0.6)
    shown = agents[:: max(1, -(-len(agents) // 25))]
    axes.set_yticks([row_of[v] for v in shown], [f"agent {v}" for v in shown])
    tidy(axes)
    axes.grid(visible=False, axis="y")
    heading(axes, "▾ re-task  ▬ upload (red: failed)  ★ arrived  ✖ lost  ○ detected")


def times_figure(timeline: Timeline, work_ms: Mapping[str, Sequence[float]]) -> Figure:
    """Draw durations of transfers, delays of scans, and computing times of scans and plans."""
    figure = new_figure(11.0, 6.4)
    ((over_time, uploads), (delays, work)) = figure.subplots(2, 2)
    good = np.array([(t, r.duration_s) for t, r in timeline.uploads if r.ok]).reshape(-1, 2)
    bad = np.array([(t, r.duration_s) for t, r in timeline.uploads if not r.ok]).reshape(-1, 2)
    over_time.plot(*good.T, "o", ms=4, color=KINDS["agents"], alpha=0.8, label="verified by read-back")
    if len(bad):
        over_time.plot(*bad.T, "X", ms=7, color=RED, label="failed")
    _panel(
        over_time,
        "time of each mission transfer, s",
        bool(timeline.uploads),
        "no mission transfers",
    )
    _shares(uploads, {"transfers": good[:, 1]}, "time of a transfer: share that took at most …", "s")
    late = {name: 1e3 * sensor.delay_s for name, sensor in timeline.sensors.items() if len(sensor.t_s)}
    for sensor, values in late.items():
        delays.plot(timeline.sensors[sensor].t_s, values, ".", ms=3, label=sensor)
    _panel(delays, "delay of each scan, from measurement to arrival, ms", bool(late), "no scans")
    delays.set_ylim(bottom=min(0.0, delays.get_ylim()[0]), top=max(1.0, delays.get_ylim()[1]))
    _shares(work, work_ms, "work measured again on this machine: share that took at most …", "ms")
    return figure


def _panel(axes: Axes, title: str, any_there: bool, otherwise: str) -> None:
    tidy(axes)
    heading(axes, title)
    axes.set_xlabel("time, s")
    if any_there:
        axes.set_ylim(bottom=0.0)
        legend(axes, loc="best")
    else:
        say(axes, otherwise)


def _shares(axes: Axes, values: Mapping[str, Sequence[float] | FloatArray], title: str, unit: str) -> None:
    tidy(axes)
    heading(axes, title)
    axes.set(xlabel=unit, ylabel="share, %")
    there = {name: np.sort(np.asarray(one)) for name, one in values.items() if len(one)}
    for (name, one), colour in zip(there.items(), (*KINDS.values(), *_MODE_COLOURS), strict=False):
        share = 100.0 * np.arange(1, len(one) + 1) / len(one)
        label = f"{name} ({len(one)}), median {np.median(one):.3g} {unit}"
        axes.step(one, share, where="post", color=colour, lw=1.6, label=label)
    if there:
        axes.set_ylim(0.0, 103.0)
        axes.set_xlim(left=0.0)
        legend(axes, loc="lower right")
    else:
        say(axes, "not measured")


def flight_figure(flights: Mapping[int, Flight], duration_s: float, terrain: Terrain | None = None) -> Figure:
    """Draw height, speed and flight modes from telemetry over time, and heights above terrain."""
    row_height = 0.34 if len(flights) <= LABELLED else 0.16
    above = [] if terrain is None else [1.9]
    heights = (1.9, *above, 1.9, row_height * max(len(flights), 1) + 0.5)
    figure = new_figure(11.0, sum(heights) + 1.2)
    rows = figure.subplots(len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights})
    height = rows[0]
    speed = rows[-2]
    modes = rows[-1]
    if terrain is not None:
        _heights_above_ground(rows[1], flights, terrain)
    size = size_for(len(flights))
    colour = colours(flights)
    for vehicle, flight in flights.items():
        step = max(1, len(flight.t_s) // 1500)
        line: dict[str, Any] = {"color": colour[vehicle], "lw": 1.4 * size, "label": f"vehicle {vehicle}"}
        height.plot(flight.t_s[::step], flight.alt_rel_m[::step], **line)
        speed.plot(flight.t_s[::step], flight.ground_speed_m_s[::step], **line)
    for axes, title in ((height, "height above home, m"), (speed, "ground speed, m/s")):
        tidy(axes)
        heading(axes, title)
        axes.ticklabel_format(axis="y", useOffset=False)
    fastest_m_s = max((float(f.ground_speed_m_s.max()) for f in flights.values() if len(f.t_s)), default=0.0)
    speed.set_ylim(0.0, max(1.0, 1.1 * fastest_m_s))
    if 1 < len(flights) <= LABELLED:
        legend(height, ncol=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
    _modes(modes, flights)
    modes.set_xlim(0.0, max(duration_s, 1.0))
    modes.set_xlabel("time, s")
    return figure


def _heights_above_ground(axes: Axes, flights: Mapping[int, Flight], terrain: Terrain) -> None:
    tidy(axes)
    heading(axes, f"height above ground, m; flight band {terrain.min_agl_m:g} to {terrain.max_agl_m:g} m")
    axes.axhspan(terrain.min_agl_m, terrain.max_agl_m, color=BAND, alpha=0.18, lw=0.0, zorder=1)
    size = size_for(len(flights))
    colour = colours(flights)
    for vehicle, flight in flights.items():
        step = max(1, len(flight.t_s) // 1500)
        axes.plot(
            flight.t_s[::step], agl_m(flight, terrain)[::step], color=colour[vehicle], lw=1.4 * size, zorder=3
        )
    axes.set_ylim(bottom=0.0)


def _modes(axes: Axes, flights: Mapping[int, Flight]) -> None:
    from matplotlib.patches import Patch

    names = list(dict.fromkeys(mode for f in flights.values() for _, mode, _ in f.modes))
    colour = {name: _MODE_COLOURS[n % len(_MODE_COLOURS)] for n, name in enumerate(names)}
    for row, flight in enumerate(flights.values()):
        ends = [*(t_s for t_s, _, _ in flight.modes[1:]), flight.heard_s]
        for (since_s, mode, armed), end_s in zip(flight.modes, ends, strict=False):
            axes.barh(
                row, end_s - since_s, left=since_s, height=0.72 if armed else 0.3, color=colour[mode], lw=0
            )
    axes.set_ylim(max(len(flights), 1) - 0.5, -0.6)
    step = max(1, -(-len(flights) // 25))
    axes.set_yticks(range(0, len(flights), step), [f"vehicle {v}" for v in list(flights)[::step]])
    tidy(axes)
    axes.grid(visible=False, axis="y")
    heading(axes, "mode, while the vehicle was heard (thick: armed)")
    handles = [Patch(color=colour[name], label=name) for name in names[:12]]
    if handles:
        figure = axes.get_figure()
        assert figure is not None
        figure.legend(handles=handles, ncol=8, loc="outside lower center", frameon=False, fontsize=9)


def _seconds(timeline: Timeline, t_ns: Sequence[int]) -> FloatArray:
    return read_only((np.array(t_ns, dtype=np.int64) - timeline.start_t_ns) * 1e-9)
