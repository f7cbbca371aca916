"""WGS84 to the mission's local east/north frame and back, angle arithmetic, and the corners of areas.

The local frame is the plane tangent to the ellipsoid at the mission's origin: x east, y north, metres.
Heights are separate, as metres above mean sea level or above the origin. Over a 6 km map the plane
leaves the ellipsoid by less than 0.8 m in height and 1 mm in position, which is below any sensor noise here.

Bearings, courses and headings are clockwise from north, in radians, as aviation uses them.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

_SEMI_MAJOR_M: Final = 6_378_137.0
_SEMI_MINOR_M: Final = 6_356_752.31424518
_MIN_CORNERS: Final = 3


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """A local tangent plane at an origin on WGS84."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float

    def to_local(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Return (east_m, north_m) of a point at the origin's height.

        What `pymap3d.geodetic2enu` does, to the last bit, on Python's floats: reports come through here.
        """
        x, y, z = _to_ecef(lat_deg, lon_deg, self.alt_msl_m)
        x0, y0, z0 = _origin(self.lat_deg, self.lon_deg, self.alt_msl_m)
        u = x - x0
        v = y - y0
        w = z - z0
        lat0 = math.radians(self.lat_deg)
        lon0 = math.radians(self.lon_deg)
        sin_lon0 = math.sin(lon0)
        cos_lon0 = math.cos(lon0)
        outward = cos_lon0 * u + sin_lon0 * v
        return -sin_lon0 * u + cos_lon0 * v, -math.sin(lat0) * outward + math.cos(lat0) * w

    def to_geodetic(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Return (lat_deg, lon_deg) of a point on the local plane.

        What `pymap3d.enu2geodetic` does, on Python's floats, in a thirtieth of the time.
        """
        lat0 = math.radians(self.lat_deg)
        lon0 = math.radians(self.lon_deg)
        sin_lon0 = math.sin(lon0)
        cos_lon0 = math.cos(lon0)
        x0, y0, z0 = _origin(self.lat_deg, self.lon_deg, self.alt_msl_m)
        inward = math.sin(lat0) * north_m
        x = x0 - sin_lon0 * east_m - cos_lon0 * inward
        y = y0 + cos_lon0 * east_m - sin_lon0 * inward
        return _from_ecef(x, y, z0 + math.cos(lat0) * north_m)


def _to_ecef(lat_deg: float, lon_deg: float, alt_m: float) -> tuple[float, float, float]:
    """WGS84 to Earth-centred, Earth-fixed x, y, z in metres."""
    lat = math.radians(lat_deg)
    lon = math.radians(lon_deg)
    sin_lat = math.sin(lat)
    cos_lat = math.cos(lat)
    prime_m = _SEMI_MAJOR_M**2 / float(np.hypot(_SEMI_MAJOR_M * cos_lat, _SEMI_MINOR_M * sin_lat))
    ring_m = (prime_m + alt_m) * cos_lat
    z_m = (prime_m * (_SEMI_MINOR_M / _SEMI_MAJOR_M) ** 2 + alt_m) * sin_lat
    return ring_m * math.cos(lon), ring_m * math.sin(lon), z_m


_origin = lru_cache(_to_ecef)
"""The same of an origin, which is one of few."""


def _from_ecef(x: float, y: float, z: float) -> tuple[float, float]:
    """Latitude and longitude in degrees of a point near the ground, its reduced latitude found in one step.

    Rey-Jer You, Transformation of Cartesian to Geodetic Coordinates without Iterations, Journal of Surveying
    Engineering 126 (2000), eq. 4 and 13.
    """
    focal2 = _SEMI_MAJOR_M**2 - _SEMI_MINOR_M**2
    beyond2 = x * x + y * y + z * z - focal2
    ring_m = math.hypot(x, y)
    minor_m = math.sqrt(0.5 * (beyond2 + math.hypot(beyond2, 2.0 * math.sqrt(focal2) * z)))
    major_m = math.hypot(minor_m, math.sqrt(focal2))
    reduced = math.atan2(major_m * z, minor_m * ring_m)
    sin = math.sin(reduced)
    cos = math.cos(reduced)
    off = _SEMI_MINOR_M * minor_m - _SEMI_MAJOR_M * major_m + focal2
    reduced += off * sin * cos / (_SEMI_MAJOR_M * major_m - focal2 * cos * cos)
    lat = math.atan2(_SEMI_MAJOR_M * math.sin(reduced), _SEMI_MINOR_M * math.cos(reduced))
    return math.degrees(lat), math.degrees(math.atan2(y, x))


def wrap_pi(angle_rad: float) -> float:
    """Wrap an angle to [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def bearing_rad(east_from_m: float, north_from_m: float, east_to_m: float, north_to_m: float) -> float:
    """Bearing from one local point to another, clockwise from north, in (-pi, pi]."""
    return math.atan2(east_to_m - east_from_m, north_to_m - north_from_m)


def corner_error(corners: Collection[object]) -> str:
    """Return what is wrong with the corners of an area; empty if nothing.

    Pass a set where repeated corners count once.
    """
    count = len(corners)
    return "" if count >= _MIN_CORNERS else f"expected at least three different corners, got {count}"
