"""Figure of a tracking result on recorded detections.

Left: all detections (grey), the ground truth (thin, black) and the tracks, each in its own colour from its
start (ring) to its end (cross). Right, over the scans: both coordinates of each track, OSPA and cardinality.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.model import FloatArray, Label
from gcs.report.plots.style import AGENTS, CLUTTER, INK, heading, legend, legend_below, sample, say, tidy
from gcs.tracking.metrics import Tracks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.gridspec import GridSpec

_MAX_DETECTIONS = 20_000
"""More would be a grey area and a large file."""


@dataclass(frozen=True, slots=True)
class TrackingDrawing:
    """Input of the figure, by scan number k."""

    title: str
    detections_k: FloatArray
    """(m,) scan of each detection."""
    detections_m: FloatArray
    """(m, 2)."""
    found: Mapping[int, Tracks[Label]]
    """States; the first two numbers are the position."""
    true: Mapping[int, Tracks[object]]
    ospa_m: Mapping[int, float]
    cutoff_m: float
    """Cut-off c of OSPA."""


def draw_tracking(drawing: TrackingDrawing, out: Path) -> None:
    """Draw to a file whose suffix gives the format.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.5, 7.5), dpi=156, facecolor="white")
    FigureCanvasAgg(figure)
    figure.suptitle(drawing.title, x=0.06, ha="left", fontsize=15, fontweight="bold", color=INK)
    grid = figure.add_gridspec(
        4, 2, width_ratios=(1.25, 1.0), left=0.06, right=0.985, top=0.91, bottom=0.13, wspace=0.15,
        hspace=0.32,
    )  # fmt: skip
    found = _paths(drawing.found)
    true = _paths(drawing.true)
    colour = {label: AGENTS[n % len(AGENTS)] for n, label in enumerate(sorted(found))}
    some = slice(None, None, max(1, -(-len(drawing.detections_m) // _MAX_DETECTIONS)))
    clutter = np.column_stack([drawing.detections_k, drawing.detections_m])[some]
    _draw_place(figure.add_subplot(grid[:, 0]), clutter, found, true, colour)
    charts = _charts(figure, grid)
    for column, (axes, name) in enumerate(zip(charts[:2], ("x, m", "y, m"), strict=True), 1):
        axes.plot(clutter[:, 0], clutter[:, column], ".", ms=1.8, color=CLUTTER, alpha=0.6, mew=0, zorder=1)
        for path in true.values():
            axes.plot(path[:, 0], path[:, column], color="black", lw=0.7, zorder=4)
        for label, path in found.items():
            axes.plot(path[:, 0], path[:, column], color=colour[label], lw=1.9, alpha=0.85, zorder=3)
        heading(axes, name)
    _draw_ospa(charts[2], drawing.ospa_m, drawing.cutoff_m)
    _draw_numbers(charts[3], drawing)
    scans = sorted(drawing.found) or [0]
    charts[3].set_xlim(scans[0], max(scans[-1], scans[0] + 1))
    figure.savefig(out)


def _paths(scans: Mapping[int, Tracks[Any]]) -> dict[Any, FloatArray]:
    """Return rows (k, x, y) of each label; a gap is a row of NaN, which is not drawn."""
    rows: dict[Any, list[tuple[float, float, float]]] = {}
    for k, tracks in sorted(scans.items()):
        for label, state in tracks.items():
            path = rows.setdefault(label, [])
            if path and path[-1][0] < k - 1:
                path.append((np.nan, np.nan, np.nan))
            path.append((float(k), float(state[0]), float(state[1])))
    return {label: np.array(path) for label, path in rows.items()}


def _charts(figure: Any, grid: GridSpec) -> list[Axes]:
    charts: list[Axes] = []
    for row in range(4):
        charts.append(figure.add_subplot(grid[row, 1], sharex=charts[0] if charts else None))
        tidy(charts[-1])
        charts[-1].tick_params(labelbottom=row == 3)
    charts[3].set_xlabel("scan", fontsize=10, color=INK)
    return charts


def _draw_place(
    axes: Axes,
    clutter: FloatArray,
    found: Mapping[Label, FloatArray],
    true: Mapping[object, FloatArray],
    colour: Mapping[Label, str],
) -> None:
    axes.plot(clutter[:, 1], clutter[:, 2], ".", ms=2.6, color=CLUTTER, alpha=0.6, mew=0, zorder=1)
    for label, path in found.items():
        style: dict[str, Any] = {"color": colour[label], "zorder": 5, "ls": "none"}
        axes.plot(path[:, 1], path[:, 2], color=colour[label], lw=2.6, alpha=0.85, zorder=3)
        axes.plot(*path[0, 1:], marker="o", ms=8, mfc="white", mew=2.0, **style)
        axes.plot(*path[-1, 1:], marker="x", ms=8, mew=2.2, **style)
    for path in true.values():
        axes.plot(path[:, 1], path[:, 2], color="black", lw=0.8, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, m", fontsize=10, color=INK)
    axes.set_ylabel("y, m", fontsize=10, color=INK)
    tidy(axes)
    handles = [
        sample("track", color=AGENTS[0], ls="-", lw=2.6),
        sample("its first scan", color=AGENTS[0], marker="o", ms=8, mfc="white", mew=2.0),
        sample("its last", color=AGENTS[0], marker="x", ms=8, mew=2.2),
        sample("detection", color=CLUTTER, marker=".", ms=6),
    ]
    if true:
        handles.insert(0, sample("ground truth", color="black", ls="-", lw=0.8))
    legend_below(axes, handles, 0.075)


def _draw_ospa(axes: Axes, ospa_m: Mapping[int, float], cutoff_m: float) -> None:
    heading(axes, f"OSPA (c = {cutoff_m:g} m, p = 1), m")
    if not ospa_m:
        say(axes, "no ground truth")
        return
    scans = list(ospa_m)
    values = np.array(list(ospa_m.values()))
    axes.fill_between(scans, values, color=AGENTS[0], alpha=0.14, lw=0)
    axes.plot(scans, values, color=AGENTS[0], lw=1.4)
    axes.axhline(float(values.mean()), color=AGENTS[0], lw=0.9, ls=(0, (4, 3)))
    axes.set_ylim(0.0, max(10.0, 1.1 * float(values.max())))


def _draw_numbers(axes: Axes, drawing: TrackingDrawing) -> None:
    from matplotlib.ticker import MaxNLocator

    heading(axes, "number of objects")
    counts = {k: len(tracks) for k, tracks in drawing.true.items()}
    if counts:
        scans = sorted(counts)
        axes.step(scans, [counts[k] for k in scans], where="mid", color="black", lw=0.9, label="ground truth")
    scans = sorted(drawing.found)
    estimated = [len(drawing.found[k]) for k in scans]
    few = len(scans) <= 300
    axes.plot(
        scans, estimated, "." if few else "-", ms=4.5, lw=1.0, color=AGENTS[1], label="estimated", zorder=3
    )
    axes.set_ylim(0.0, max([1, *counts.values(), *estimated]) + 1.0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=5))
    legend(axes, loc="lower right", ncol=2)
