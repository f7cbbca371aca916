"""Tables of a mission file for ground with hills, made in memory."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gcs.model import FloatArray
from gcs.terrain.elevation_grid import Elevation
from gcs.terrain.elevation_text import ElevationModel, encode_model

Ground = Callable[[FloatArray, FloatArray], FloatArray]
"""Height above mean sea level by east and north."""


def elevation_of(
    ground: Ground, size_m: float, spacing_m: float = 20.0, margin_m: float = 500.0
) -> Elevation:
    """Return the elevation of a square map from the origin on, with a margin."""
    at = np.arange(-margin_m, size_m + margin_m + spacing_m, spacing_m)
    east, north = np.meshgrid(at, at)
    return Elevation((-margin_m, -margin_m), spacing_m, ground(east, north))


def terrain_table(elevation: Elevation, min_agl_m: float = 50.0, max_agl_m: float = 120.0) -> str:
    """Return the table `[terrain]` of a mission file."""
    model = encode_model(ElevationModel("hills.tif", elevation.spacing_m, elevation, ()))
    return f"\n[terrain]\nfile = '''{model}'''\nmin_agl_m = {min_agl_m}\nmax_agl_m = {max_agl_m}\n"


def hill(east_m: float, north_m: float, height_m: float, width_m: float, base_msl_m: float) -> Ground:
    """Return a hill of the form of a Gaussian."""

    def ground(east: FloatArray, north: FloatArray) -> FloatArray:
        away2 = (east - east_m) ** 2 + (north - north_m) ** 2
        heights: FloatArray = base_msl_m + height_m * np.exp(-0.5 * away2 / width_m**2)
        return heights

    return ground
