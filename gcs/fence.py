"""Geofence and rally points of a mission file, and checks of them.

A fence is at most one inclusion area, any number of exclusion areas, and a ceiling. Autopilots differ on
several inclusion areas (ArduPilot: inside all, PX4: inside any), so only one is allowed. The zones of the
map's GeoJSON belong to the fence unless `fence.from_map` is false.

Autopilots hold an area at all heights. So an exclusion area that all altitude layers pass above or below is
not sent to them; one that is met in a layer is, and is kept out of at all heights.

Positions are in degrees, as vehicles store them; `Fence.beyond` takes metres of the local frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from gcs.config import Config
from gcs.config.schema import MIN_RALLY_M, RallyTable
from gcs.errors import ConfigError
from gcs.geo import LocalFrame, corner_error
from gcs.mistake_codes import MistakeCode
from gcs.model import UNLIMITED, FloatArray, VerticalLimits

Place: TypeAlias = tuple[float, float]
"""Latitude and longitude in degrees."""

_CIRCLE_VERTICES = 48
_SAMPLE_STEP_M = 2.0
"""Distance between samples of a leg: shorter incursions are missed."""


@dataclass(frozen=True, slots=True)
class Area:
    """Inclusion or exclusion area: a polygon, or a circle."""

    stay_in: bool
    corners_deg: tuple[Place, ...] = ()
    centre_deg: Place = (0.0, 0.0)
    radius_m: float = 0.0
    limits: VerticalLimits = UNLIMITED

    def outline_m(self, frame: LocalFrame) -> list[tuple[float, float]]:
        """Return the vertices in east/north; a circle as a polygon around it (inclusion: inside it)."""
        if self.corners_deg:
            return [frame.to_local(*corner) for corner in self.corners_deg]
        east_m, north_m = frame.to_local(*self.centre_deg)
        step = math.tau / _CIRCLE_VERTICES
        radius_m = self.radius_m if self.stay_in else self.radius_m / math.cos(0.5 * step)
        turns = [n * step for n in range(_CIRCLE_VERTICES)]
        return [(east_m + radius_m * math.sin(a), north_m + radius_m * math.cos(a)) for a in turns]

    def contains(self, points_m: FloatArray, frame: LocalFrame) -> np.ndarray:
        """Return a mask of the points (n, 2), east/north, inside the area."""
        if not self.corners_deg:
            centre_m = np.array(frame.to_local(*self.centre_deg))
            inside: np.ndarray = np.hypot(*(points_m - centre_m).T) <= self.radius_m
            return inside
        corners_m = np.array([frame.to_local(*corner) for corner in self.corners_deg])
        return _is_inside(points_m, corners_m)


@dataclass(frozen=True, slots=True)
class Fence:
    """A mission's fence."""

    areas: tuple[Area, ...] = ()
    """Areas that vehicles hold, at all heights."""
    max_alt_rel_m: float = 0.0
    """Ceiling above home; 0 for none."""
    passed: tuple[Area, ...] = ()
    """Areas that all layers pass above or below. They are not sent: vehicles hold areas at all heights."""

    def beyond(self, points_m: Sequence[Sequence[float]] | FloatArray, frame: LocalFrame) -> float:
        """Return the length in metres that a path (n, 2) has outside; 1 for a single point."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        samples, step_m = _samples(points)
        bad = np.zeros(len(samples), dtype=bool)
        for area in self.areas:
            bad |= area.contains(samples, frame) != area.stay_in
        return float(bad.sum()) * step_m


@dataclass(frozen=True, slots=True)
class Rally:
    """A rally point: a return position instead of home."""

    lat_deg: float
    lon_deg: float
    alt_rel_m: int


def fence_of(config: Config, source: str = "") -> Fence:
    """Return the fence of a mission file.

    Raises
    ------
    ConfigError
        An area is invalid, there are several inclusion areas, or a rally point is outside.
    """
    areas = held_areas(config, source)
    if sum(area.stay_in for area in areas) > 1:
        raise ConfigError(
            source,
            "fence",
            MistakeCode.CONFLICT,
            "there are several areas to stay in (the map's boundary is one): ArduPilot wants a vehicle in "
            "all of them, PX4 in any of them, so draw a single one",
        )
    passed = tuple(area for area in areas_of(config, source) if not _is_held(area, config))
    fence = Fence(tuple(areas), config.max_alt_rel_m, passed)
    _check(fence, config, source)
    return fence


def held_areas(config: Config, source: str = "") -> list[Area]:
    """Return the areas of a mission's fence that vehicles hold: without those above or below all layers.

    Raises
    ------
    ConfigError
        As `drawn_areas`.
    """
    return [area for area in areas_of(config, source) if _is_held(area, config)]


def _is_held(area: Area, config: Config) -> bool:
    return area.limits.are_open or config.layer_heights.meet(area.limits)


def areas_of(config: Config, source: str = "") -> list[Area]:
    """Return the areas of a mission's fence, including those of its map.

    Raises
    ------
    ConfigError
        As `drawn_areas`.
    """
    return [*(_from_map(config) if config.fence.from_map else ()), *drawn_areas(config, source)]


def drawn_areas(config: Config, source: str = "") -> list[Area]:
    """Return the areas of the fence table.

    Raises
    ------
    ConfigError
        An area has both a polygon and a circle, or neither.
    """
    areas = []
    for index, row in enumerate(config.fence.areas):
        key = f"fence.areas[{index}]"
        polygon = row.corners_deg
        circle = row.circle
        if bool(polygon) == (circle is not None):
            raise ConfigError(source, key, MistakeCode.CONFLICT, "expected either corners_deg or circle")
        stay_in = row.kind == "inclusion"
        if circle is not None:
            areas.append(Area(stay_in, (), circle[:2], circle[2], row.limits))
        else:
            corners = _open(polygon)
            if error := corner_error(set(corners)):
                raise ConfigError(source, f"{key}.corners_deg", MistakeCode.BAD_SHAPE, error)
            areas.append(Area(stay_in, corners, limits=row.limits))
    return areas


def rally_of(config: Config) -> tuple[Rally, ...]:
    """Return the rally points of a mission file, with home at the height of the frame's origin."""
    return tuple(Rally(row.lat_deg, row.lon_deg, round(_rally_height_m(row, config))) for row in config.rally)


def _rally_height_m(row: RallyTable, config: Config) -> float:
    """Return the height of a rally point above home."""
    if row.alt_rel_m is not None:
        return row.alt_rel_m
    home_msl_m = config.frame.alt_msl_m
    if row.alt_msl_m is not None:
        return row.alt_msl_m - home_msl_m
    elevation = config.elevation
    place_m = config.local_frame.to_local(row.lat_deg, row.lon_deg)
    ground_m = 0.0 if elevation is None else elevation.height_msl_m(*place_m) - home_msl_m
    if math.isnan(ground_m):
        raise ConfigError(
            config.name,
            "rally",
            MistakeCode.OUTSIDE_MAP,
            f"the ground at {row.lat_deg}, {row.lon_deg} is not known",
        )
    return ground_m + (row.alt_agl_m or 0.0)


def _check(fence: Fence, config: Config, source: str) -> None:
    frame = config.local_frame
    if fence.max_alt_rel_m and fence.max_alt_rel_m <= config.mission.highest_rel_m:
        raise ConfigError(
            source,
            "fence.max_alt_rel_m" if config.fence.max_alt_msl_m is None else "fence.max_alt_msl_m",
            MistakeCode.CONFLICT,
            f"expected more than the highest altitude layer, {config.mission.highest_rel_m:g} m above home",
        )
    for index, point in enumerate(rally_of(config)):
        if point.alt_rel_m < MIN_RALLY_M:
            raise ConfigError(
                source,
                f"rally[{index}]",
                MistakeCode.OUT_OF_RANGE,
                f"is {point.alt_rel_m} m above home (frame.alt_msl_m); expected {MIN_RALLY_M} m or more",
            )
    for index, row in enumerate(config.rally):
        if fence.beyond([frame.to_local(row.lat_deg, row.lon_deg)], frame):
            raise ConfigError(
                source,
                f"rally[{index}]",
                MistakeCode.OUTSIDE_MAP,
                "lies outside the fence: a return would breach it",
            )


def _from_map(config: Config) -> list[Area]:
    """Return the areas of the map's GeoJSON."""
    frame = config.local_frame
    near = config.zones
    areas = []
    for polygon in near.boundary:
        outline, *holes = polygon
        areas.append(Area(True, _degrees(outline, frame)))
        areas += [Area(False, _degrees(hole, frame)) for hole in holes]
    polygons = [zone for zone in near.no_fly if zone.circle is None]
    areas += [Area(False, _degrees(one.polygon[0], frame), limits=one.limits) for one in polygons]
    for zone in near.no_fly:
        if zone.circle is not None:
            centre_m, radius_m = zone.circle
            areas.append(Area(False, (), frame.to_geodetic(*centre_m), radius_m, zone.limits))
    return areas


def _degrees(ring: Sequence[tuple[float, float]], frame: LocalFrame) -> tuple[Place, ...]:
    return _open([frame.to_geodetic(east, north) for east, north in ring])


def _open(corners: Sequence[Place]) -> tuple[Place, ...]:
    """Return the vertices without a repeated first one at the end."""
    closed = len(corners) > 1 and math.dist(corners[0], corners[-1]) < 1e-9
    return tuple(corners[:-1] if closed else corners)


def _samples(points: FloatArray) -> tuple[FloatArray, float]:
    if len(points) == 1:
        return points, 1.0
    legs = []
    for start, end in pairwise(points):
        count = max(1, math.ceil(float(np.hypot(*(end - start))) / _SAMPLE_STEP_M))
        legs.append(start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start))
    return np.concatenate(legs), _SAMPLE_STEP_M


def _is_inside(points: FloatArray, corners: FloatArray) -> np.ndarray:
    """Return a mask by the even-odd rule: a ray to the east crosses the outline an odd number of times."""
    x = points[:, 0, None]
    y = points[:, 1, None]
    x0, y0 = corners.T
    x1, y1 = np.roll(corners, -1, axis=0).T
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    between = (y0 > y) != (y1 > y)
    odd: np.ndarray = np.count_nonzero(between & (crossing > x), axis=1) % 2 == 1
    return odd
