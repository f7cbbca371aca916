"""Terrain in figures: hill shading with contours below maps, and heights over distance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from gcs.model import FloatArray
from gcs.planning.terrain.ground import Terrain
from gcs.report.plots.style import AXIS, GRID, sample, tidy

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_MAX_NODES: Final = 60_000
"""Of a picture; it is in the page."""
_SUN_DEG: Final = (315.0, 45.0)
"""Azimuth and height of the light."""
_FLAT: Final = math.sin(math.radians(_SUN_DEG[1]))
_DARKEST: Final = 0.5
_BRIGHTEST: Final = 0.35
"""Opacity of the darkest and of the brightest slopes, which are drawn in black and in white."""
_CONTOURS: Final = 20
"""Greatest number of contours."""
_SAMPLES: Final = 300
BAND: Final = "#009e73"
GROUND: Final = "#a08468"


def contour_step_m(terrain: Terrain) -> float:
    """Return the height from one contour to the next: 1, 2 or 5 times a power of ten."""
    least_m = max(1.0, float(np.ptp(terrain.elevation.heights_msl_m)) / _CONTOURS)
    power_m = 10.0 ** math.floor(math.log10(least_m))
    return next(count * power_m for count in (1, 2, 5, 10) if count * power_m >= least_m)


def terrain_entries(terrain: Terrain | None) -> list[Artist]:
    """Return the entries of a legend for the terrain of a map."""
    if terrain is None:
        return []
    return [sample(f"contours every {contour_step_m(terrain):g} m", ls="-", lw=0.8, color=AXIS)]


def draw_terrain(axes: Axes, terrain: Terrain | None, zorder: float = 0.4) -> None:
    """Draw hill shading and contours; the limits of the axes stay."""
    from matplotlib.colors import LightSource

    if terrain is None:
        return
    ground = terrain.elevation.coarser(_MAX_NODES)
    heights_msl_m = ground.heights_msl_m
    spacing_m = ground.spacing_m
    west_m, south_m = ground.origin_m
    light = LightSource(*_SUN_DEG)
    # Rows count north here, and south there.
    shade = light.hillshade(heights_msl_m, dx=spacing_m, dy=-spacing_m, fraction=1.0) - _FLAT
    opacity = np.where(shade < 0.0, -_DARKEST * shade / _FLAT, _BRIGHTEST * shade / (1.0 - _FLAT))
    tone = np.where(shade < 0.0, 0.0, 1.0)
    picture = np.dstack((tone, tone, tone, np.clip(opacity, 0.0, 1.0)))
    rows, cols = heights_msl_m.shape
    half_m = spacing_m / 2.0
    east_m = west_m + spacing_m * np.arange(cols)
    north_m = south_m + spacing_m * np.arange(rows)
    step_m = contour_step_m(terrain)
    levels = step_m * np.arange(math.ceil(heights_msl_m.min() / step_m), heights_msl_m.max() // step_m + 1)
    limits = (axes.get_xlim(), axes.get_ylim())
    axes.imshow(
        picture,
        origin="lower",
        extent=(west_m - half_m, east_m[-1] + half_m, south_m - half_m, north_m[-1] + half_m),
        interpolation="bilinear",
        zorder=zorder,
    )
    axes.contour(
        east_m,
        north_m,
        heights_msl_m,
        levels=levels,
        colors=AXIS,
        linewidths=0.5,
        alpha=0.8,
        zorder=zorder + 0.2,
    )
    axes.set(xlim=limits[0], ylim=limits[1])


def draw_profile(
    axes: Axes, terrain: Terrain, points_m: FloatArray, heights_msl_m: FloatArray, colour: str
) -> None:
    """Draw heights along a route over ground and flight band.

    Parameters
    ----------
    points_m : ndarray, shape (k, 2)
        East and north of the points of the route.
    heights_msl_m : ndarray, shape (k,)
        Above mean sea level.
    """
    along_m = np.append(0.0, np.hypot(*np.diff(points_m, axis=0).T).cumsum())
    at_m = np.linspace(0.0, along_m[-1], _SAMPLES)
    places_m = np.column_stack([np.interp(at_m, along_m, points_m[:, axis]) for axis in (0, 1)])
    ground_m = terrain.elevation.heights_at(places_m)
    floor_m = ground_m + terrain.min_agl_m
    ceiling_m = ground_m + terrain.max_agl_m
    tidy(axes)
    lowest_m = float(np.nanmin(ground_m))
    highest_m = float(max(np.nanmax(ceiling_m), np.nanmax(heights_msl_m)))
    margin_m = 0.06 * (highest_m - lowest_m)
    axes.set(xlim=(0.0, along_m[-1]), ylim=(lowest_m - margin_m, highest_m + margin_m))
    axes.fill_between(at_m, ground_m, lowest_m - margin_m, color=GROUND, lw=0.0, zorder=2)
    axes.fill_between(at_m, floor_m, ceiling_m, color=BAND, alpha=0.18, lw=0.0, zorder=2)
    axes.plot(at_m, floor_m, color=BAND, lw=0.8, zorder=3)
    axes.plot(at_m, ceiling_m, color=BAND, lw=0.8, ls=(0, (4, 2)), zorder=3)
    axes.plot(along_m, heights_msl_m, color=colour, lw=1.6, marker="o", ms=2.5, mfc="white", zorder=4)
    axes.grid(visible=True, color=GRID, lw=0.7)
