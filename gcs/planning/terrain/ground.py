"""Ground and flight band of a mission."""

from __future__ import annotations

from dataclasses import dataclass

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
    """

    elevation: Elevation
    min_agl_m: float
    max_agl_m: float
    layers: int = 1

    def share(self, layer: int) -> float:
        """Return the share of the band, from floor to ceiling, that a layer prefers."""
        return (layer + 0.5) / max(self.layers, layer + 1)
