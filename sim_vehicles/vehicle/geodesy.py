"""Fast conversion of positions to latitude and longitude, and the height of the ground.

Near an anchor, the exact map of `gcs.geo` is replaced by its second-order Taylor polynomial, with derivatives
by central differences. The error is of third order, about ``d^3 tan^2(lat) / R^2``. With a new anchor every
`REACH_M` it stays below a centimetre up to 85 degrees of latitude.
"""

from __future__ import annotations

import math

from gcs.geo import LocalFrame
from gcs.terrain.elevation_grid import Elevation

REACH_M = 1000.0
_H_M = 500.0


class Geodesy:
    """Local frame with a fast conversion to geodetic positions, an exact one back, and its ground."""

    def __init__(self, frame: LocalFrame, elevation: Elevation | None = None) -> None:
        self.frame = frame
        self.elevation = elevation
        self._east_m = self._north_m = math.inf
        self._lat: tuple[float, ...] = ()
        self._lon: tuple[float, ...] = ()

    def to_geodetic(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Return (lat_deg, lon_deg)."""
        e = east_m - self._east_m
        n = north_m - self._north_m
        if not (-REACH_M <= e <= REACH_M and -REACH_M <= n <= REACH_M):
            self._anchor(east_m, north_m)
            e = n = 0.0
        a, ae, an, aee, ann, aen = self._lat
        o, oe, on, oee, onn, oen = self._lon
        lat_deg = a + ae * e + an * n + aee * e * e + ann * n * n + aen * e * n
        lon_deg = o + oe * e + on * n + oee * e * e + onn * n * n + oen * e * n
        if not -180.0 <= lon_deg <= 180.0:
            lon_deg = _near(lon_deg)
        return lat_deg, lon_deg

    def to_local(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Return (east_m, north_m)."""
        return self.frame.to_local(lat_deg, lon_deg)

    def ground_rel_m(self, east_m: float, north_m: float, level_m: float) -> float:
        """Return the height of the ground above the frame's origin; `level_m` without an elevation model.

        Beyond its edge the ground is as high as at the edge.
        """
        model = self.elevation
        if model is None:
            return level_m
        rows, cols = model.heights_msl_m.shape
        west, south = model.origin_m
        east_m = min(max(east_m, west), west + (cols - 1) * model.spacing_m)
        north_m = min(max(north_m, south), south + (rows - 1) * model.spacing_m)
        return model.height_msl_m(east_m, north_m) - self.frame.alt_msl_m

    def _anchor(self, east_m: float, north_m: float) -> None:
        self._east_m = east_m
        self._north_m = north_m
        exact = self.frame.to_geodetic
        around = {
            (i, j): exact(east_m + i * _H_M, north_m + j * _H_M) for i in (-1, 0, 1) for j in (-1, 0, 1)
        }
        polynomials = []
        for axis in (0, 1):
            f = {place: value[axis] for place, value in around.items()}
            # Longitude may jump by 360 degrees between neighbours of the antimeridian.
            f = {place: f[0, 0] + _near(value - f[0, 0]) for place, value in f.items()}
            polynomials.append(
                (
                    f[0, 0],
                    (f[1, 0] - f[-1, 0]) / (2 * _H_M),
                    (f[0, 1] - f[0, -1]) / (2 * _H_M),
                    (f[1, 0] - 2 * f[0, 0] + f[-1, 0]) / (2 * _H_M**2),
                    (f[0, 1] - 2 * f[0, 0] + f[0, -1]) / (2 * _H_M**2),
                    (f[1, 1] - f[1, -1] - f[-1, 1] + f[-1, -1]) / (4 * _H_M**2),
                )
            )
        self._lat, self._lon = polynomials


def _near(degrees: float) -> float:
    return (degrees + 180.0) % 360.0 - 180.0
