"""One figure of a run, in the style of the paper's result figures.

Left: map of obstacles, ground truth (agents in colour, targets in grey-blue, starts as red circles, ends as
crosses), estimates (black circles), planned routes (dashed) and clutter (grey triangles). Right, over time:
OSPA of both trackers, cardinality, and the status of each agent.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.report.plots.maps import (
    Ground,
    draw_clutter,
    draw_ground,
    draw_some_estimates,
    legend_entries,
    truth_until,
)
from gcs.report.plots.run_charts import agents_of, draw_agent_rows, draw_cardinality
from gcs.report.plots.style import INK, KINDS, colours, heading, legend, legend_below, say, tidy
from gcs.report.run.evaluation import OSPA_CUTOFF_M
from gcs.report.run.timeline import Timeline, gather

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_run(
    values: Iterable[object], out_png: FilePath, ground: Ground | None = None, title: str = ""
) -> None:
    """Draw a run to a PNG.

    Parameters
    ----------
    values : iterable
        Events, effects and ground truth, such as the values of a recording.
    ground : Ground, optional
        Obstacles.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    timeline = gather(values)
    figure = Figure(figsize=(12.5, 7.5), dpi=156, facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        3, 2, width_ratios=(1.38, 1.0), height_ratios=(1.0, 0.8, 1.2),
        left=0.055, right=0.985, top=0.92 if title else 0.96, bottom=0.14, wspace=0.16, hspace=0.16,
    )  # fmt: skip
    if title:
        figure.suptitle(title, x=0.055, ha="left", fontsize=15, fontweight="bold", color=INK)
    _draw_map(figure.add_subplot(grid[:, 0]), timeline, ground)
    top = figure.add_subplot(grid[0, 1])
    middle = figure.add_subplot(grid[1, 1], sharex=top)
    bottom = figure.add_subplot(grid[2, 1], sharex=top)
    _draw_ospa(top, timeline)
    draw_cardinality(middle, timeline)
    draw_agent_rows(bottom, timeline, agents_of(timeline))
    for axes in (top, middle):
        axes.tick_params(labelbottom=False)
    top.set_xlim(0.0, 1.02 * max(timeline.duration_s, 1.0))
    bottom.set_xlabel("time, s")
    figure.savefig(out_png)


def _draw_map(axes: Axes, timeline: Timeline, ground: Ground | None) -> None:
    west, south, east, north = timeline.area_m
    margin = 0.02 * max(east - west, north - south, 1.0)
    axes.set(xlim=(west - margin, east + margin), ylim=(south - margin, north + margin), aspect="equal")
    axes.set(xlabel="east, m", ylabel="north, m")
    tidy(axes)
    draw_ground(axes, ground)
    draw_clutter(axes, timeline)
    colour = colours(agents_of(timeline))
    for vehicle, _, points in timeline.routes:
        axes.plot(*points.T, ls=(0, (4, 3)), lw=0.8, color=colour.get(vehicle, INK), alpha=0.75, zorder=3)
    truth_until(axes, timeline, timeline.duration_s)
    draw_some_estimates(axes, timeline, timeline.duration_s)
    entries = legend_entries(timeline, ground, everything=True)
    legend_below(axes, entries, 0.08, rows=2)


def _draw_ospa(axes: Axes, timeline: Timeline) -> None:
    worst_m = 10.0
    for kind, series in timeline.ospa.items():
        if not series.t_ns:
            continue
        t_s = (np.array(series.t_ns) - timeline.start_t_ns) * 1e-9
        line: dict[str, Any] = {"color": KINDS[kind], "label": f"{kind}, mean {series.mean_m:.1f} m"}
        axes.plot(t_s, series.total_m, lw=1.3, **line)
        axes.axhline(series.mean_m, color=KINDS[kind], lw=0.8, ls=":")
        worst_m = max(worst_m, float(series.total_m.max()))
    axes.set_ylim(0.0, min(1.1 * worst_m, 1.05 * OSPA_CUTOFF_M))
    tidy(axes)
    heading(axes, f"OSPA (c = {OSPA_CUTOFF_M:.0f} m, p = 1), m")
    if any(series.t_ns for series in timeline.ospa.values()):
        legend(axes, loc="best")
    else:
        say(axes, "no ground truth")
