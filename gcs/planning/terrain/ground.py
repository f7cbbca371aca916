"""Terrain of a mission: elevation and flight band, and how low take-offs and landings may be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.model import BoolArray, FloatArray
from gcs.planning.map.limited_area import LimitedArea
from gcs.terrain.elevation_grid import Elevation

_FLARE_M: Final = 3.0


@dataclass(frozen=True, eq=False)
class Terrain:
    """Ground and flight band of a mission.

    Attributes
    ----------
    elevation : Elevation
    min_agl_m, max_agl_m : float
        Least and greatest height above ground.
    layers : int
        Number of altitude layers: each prefers another share of the band.
    areas : tuple of LimitedArea
        Areas of the map with vertical limits, to pass over or under.
    home_msl_m : float
        Height that limits above home refer to.
    vertical_clearance_m : float
        Vertical distance to keep from the areas.
    """

    elevation: Elevation
    min_agl_m: float
    max_agl_m: float
    layers: int = 1
    areas: tuple[LimitedArea, ...] = ()
    home_msl_m: float = 0.0
    vertical_clearance_m: float = 0.0

    def share(self, layer: int) -> float:
        """Return the share of the band, from floor to ceiling, that a layer prefers."""
        return (layer + 0.5) / max(self.layers, layer + 1)


def needed_low_agl_m(above_m: FloatArray, least_agl_m: float) -> FloatArray:
    """Return the height above ground that a take-off or a landing keeps, at heights above its begin or end.

    That is half of them, or the least height above ground if that is less.
    """
    needed_m: FloatArray = np.minimum(0.5 * above_m, least_agl_m)
    return needed_m


def keeps_above_landing(above_m: FloatArray, ground_m: FloatArray, least_agl_m: float) -> BoolArray:
    """Return a mask of heights of a landing that are high enough, where ground is by its height.

    Both heights are above the landing point. Below `_FLARE_M` the vehicle lands, whatever the ground is.
    """
    is_clear: BoolArray = above_m - ground_m >= needed_low_agl_m(above_m, least_agl_m)
    return is_clear | (above_m < _FLARE_M)
