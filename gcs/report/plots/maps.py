"""Maps of a run in the manner of the paper's figures: the ground truth, and what the trackers said.

Truth: agents in colour, targets in grey-blue, red rings where they start, crosses where they are at the end
of what is shown, obstacles dark. Tracker output: black-outlined circles for each estimate of every scan, grey
triangles for clutter. Where nobody knows the truth, tracks and the vehicles' own reports take its place.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.model import FloatArray, Kind, Label
from gcs.planning.map.grid import Grid
from gcs.report.plots.style import (
    AGENTS,
    AXIS,
    CLUTTER,
    INK,
    KINDS,
    LABELLED,
    RED,
    TARGETS,
    colours,
    dots,
    heading,
    new_figure,
    size_for,
    tidy,
)
from gcs.report.run.timeline import Timeline, area_of
from gcs.report.telemetry.flights import Flight

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_CLUTTER = 5000
_MAX_OUTLINED = 3000
"""Estimates of a kind that are drawn one by one."""
_MOST_POINTS = 1500
"""Of one line; more cannot be seen."""


@dataclass(frozen=True, slots=True)
class Ground:
    """The obstacles of a mission."""

    obstacles_m: FloatArray
    """(n, 2) east/north of the centres of blocked cells."""
    cell_m: float
    """Side of a cell."""

    @classmethod
    def of(cls, grid: Grid) -> Ground:
        """Return the obstacles of a map."""
        centres = [grid.point_of((int(row), int(column))) for row, column in np.argwhere(grid.blocked)]
        return cls(np.reshape(centres, (-1, 2)), grid.spacing_m)


def truth_figure(
    course: Timeline, ground: Ground | None, flights: Mapping[int, Flight], *, estimates: bool = True
) -> Figure:
    """Draw what truly happened, with the tracks over it, at half time and at the end, side by side.

    Without truth: what the vehicles reported, and the tracks.
    """
    figure = new_figure(13.0, 6.9)
    middle_s = 0.5 * course.duration_s
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, until_s, name in zip(panels, (middle_s, course.duration_s), ("mid", "end"), strict=True):
        _frame(axes, course, flights)
        heading(axes, f"{name}: {until_s:.0f} s")
        _obstacles(axes, ground)
        if course.has_truth:
            truth_until(axes, course, until_s)
        else:
            _reported_until(axes, course, flights, until_s)
        if estimates:
            draw_some_estimates(axes, course, until_s)
    panels[1].set_ylabel("")
    known = legend_entries(course, obstacles=ground is not None, estimates=estimates)
    _legend(figure, known if course.has_truth else _report_entries(course, flights, ground))
    return figure


def ground_truth_figure(course: Timeline, ground: Ground | None, until_s: float) -> Figure:
    """Draw the truth alone up to a time, as the paper's figures of the ground truth do."""
    figure = new_figure(7.2, 7.4)
    axes = figure.add_subplot()
    _frame(axes, course, {})
    _obstacles(axes, ground)
    truth_until(axes, course, until_s)
    heading(axes, f"ground truth until {until_s:.0f} s")
    entries = legend_entries(course, obstacles=ground is not None, estimates=False)
    _legend(figure, entries, columns=6)
    return figure


def tracker_figure(course: Timeline, ground: Ground | None) -> Figure:
    """Draw every estimate of both trackers, and the clutter that they had to live with."""
    figure = new_figure(9.4, 8.6)
    axes = figure.add_subplot()
    _frame(axes, course, {})
    _obstacles(axes, ground, alpha=0.35)
    every = draw_clutter(axes, course)
    size = size_for(most_shown(course))
    entries = []
    for kind, scans in course.estimates.items():
        points = np.concatenate([np.empty((0, 2)), *(estimate.points_m for estimate in scans)])
        many = len(points) > _MAX_OUTLINED  # a raster has no ink of the page's, and keeps the page small
        edge = KINDS[kind] if many else INK
        look: dict[str, Any] = {"facecolors": KINDS[kind] + "55", "edgecolors": edge, "rasterized": many}
        area = (24 if kind == "agents" else 12) * size**2  # targets are slow: their circles overlap
        dots(axes, points, s=area, linewidths=0.6 * size, zorder=4, **look)
        entries.append(
            _sample(f"{kind}: {len(points)} estimates", marker="o", ms=6, mfc=KINDS[kind] + "55", mec=INK)
        )
    word = "clutter" if course.has_truth else "detections"
    share = "" if every == 1 else f", one of {every} shown"
    entries.append(_sample(f"{word}{share}", marker="^", ms=6, color=CLUTTER, alpha=0.6, mew=0))
    _legend(figure, entries + _ground_entries(ground is not None))
    return figure


def most_shown(course: Timeline) -> int:
    """How many agents there are, to choose sizes by."""
    seen = max((len(estimate.points_m) for estimate in course.estimates["agents"]), default=0)
    return max(len(course.paths["agents"]), seen)


def draw_clutter(axes: Axes, course: Timeline) -> int:
    """Draw the clutter in grey; return of how many detections each one stands for."""
    some = max(1, -(-len(course.clutter_m) // _MAX_CLUTTER))
    look: dict[str, Any] = {"marker": "^", "s": 14, "color": CLUTTER, "alpha": 0.3, "linewidths": 0}
    dots(axes, course.clutter_m[::some], zorder=2, rasterized=True, **look)
    return some * course.every


def truth_until(axes: Axes, course: Timeline, until_s: float) -> None:
    """Draw the true paths up to a time, with their starts, ends and deaths."""
    size = size_for(len(course.paths["agents"]))
    agent_colours = colours(course.paths["agents"])
    ends: list[FloatArray] = []
    for kind, paths in reversed(course.paths.items()):  # agents last, above all
        shown = {n: path.until(until_s) for n, path in paths.items()}
        shown = {n: path for n, path in shown.items() if len(path.t_s)}
        for number, path in shown.items():
            colour = agent_colours[number] if kind == "agents" else TARGETS
            width = (2.3 if kind == "agents" else 1.6) * size
            axes.plot(*thin(path.points_m).T, color=colour, lw=width, zorder=5, solid_capstyle="round")
            text = str(number) if kind == "agents" else f"target {number}"
            name(axes, text, path.points_m[0 if kind == "agents" else -1], shown, colour)
        starts = np.reshape([path.points_m[0] for path in shown.values()], (-1, 2))
        dots(axes, starts, s=58 * size**2, facecolors="none", edgecolors=RED, linewidths=1.9 * size, zorder=8)
        ends += [path.points_m[-1] for path in shown.values() if not path.dies]
        deaths = np.reshape([path.points_m[-1] for path in shown.values() if path.dies], (-1, 2))
        dots(axes, deaths, marker="X", s=140 * size, color=INK, edgecolors="white", linewidths=1.2, zorder=9)
    dots(
        axes,
        np.reshape(ends, (-1, 2)),
        marker="x",
        s=60 * size**2,
        color=RED,
        linewidths=2.2 * size,
        zorder=8,
    )


def draw_some_estimates(axes: Axes, course: Timeline, until_s: float) -> None:
    """Draw what the trackers made of it, thinned so that what is below stays visible."""
    size = size_for(most_shown(course))
    for kind, scans in course.estimates.items():
        if not course.has_truth and kind == "agents":
            continue  # drawn as lines
        some = scans[:: max(1, len(scans) // (36 if kind == "agents" else 16))]
        few = np.concatenate([np.empty((0, 2)), *(e.points_m for e in some if e.t_s <= until_s)])
        dots(
            axes, few, s=13 * size**2, facecolors="white", edgecolors="black", linewidths=0.7 * size, zorder=6
        )


def _reported_until(axes: Axes, course: Timeline, flights: Mapping[int, Flight], until_s: float) -> None:
    size = size_for(len(flights))
    flown = colours(flights)
    for vehicle, flight in flights.items():
        points = flight.points_m[flight.t_s <= until_s]
        if len(points):
            axes.plot(*thin(points).T, color=flown[vehicle], lw=2.0 * size, zorder=4)
            name(axes, str(vehicle), points[0], flights, flown[vehicle])
            dots(
                axes, points[:1], s=58 * size**2, facecolors="none", edgecolors=RED, linewidths=1.9, zorder=8
            )
            dots(axes, points[-1:], marker="x", s=60 * size**2, color=RED, linewidths=2.2 * size, zorder=8)
    for path in track_lines(course, "agents", until_s).values():
        axes.plot(*thin(path).T, color=INK, lw=0.9 * size, zorder=6)


def track_lines(course: Timeline, kind: Kind, until_s: float) -> dict[Label, FloatArray]:
    """Return (n, 2) places of each label that was in the estimate at least twice."""
    found: dict[Label, list[FloatArray]] = {}
    for estimate in course.estimates[kind]:
        if estimate.t_s <= until_s:
            for label, point in zip(estimate.labels, estimate.points_m, strict=True):
                found.setdefault(label, []).append(point)
    return {label: np.array(points) for label, points in sorted(found.items()) if len(points) > 1}


def thin(points_m: FloatArray) -> FloatArray:
    """Return a line with no more points than can be seen, its ends among them."""
    step = -(-len(points_m) // _MOST_POINTS)
    return points_m if step <= 1 else np.vstack([points_m[:-1:step], points_m[-1:]])


def name(axes: Axes, text: str, at_m: FloatArray, among: Mapping[Any, object], colour: str) -> None:
    """Write the name of an object beside it; not in a crowd."""
    if len(among) > LABELLED:
        return
    axes.annotate(
        text, (float(at_m[0]), float(at_m[1])), xytext=(9, 7), textcoords="offset points", fontsize=11,
        fontweight="bold", color=colour, zorder=10,
        bbox={"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.75},
    )  # fmt: skip


def draw_obstacles(axes: Axes, obstacles_m: FloatArray, cell_m: float, alpha: float = 1.0) -> None:
    """Draw blocked cells as the squares that they are."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    half = cell_m / 2.0
    cells = [Rectangle((x - half, y - half), cell_m, cell_m) for x, y in obstacles_m]
    look: dict[str, Any] = {
        "facecolor": INK,
        "edgecolor": INK,
        "linewidth": 0.3 if alpha == 1.0 else 0.0,
        "alpha": alpha,
    }
    axes.add_collection(PatchCollection(cells, zorder=1, **look))


def _obstacles(axes: Axes, ground: Ground | None, alpha: float = 1.0) -> None:
    if ground is not None and len(ground.obstacles_m):
        draw_obstacles(axes, ground.obstacles_m, ground.cell_m, alpha)


def _frame(axes: Axes, course: Timeline, flights: Mapping[int, Flight]) -> None:
    corners = [course.area_m] if course.estimates["agents"] or course.has_truth or course.sensors else []
    places = [] if course.has_truth else [flight.points_m for flight in flights.values()]
    west, south, east, north = area_of([*places, *corners])
    half = 0.52 * max(east - west, north - south) + 10.0  # a square, whatever was flown
    axes.set(xlim=(0.5 * (west + east) - half, 0.5 * (west + east) + half))
    axes.set(ylim=(0.5 * (south + north) - half, 0.5 * (south + north) + half))
    axes.set(xlabel="east, m", ylabel="north, m", aspect="equal")
    tidy(axes)


def _sample(label: str, **style: Any) -> Artist:
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **{"ls": "none", "color": INK, **style})


def legend_entries(
    course: Timeline, *, obstacles: bool, estimates: bool = True, everything: bool = False
) -> list[Artist]:
    """Return samples of what a map of the truth shows; `everything` adds routes and clutter."""
    entries = [
        _sample("agent", ls="-", lw=2.4, color=AGENTS[0]),
        _sample("target", ls="-", lw=1.6, color=TARGETS),
        _sample("start", marker="o", ms=7, mfc="none", mec=RED, mew=2),
        _sample("end" if everything else "position then", marker="x", ms=7, mew=2, color=RED),
    ]
    if any(path.dies for path in course.paths["agents"].values()):
        entries.append(_sample("death", marker="X", ms=10, color=INK, mec="white"))
    if estimates:
        entries.append(_sample("estimate", marker="o", ms=4, mfc="white", mew=0.8, mec="black"))
    if everything:
        entries.append(_sample("planned route", ls=(0, (4, 3)), lw=0.8, color=AGENTS[0]))
        entries.append(_sample("clutter", marker="^", ms=5, color=CLUTTER, alpha=0.5, mew=0))
    return entries + _ground_entries(obstacles)


def _report_entries(course: Timeline, flights: Mapping[int, Flight], ground: Ground | None) -> list[Artist]:
    entries = []
    if flights:
        entries = [
            _sample("reported by a vehicle", ls="-", lw=2.4, color=AGENTS[0]),
            _sample("first report", marker="o", ms=7, mfc="none", mec=RED, mew=2),
            _sample("position then", marker="x", ms=7, mew=2, color=RED),
        ]
    if course.estimates["agents"]:
        entries.append(_sample("track of an agent", ls="-", lw=1.0))
    if any(len(estimate.points_m) for estimate in course.estimates["targets"]):
        entries.append(_sample("estimate of a target", marker="o", ms=4, mfc="white", mew=0.8, mec="black"))
    return entries + _ground_entries(ground is not None)


def _ground_entries(obstacles: bool) -> list[Artist]:
    return [_sample("obstacle", marker="s", ms=7, color=INK, mec=AXIS)] if obstacles else []


def _legend(figure: Figure, entries: list[Artist], columns: int = 8) -> None:
    figure.legend(
        handles=entries, loc="outside lower center", ncol=min(columns, max(1, len(entries))), frameon=False,
        fontsize=9, handletextpad=0.5, columnspacing=1.4,
    )  # fmt: skip
