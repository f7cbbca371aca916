"""Maps of a run in the style of the paper's figures: the ground truth, and the tracker output.

Ground truth: agents in colour, targets in grey-blue, red rings at the start, crosses at the end, obstacles
dark. Tracker output: a black circle for each estimate, grey triangles for clutter. Without ground truth,
tracks and telemetry are drawn instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.model import FloatArray, Label
from gcs.planning.map.grid import Grid
from gcs.planning.terrain.ground import Terrain
from gcs.report.plots.style import (
    AGENTS,
    AXIS,
    CLUTTER,
    INK,
    KINDS,
    LABELLED,
    RED,
    TARGETS,
    annotate,
    clear_names,
    colours,
    dots,
    heading,
    new_figure,
    sample,
    size_for,
    tidy,
)
from gcs.report.plots.terrain_shading import draw_terrain, terrain_entries
from gcs.report.run.timeline import Timeline, area_of
from gcs.report.telemetry.flights import Flight

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation

_MAX_CLUTTER = 5000
_MAX_OUTLINED = 3000
"""Number of estimates of a kind that are outlined."""
_MOST_POINTS = 1500
"""Greatest number of points of a line."""


@dataclass(frozen=True, slots=True)
class Ground:
    """Obstacles and terrain of a mission."""

    obstacles_m: FloatArray
    """(n, 2) east/north of the centres of blocked cells."""
    cell_m: float
    """Side of a cell."""
    terrain: Terrain | None = None
    """None: flat."""

    @classmethod
    def of(cls, grid: Grid, terrain: Terrain | None = None) -> Ground:
        """Return the obstacles of a map, and its terrain."""
        centres = [grid.point_of((int(row), int(column))) for row, column in np.argwhere(grid.blocked)]
        return cls(np.reshape(centres, (-1, 2)), grid.spacing_m, terrain)


def truth_figure(
    timeline: Timeline, ground: Ground | None, flights: Mapping[int, Flight], *, estimates: bool = True
) -> Figure:
    """Draw the ground truth with the tracks, at half time and at the end, side by side.

    Without ground truth: telemetry and tracks.
    """
    figure = new_figure(13.0, 6.9)
    times_s = (0.5 * timeline.duration_s, timeline.duration_s)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, until_s, name in zip(panels, times_s, ("half time", "end"), strict=True):
        _frame(axes, timeline, flights)
        heading(axes, f"{name}: {until_s:.0f} s")
        draw_ground(axes, ground)
        if timeline.has_truth:
            truth_until(axes, timeline, until_s)
        else:
            _reported_until(axes, timeline, flights, until_s)
        if estimates:
            draw_some_estimates(axes, timeline, until_s)
    panels[1].set_ylabel("")
    known = legend_entries(timeline, ground, estimates=estimates)
    _legend(figure, known if timeline.has_truth else _report_entries(timeline, flights, ground))
    return figure


def tracker_figure(timeline: Timeline, ground: Ground | None) -> Figure:
    """Draw every estimate of both trackers, and the clutter."""
    figure = new_figure(9.4, 8.6)
    axes = figure.add_subplot()
    _frame(axes, timeline, {})
    draw_ground(axes, ground, alpha=0.35)
    every = draw_clutter(axes, timeline)
    size = size_for(_agent_count(timeline))
    entries = []
    for kind, scans in timeline.estimates.items():
        points = np.concatenate([np.empty((0, 2)), *(estimate.points_m for estimate in scans)])
        many = len(points) > _MAX_OUTLINED  # A raster keeps the page small.
        edge = KINDS[kind] if many else INK
        options: dict[str, Any] = {"facecolors": KINDS[kind] + "55", "edgecolors": edge, "rasterized": many}
        area = (24 if kind == "agents" else 12) * size**2  # Targets are slow: their circles overlap.
        dots(axes, points, s=area, linewidths=0.6 * size, zorder=4, **options)
        entries.append(
            sample(f"{kind}: {len(points)} estimates", marker="o", ms=6, mfc=KINDS[kind] + "55", mec=INK)
        )
    word = "clutter" if timeline.has_truth else "detections"
    share = "" if every == 1 else f", one of {every} shown"
    entries.append(sample(f"{word}{share}", marker="^", ms=6, color=CLUTTER, alpha=0.6, mew=0))
    _legend(figure, entries + _ground_entries(ground))
    return figure


def _agent_count(timeline: Timeline) -> int:
    """Return the number of agents, to choose sizes."""
    seen = max((len(estimate.points_m) for estimate in timeline.estimates["agents"]), default=0)
    return max(len(timeline.paths["agents"]), seen)


def draw_clutter(axes: Axes, timeline: Timeline) -> int:
    """Draw the clutter in grey; return the number of detections per mark."""
    some = max(1, -(-len(timeline.clutter_m) // _MAX_CLUTTER))
    options: dict[str, Any] = {"marker": "^", "s": 14, "color": CLUTTER, "alpha": 0.3, "linewidths": 0}
    dots(axes, timeline.clutter_m[::some], zorder=2, rasterized=True, **options)
    return some * timeline.every


def truth_until(axes: Axes, timeline: Timeline, until_s: float) -> None:
    """Draw the true paths up to a time, with starts, ends and losses."""
    size = size_for(len(timeline.paths["agents"]))
    agent_colours = colours(timeline.paths["agents"])
    ends: list[FloatArray] = []
    names: list[Annotation] = []
    paths_m: list[FloatArray] = []
    for kind, paths in reversed(timeline.paths.items()):  # Agents last, on top.
        shown = {n: path.until(until_s) for n, path in paths.items()}
        shown = {n: path for n, path in shown.items() if len(path.t_s)}
        for number, path in shown.items():
            colour = agent_colours[number] if kind == "agents" else TARGETS
            width = (2.3 if kind == "agents" else 1.6) * size
            axes.plot(*_thin(path.points_m).T, color=colour, lw=width, zorder=5, solid_capstyle="round")
            text = str(number) if kind == "agents" else f"target {number}"
            if len(shown) <= LABELLED:
                names.append(annotate(axes, text, path.points_m[0 if kind == "agents" else -1], colour))
            paths_m.append(_thin(path.points_m))
        starts = np.reshape([path.points_m[0] for path in shown.values()], (-1, 2))
        dots(axes, starts, s=58 * size**2, facecolors="none", edgecolors=RED, linewidths=1.9 * size, zorder=8)
        ends += [path.points_m[-1] for path in shown.values() if not path.is_lost]
        losses = np.reshape([path.points_m[-1] for path in shown.values() if path.is_lost], (-1, 2))
        dots(axes, losses, marker="X", s=140 * size, color=INK, edgecolors="white", linewidths=1.2, zorder=9)
    clear_names(axes, names, paths_m)
    end_points = np.reshape(ends, (-1, 2))
    dots(axes, end_points, marker="x", s=60 * size**2, color=RED, linewidths=2.2 * size, zorder=8)


def draw_some_estimates(axes: Axes, timeline: Timeline, until_s: float) -> None:
    """Draw a thinned set of estimates."""
    size = size_for(_agent_count(timeline))
    for kind, scans in timeline.estimates.items():
        if not timeline.has_truth and kind == "agents":
            continue  # Drawn as lines.
        some = scans[:: max(1, len(scans) // (36 if kind == "agents" else 16))]
        few = np.concatenate([np.empty((0, 2)), *(e.points_m for e in some if e.t_s <= until_s)])
        dots(
            axes, few, s=13 * size**2, facecolors="white", edgecolors="black", linewidths=0.7 * size, zorder=6
        )


def _reported_until(axes: Axes, timeline: Timeline, flights: Mapping[int, Flight], until_s: float) -> None:
    size = size_for(len(flights))
    flown = colours(flights)
    for vehicle, flight in flights.items():
        points = flight.points_m[flight.t_s <= until_s]
        if len(points):
            axes.plot(*_thin(points).T, color=flown[vehicle], lw=2.0 * size, zorder=4)
            if len(flights) <= LABELLED:
                annotate(axes, str(vehicle), points[0], flown[vehicle])
            dots(
                axes, points[:1], s=58 * size**2, facecolors="none", edgecolors=RED, linewidths=1.9, zorder=8
            )
            dots(axes, points[-1:], marker="x", s=60 * size**2, color=RED, linewidths=2.2 * size, zorder=8)
    for path in _agent_lines(timeline, until_s).values():
        axes.plot(*_thin(path).T, color=INK, lw=0.9 * size, zorder=6)


def _agent_lines(timeline: Timeline, until_s: float) -> dict[Label, FloatArray]:
    """Return (n, 2) positions of each agent track with at least two estimates."""
    found: dict[Label, list[FloatArray]] = {}
    for estimate in timeline.estimates["agents"]:
        if estimate.t_s <= until_s:
            for label, point in zip(estimate.labels, estimate.points_m, strict=True):
                found.setdefault(label, []).append(point)
    return {label: np.array(points) for label, points in sorted(found.items()) if len(points) > 1}


def _thin(points_m: FloatArray) -> FloatArray:
    """Return a line with at most the visible number of points, including its ends."""
    step = -(-len(points_m) // _MOST_POINTS)
    return points_m if step <= 1 else np.vstack([points_m[:-1:step], points_m[-1:]])


def draw_ground(axes: Axes, ground: Ground | None, alpha: float = 1.0) -> None:
    """Draw terrain, and blocked cells as squares."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    if ground is None:
        return
    draw_terrain(axes, ground.terrain)
    if not len(ground.obstacles_m):
        return
    side = ground.cell_m
    cells = [Rectangle((x - side / 2.0, y - side / 2.0), side, side) for x, y in ground.obstacles_m]
    width = 0.3 if alpha == 1.0 else 0.0
    axes.add_collection(
        PatchCollection(cells, zorder=1, facecolor=INK, edgecolor=INK, linewidth=width, alpha=alpha)
    )


def _frame(axes: Axes, timeline: Timeline, flights: Mapping[int, Flight]) -> None:
    corners = (
        [timeline.area_m] if timeline.estimates["agents"] or timeline.has_truth or timeline.sensors else []
    )
    places = [] if timeline.has_truth else [flight.points_m for flight in flights.values()]
    west, south, east, north = area_of([*places, *corners])
    half = 0.52 * max(east - west, north - south) + 10.0  # A square.
    axes.set(xlim=(0.5 * (west + east) - half, 0.5 * (west + east) + half))
    axes.set(ylim=(0.5 * (south + north) - half, 0.5 * (south + north) + half))
    axes.set(xlabel="east, m", ylabel="north, m", aspect="equal")
    tidy(axes)


def legend_entries(
    timeline: Timeline, ground: Ground | None, *, estimates: bool = True, everything: bool = False
) -> list[Artist]:
    """Return the legend of a map of the ground truth; `everything` adds routes and clutter."""
    entries = [
        sample("agent", ls="-", lw=2.4, color=AGENTS[0]),
        sample("target", ls="-", lw=1.6, color=TARGETS),
        sample("start", marker="o", ms=7, mfc="none", mec=RED, mew=2),
        sample("end" if everything else "position then", marker="x", ms=7, mew=2, color=RED),
    ]
    if any(path.is_lost for path in timeline.paths["agents"].values()):
        entries.append(sample("loss", marker="X", ms=10, color=INK, mec="white"))
    if estimates:
        entries.append(sample("estimate", marker="o", ms=4, mfc="white", mew=0.8, mec="black"))
    if everything:
        entries.append(sample("planned route", ls=(0, (4, 3)), lw=0.8, color=AGENTS[0]))
        entries.append(sample("clutter", marker="^", ms=5, color=CLUTTER, alpha=0.5, mew=0))
    return entries + _ground_entries(ground)


def _report_entries(timeline: Timeline, flights: Mapping[int, Flight], ground: Ground | None) -> list[Artist]:
    entries = []
    if flights:
        entries = [
            sample("reported by a vehicle", ls="-", lw=2.4, color=AGENTS[0]),
            sample("first report", marker="o", ms=7, mfc="none", mec=RED, mew=2),
            sample("position then", marker="x", ms=7, mew=2, color=RED),
        ]
    if timeline.estimates["agents"]:
        entries.append(sample("track of an agent", ls="-", lw=1.0))
    if any(len(estimate.points_m) for estimate in timeline.estimates["targets"]):
        entries.append(sample("estimate of a target", marker="o", ms=4, mfc="white", mew=0.8, mec="black"))
    return entries + _ground_entries(ground)


def _ground_entries(ground: Ground | None) -> list[Artist]:
    if ground is None:
        return []
    return [sample("obstacle", marker="s", ms=7, color=INK, mec=AXIS), *terrain_entries(ground.terrain)]


def _legend(figure: Figure, entries: list[Artist]) -> None:
    figure.legend(
        handles=entries, loc="outside lower center", ncol=min(8, max(1, len(entries))), frameon=False,
        fontsize=9, handletextpad=0.5, columnspacing=1.4,
    )  # fmt: skip
