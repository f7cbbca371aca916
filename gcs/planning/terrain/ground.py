"""Ground and flight band of a mission."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.planning.map.limited_area import LimitedArea
from gcs.terrain.elevation import Elevation


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
