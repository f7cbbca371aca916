"""One picture of a run, in the manner of the paper's result figures.

Left the map: obstacles, what truly happened (agents in colour, targets in grey-blue; starts are red circles,
ends crosses), what the trackers made of it (black circles), what was planned (dashed) and the clutter they
had to live with (grey triangles). Right, over time: OSPA of both trackers, numbers of objects, and what each
agent went through.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.model import FloatArray, Kind
from gcs.report.course import Course, gather
from gcs.report.judge import OSPA_CUTOFF_M

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_AGENTS = (
    "#0072b2",
    "#e69f00",
    "#009e73",
    "#cc79a7",
    "#56b4e9",
    "#d55e00",
    "#7a5cc0",
    "#8c6d31",
    "#1b9e9e",
    "#b03060",
)
"""Told apart with colour-blind eyes too (after Okabe and Ito)."""
_TARGETS = "#4a5568"
_KINDS: dict[Kind, str] = {"agents": "#0072b2", "targets": "#d55e00"}
_RED, _INK, _GRID = "#d7191c", "#1a202c", "#e2e8f0"
_LABELLED = 12
"""Up to this many objects of a kind are named on the map."""
_ESTIMATES: dict[Kind, int] = {"agents": 32, "targets": 12}
"""Estimates are drawn of about so many scans: of all, they would hide the truth below them."""
_MAX_CLUTTER = 5000


def draw_run(
    values: Iterable[object],
    out_png: FilePath,
    obstacles_m: FloatArray | None = None,
    cell_m: float = 0.0,
    title: str = "",
) -> None:
    """Draw a run to a PNG.

    Parameters
    ----------
    values
        Its events, effects and truths, such as the values that a recording holds.
    obstacles_m
        (n, 2) east/north of the centres of blocked cells.
    cell_m
        Side of a cell.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    course = gather(values)
    figure = Figure(figsize=(15.0, 9.0), dpi=130, facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        3, 2, width_ratios=(1.5, 1.0), height_ratios=(1.0, 0.8, 1.2),
        left=0.045, right=0.985, top=0.93 if title else 0.97, bottom=0.1, wspace=0.11, hspace=0.16,
    )  # fmt: skip
    if title:
        figure.suptitle(title, x=0.045, ha="left", fontsize=15, fontweight="bold", color=_INK)
    _draw_map(figure.add_subplot(grid[:, 0]), course, obstacles_m, cell_m)
    _draw_time_line(figure, grid, course)
    figure.savefig(out_png)


def _draw_map(axes: Axes, course: Course, obstacles_m: FloatArray | None, cell_m: float) -> None:
    colours, size = _colours(course), _size(course)
    west, south, east, north = course.area_m
    margin = 0.02 * max(east - west, north - south, 1.0)
    axes.set(xlim=(west - margin, east + margin), ylim=(south - margin, north + margin), aspect="equal")
    axes.set(xlabel="east, m", ylabel="north, m")
    _tidy(axes)
    _draw_obstacles(axes, obstacles_m, cell_m)
    clutter = course.clutter_m[:: max(1, -(-len(course.clutter_m) // _MAX_CLUTTER))]
    _dots(axes, clutter, marker="^", s=12, color="#718096", alpha=0.25, linewidths=0, zorder=2)
    for vehicle, _, points in course.routes:
        axes.plot(*points.T, ls=(0, (4, 3)), lw=0.8, color=colours.get(vehicle, _INK), alpha=0.75, zorder=3)
    for number, path in course.paths["targets"].items():
        axes.plot(*path.points_m.T, color=_TARGETS, lw=1.6 * size, zorder=4)
        _name(axes, f"T{number}", path.points_m[-1], course.paths["targets"], _TARGETS)
    for number, path in course.paths["agents"].items():
        axes.plot(*path.points_m.T, color=colours[number], lw=2.4 * size, zorder=5, solid_capstyle="round")
        _name(axes, str(number), path.points_m[0], course.paths["agents"], colours[number])
    for kind, scans in course.estimates.items():
        some = scans[:: max(1, len(scans) // _ESTIMATES[kind])]
        few = np.concatenate([np.empty((0, 2)), *(points for _, points in some)])
        _dots(
            axes, few, s=16 * size**2, facecolors="white", edgecolors="black", linewidths=0.7 * size, zorder=6
        )
    _draw_ends(axes, course)
    _draw_legend(axes, course, obstacles_m is not None)


def _draw_obstacles(axes: Axes, obstacles_m: FloatArray | None, cell_m: float) -> None:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    if obstacles_m is None or not len(obstacles_m):
        return
    half = cell_m / 2.0
    cells = [Rectangle((x - half, y - half), cell_m, cell_m) for x, y in obstacles_m]
    axes.add_collection(PatchCollection(cells, facecolor=_INK, edgecolor=_INK, linewidth=0.3, zorder=1))


def _draw_ends(axes: Axes, course: Course) -> None:
    size = _size(course)
    for paths in course.paths.values():
        starts = np.reshape([path.points_m[0] for path in paths.values()], (-1, 2))
        _dots(
            axes, starts, s=62 * size**2, facecolors="none", edgecolors=_RED, linewidths=2.0 * size, zorder=8
        )
        ends = np.reshape([path.points_m[-1] for path in paths.values() if not path.dies], (-1, 2))
        _dots(axes, ends, marker="x", s=58 * size**2, color="black", linewidths=2.0 * size, zorder=8)
    deaths = np.reshape([p.points_m[-1] for p in course.paths["agents"].values() if p.dies], (-1, 2))
    _dots(axes, deaths, marker="X", s=150 * size, color=_RED, edgecolors="white", linewidths=1.2, zorder=9)


def _draw_legend(axes: Axes, course: Course, obstacles: bool) -> None:
    from matplotlib.lines import Line2D

    def sample(name: str, **style: Any) -> Line2D:
        return Line2D([], [], label=name, **{"ls": "none", "color": "black", **style})

    entries = [
        sample("agent", ls="-", lw=2.4, color=_AGENTS[0]),
        sample("target", ls="-", lw=1.6, color=_TARGETS),
        sample("planned route", ls=(0, (4, 3)), lw=0.8, color=_AGENTS[0]),
        sample("estimate", marker="o", ms=4, mfc="white", mew=0.6),
        sample("clutter", marker="^", ms=4, color="#718096", alpha=0.5, mew=0),
        sample("start", marker="o", ms=7, mfc="none", mec=_RED, mew=2),
        sample("end", marker="x", ms=7, mew=2),
    ]
    if any(path.dies for path in course.paths["agents"].values()):
        entries.append(sample("death", marker="X", ms=11, color=_RED, mec="white"))
    if obstacles:
        entries.append(sample("obstacle", marker="s", ms=7, color=_INK))
    axes.legend(
        handles=entries, loc="upper center", bbox_to_anchor=(0.5, -0.06), ncol=len(entries), frameon=False,
        fontsize=9, handletextpad=0.5, columnspacing=1.3, borderaxespad=0.0,
    )  # fmt: skip


def _draw_time_line(figure: Figure, grid: object, course: Course) -> None:
    top = figure.add_subplot(grid[0, 1])  # type: ignore[index]
    middle = figure.add_subplot(grid[1, 1], sharex=top)  # type: ignore[index]
    bottom = figure.add_subplot(grid[2, 1], sharex=top)  # type: ignore[index]
    _draw_ospa(top, course)
    _draw_cardinality(middle, course)
    _draw_events(bottom, course)
    for axes in (top, middle):
        axes.tick_params(labelbottom=False)
    top.set_xlim(0.0, 1.02 * max(course.duration_s, 1.0))
    bottom.set_xlabel("time, s")


def _draw_ospa(axes: Axes, course: Course) -> None:
    worst_m = 10.0
    for kind, series in course.ospa.items():
        if not series.t_ns:
            continue
        t_s = (np.array(series.t_ns) - course.start_t_ns) * 1e-9
        axes.plot(
            t_s, series.total_m, color=_KINDS[kind], lw=1.3, label=f"{kind}, mean {series.mean_m:.1f} m"
        )
        axes.axhline(series.mean_m, color=_KINDS[kind], lw=0.8, ls=":")
        worst_m = max(worst_m, float(series.total_m.max()))
    axes.set_ylim(0.0, min(1.1 * worst_m, 1.05 * OSPA_CUTOFF_M))
    _tidy(axes)
    _heading(axes, f"OSPA (c = {OSPA_CUTOFF_M:.0f} m, p = 1), m")
    if any(series.t_ns for series in course.ospa.values()):
        axes.legend(loc="best", frameon=False, fontsize=9)
    else:
        axes.text(0.5, 0.5, "no truth to compare with", transform=axes.transAxes, ha="center", color=_TARGETS)


def _draw_cardinality(axes: Axes, course: Course) -> None:
    from matplotlib.ticker import MaxNLocator

    most = 1
    for kind, colour in _KINDS.items():
        truth, scans = course.ospa[kind], course.estimates[kind]
        t_s = (np.array(truth.t_ns) - course.start_t_ns) * 1e-9
        counts = [len(points) for _, points in scans]
        axes.step(
            t_s, truth.true_count, where="post", color=colour, lw=2.6, alpha=0.35, label=f"{kind}, true"
        )
        axes.plot([t_s for t_s, _ in scans], counts, ".", ms=5.0, color=colour, label="estimated")
        most = max([most, *truth.true_count, *counts])
    axes.set_ylim(0.0, most + 1.0)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=6))
    _tidy(axes)
    _heading(axes, "number of objects")
    axes.legend(loc="lower right", ncol=2, frameon=False, fontsize=9)


def _draw_events(axes: Axes, course: Course) -> None:
    """One lane for each agent: flying, re-tasked, uploaded to, arrived, dead, called dead."""
    colours = _colours(course)
    lanes = {vehicle: row for row, vehicle in enumerate(colours)}
    size = _size(course)
    for vehicle, row in lanes.items():
        path = course.paths["agents"].get(vehicle)
        end_s = path.t_s[-1] if path is not None else course.duration_s
        axes.plot(
            (0.0, end_s), (row, row), color=colours[vehicle], lw=5.0 * size, alpha=0.3, solid_capstyle="butt"
        )
        if path is not None and path.dies:
            axes.plot(end_s, row, marker="X", ms=12 * size, color=_RED, mec="white", mew=1.0, zorder=5)
    marks = [(v, t_s, "v", colours.get(v, _INK)) for v, t_s, _ in course.routes]
    marks += [(v, t_s, "|", _INK if ok else _RED) for v, t_s, ok in course.uploads]
    for vehicle, t_s, marker, colour in marks:
        if vehicle in lanes:
            shift = -0.28 if marker == "v" else 0.24
            axes.plot(
                t_s,
                lanes[vehicle] + shift,
                marker=marker,
                ms=6 * size,
                color=colour,
                mew=1.4 * size,
                zorder=4,
            )
    for vehicle, t_s, fate in course.fates:
        if vehicle in lanes and fate != "flying":
            style: dict[str, Any] = {"marker": "*", "ms": 16 * size, "color": colours[vehicle], "mec": _INK}
            if fate == "dead":
                style = {"marker": "o", "ms": 11 * size, "mfc": "none", "mec": _RED, "mew": 1.8}
            axes.plot(t_s, lanes[vehicle], zorder=6, **style)
    axes.set_ylim(len(lanes) - 0.4, -0.6)
    shown = list(lanes)[:: max(1, len(lanes) // _LABELLED)]
    axes.set_yticks([lanes[vehicle] for vehicle in shown], [str(vehicle) for vehicle in shown])
    _tidy(axes)
    axes.grid(visible=False, axis="y")
    _heading(axes, "agents: ▾ new route   | upload verified   ★ arrived   ✖ dead   ○ called dead")


def _colours(course: Course) -> dict[int, str]:
    """Colour of each agent; repeated in swarms."""
    vehicles = {*course.paths["agents"], *(v for v, _, _ in course.routes), *(v for v, _, _ in course.fates)}
    return {vehicle: _AGENTS[n % len(_AGENTS)] for n, vehicle in enumerate(sorted(vehicles))}


def _dots(axes: Axes, points_m: FloatArray, **style: Any) -> None:
    axes.scatter(points_m[:, 0], points_m[:, 1], **style)


def _size(course: Course) -> float:
    """Scale of lines and marks: large swarms are drawn finer."""
    return 1.0 if len(course.paths["agents"]) <= _LABELLED else 0.5


def _name(axes: Axes, text: str, at_m: FloatArray, among: Mapping[int, object], colour: str) -> None:
    if len(among) > _LABELLED:
        return
    axes.annotate(
        text, (float(at_m[0]), float(at_m[1])), xytext=(9, 7), textcoords="offset points", fontsize=11,
        fontweight="bold", color=colour, zorder=10,
        bbox={"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.75},
    )  # fmt: skip


def _heading(axes: Axes, text: str) -> None:
    axes.set_title(text, loc="left", fontsize=10, color=_INK, pad=4)


def _tidy(axes: Axes) -> None:
    axes.grid(visible=True, color=_GRID, lw=0.7)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=9, color="#a0aec0")
    for side, spine in axes.spines.items():
        spine.set_color("#a0aec0")
        spine.set_visible(side in ("left", "bottom"))
