"""Figure of a plan: the map with the clearance around its obstacles, the routes, and their heights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.model import FloatArray
from gcs.planning.forward_simulation import LoiterCircle
from gcs.planning.map.grid import Grid, Point
from gcs.planning.terrain.ground import Terrain
from gcs.report.plots.style import AGENTS, AXIS, INK, RED, annotate, heading, legend_below, sample
from gcs.report.plots.terrain_shading import draw_profile, draw_terrain, terrain_entries

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BLOCKED = "#2d3748"
_NEAR = "#e2e8f0"
_FREE = "#ffffff"
_NAMED = 30
"""Up to this many agents or targets are named."""
_WIDTH_IN = 9.0
_TALLEST = 2.0
_PROFILE_IN = 1.6
_PROFILES = 8
"""Greatest number of routes whose heights are drawn."""


@dataclass(frozen=True, slots=True)
class PlanDrawing:
    """Input of the figure. Positions in metres."""

    title: str
    grid: Grid
    inflated: Grid
    """The grid with the clearance around obstacles blocked too."""
    starts: Mapping[int, Point]
    targets: Mapping[str, Point]
    """Positions by name."""
    routes: Mapping[int, Sequence[Sequence[float]]]
    """Points by agent, the start first."""
    circles: Mapping[int, LoiterCircle] = field(default_factory=dict)
    """Loiter circles at the ends of the routes."""
    homes: Mapping[int, Sequence[Sequence[float]]] = field(default_factory=dict)
    """Return routes by agent, from the ends of the routes."""
    terrain: Terrain | None = None
    """None: flat."""
    heights_msl_m: Mapping[int, FloatArray] = field(default_factory=dict)
    """Heights of the points by agent, over terrain."""


def draw_plan(drawing: PlanDrawing, path: Path) -> None:
    """Draw to a file whose suffix gives the format.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows, cols = drawing.grid.shape
    height_in = _WIDTH_IN * min(max(rows / cols, 0.4), _TALLEST)
    profiled = [] if drawing.terrain is None else sorted(drawing.heights_msl_m)[:_PROFILES]
    below_in = _PROFILE_IN * len(profiled)
    figure = Figure(
        figsize=(_WIDTH_IN, height_in + 0.9 + below_in), dpi=130, facecolor="white", layout="constrained"
    )
    FigureCanvasAgg(figure)
    axes, *below = figure.subplots(
        1 + len(profiled),
        1,
        squeeze=False,
        gridspec_kw={"height_ratios": [height_in + 0.9, *[_PROFILE_IN] * len(profiled)]},
    )[:, 0]
    axes.set_title(drawing.title, loc="left", fontsize=12, fontweight="bold", color=INK)
    _draw_map(axes, drawing)
    few = max(len(drawing.starts), len(drawing.targets)) <= _NAMED
    size = 1.0 if few else 0.6
    for order, (agent, points) in enumerate(sorted(drawing.routes.items())):
        colour = AGENTS[order % len(AGENTS)]
        line = np.array(points)
        axes.plot(*line.T, color=colour, lw=2.0 * size, solid_joinstyle="round", zorder=3)
        axes.plot(*line[1:-1].T, ls="none", marker="o", ms=3.5 * size, mfc="white", mec=colour, zorder=4)
        if agent in drawing.circles:
            axes.plot(
                *_circle_points(drawing.circles[agent]).T, color=colour, lw=1.2 * size, ls="--", zorder=3
            )
        if agent in drawing.homes:
            home = np.array(drawing.homes[agent])
            axes.plot(*home.T, color=colour, lw=1.4 * size, ls=(0, (4, 1.5)), zorder=3)
            axes.plot(*home[1:-1].T, ls="none", marker="o", ms=2.5 * size, mfc="white", mec=colour, zorder=4)
        if few:
            annotate(axes, str(agent), line[0], colour)
    for agent, place in drawing.starts.items():
        if few and agent not in drawing.routes:
            annotate(axes, str(agent), place, INK)
    starts, targets = (np.reshape(list(p.values()), (-1, 2)) for p in (drawing.starts, drawing.targets))
    style: dict[str, Any] = {"zorder": 5, "linewidths": 2.0 * size, "s": 70 * size}
    axes.scatter(starts[:, 0], starts[:, 1], facecolors="white", edgecolors=RED, **style)
    axes.scatter(targets[:, 0], targets[:, 1], marker="x", color=INK, **style)
    if few:
        for name, place in drawing.targets.items():
            annotate(axes, name, place, INK)
    _draw_legend(axes, drawing)
    _draw_profiles(below, drawing, profiled)
    figure.savefig(path)


def _draw_profiles(rows: Sequence[Axes], drawing: PlanDrawing, agents: Sequence[int]) -> None:
    """Draw the heights of routes over ground and flight band, one below the other."""
    order = sorted(drawing.routes)
    for axes, agent in zip(rows, agents, strict=True):
        assert drawing.terrain is not None
        colour = AGENTS[order.index(agent) % len(AGENTS)]
        points_m = np.array(drawing.routes[agent])
        draw_profile(axes, drawing.terrain, points_m, drawing.heights_msl_m[agent], colour)
        heading(axes, f"agent {agent}: height above sea level, m")
    if len(rows):
        rows[-1].set_xlabel("distance along the route, m")


def _circle_points(circle: LoiterCircle) -> FloatArray:
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    return circle.centre_m + circle.radius_m * np.column_stack((np.sin(angle), np.cos(angle)))


def _draw_map(axes: Axes, drawing: PlanDrawing) -> None:
    from matplotlib.colors import ListedColormap

    grid = drawing.grid
    rows, cols = grid.shape
    half = grid.spacing_m / 2.0
    west, south = grid.point_of((0, 0))
    east, north = grid.point_of((rows - 1, cols - 1))
    shade = np.where(grid.blocked, 2, np.where(drawing.inflated.blocked, 1, 0))
    axes.imshow(
        shade,
        cmap=ListedColormap([_FREE, _NEAR, _BLOCKED]),
        vmin=0,
        vmax=2,
        origin="lower",
        extent=(west - half, east + half, south - half, north + half),
        interpolation="nearest" if max(rows, cols) <= 1000 else "antialiased",
        zorder=1,
    )
    draw_terrain(axes, drawing.terrain, zorder=1.2)
    axes.set(xlabel="east, m", ylabel="north, m")
    axes.tick_params(labelsize=9, color=AXIS)
    for spine in axes.spines.values():
        spine.set_color(AXIS)


def _draw_legend(axes: Axes, drawing: PlanDrawing) -> None:
    entries = [
        sample("agent", marker="o", ms=8, mfc="white", mec=RED, mew=2),
        sample("target", marker="x", ms=8, mew=2),
        sample("route, corners", ls="-", lw=2, color=AGENTS[0], marker="o", ms=4, mfc="white"),
        sample("obstacle", marker="s", ms=8, color=_BLOCKED),
    ]
    if drawing.circles:
        entries.append(sample("loiter circle", ls="--", lw=1.2, color=AGENTS[0]))
    if drawing.homes:
        entries.append(sample("return route", ls=(0, (4, 1.5)), lw=1.4, color=AGENTS[0]))
    if (drawing.inflated.blocked & ~drawing.grid.blocked).any():
        entries.append(sample("nearer than the clearance", marker="s", ms=8, color=_NEAR))
    entries += terrain_entries(drawing.terrain)
    legend_below(axes, entries, 0.07)
