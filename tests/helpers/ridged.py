"""Ground with a ridge across it, as the table of a mission file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gcs.terrain.elevation_grid import Elevation
from gcs.terrain.elevation_text import ElevationModel, encode_model

RIDGE_EAST_M = 1000.0
RIDGE_M = 150.0
VALLEY_MSL_M = 100.0


def ground(
    height: Callable[[np.ndarray, np.ndarray], np.ndarray], size_m: float = 2400.0, spacing_m: float = 20.0
) -> Elevation:
    """Return ground of a square map, with a margin, whose height is a function of east and north."""
    at = np.arange(-200.0, size_m + spacing_m, spacing_m)
    return Elevation((-200.0, -200.0), spacing_m, height(*np.meshgrid(at, at)))


def ridge() -> Elevation:
    """Return a valley at 100 m with a ridge of 150 m, 200 m wide, from south to north at east 1000 m."""
    return ground(
        lambda east, _: VALLEY_MSL_M + RIDGE_M * np.clip(1.0 - np.abs(east - RIDGE_EAST_M) / 100.0, 0.0, 1.0)
    )


def terrain_table(elevation: Elevation, min_agl_m: float = 50.0, max_agl_m: float = 120.0) -> str:
    """Return the `[terrain]` table of a mission file over this ground."""
    text = encode_model(ElevationModel("ridged", elevation.spacing_m, elevation))
    return f"[terrain]\nfile = '{text}'\nmin_agl_m = {min_agl_m}\nmax_agl_m = {max_agl_m}\n"
