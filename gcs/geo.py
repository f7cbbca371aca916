"""WGS84 to the mission's local east/north frame and back, and angle arithmetic.

The local frame is the plane tangent to the ellipsoid at the mission's origin: x east, y north, metres.
Heights are carried beside it, as metres above mean sea level or above the origin. Over a 6 km map the plane
leaves the ellipsoid by less than 0.8 m in height and 1 mm in position, which is below any sensor noise here.

Bearings, courses and headings are clockwise from north, in radians, as aviation uses them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import pymap3d


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """A local tangent plane at an origin on WGS84."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float

    def to_local(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Return (east_m, north_m) of a point at the origin's height."""
        east, north, _ = pymap3d.geodetic2enu(
            lat_deg, lon_deg, self.alt_msl_m, self.lat_deg, self.lon_deg, self.alt_msl_m
        )
        return float(east), float(north)

    def to_geodetic(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Return (lat_deg, lon_deg) of a point on the local plane."""
        lat, lon, _ = pymap3d.enu2geodetic(east_m, north_m, 0.0, self.lat_deg, self.lon_deg, self.alt_msl_m)
        return float(lat), float(lon)


def wrap_pi(angle_rad: float) -> float:
    """Wrap an angle to [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def bearing_rad(east_from_m: float, north_from_m: float, east_to_m: float, north_to_m: float) -> float:
    """Bearing from one local point to another, clockwise from north, in (-pi, pi]."""
    return math.atan2(east_to_m - east_from_m, north_to_m - north_from_m)
