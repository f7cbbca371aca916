"""What sensors see over terrain; scans of sensors whose announced height is below the ground are refused.

A sensor that announces its place and height (`Viewpoint`) does not see what terrain hides. Tracks have no
height. A target stands on the ground, at `TARGET_HEIGHT_M`. An agent is anywhere in the flight band. So each
kind has its own view of a sensor, from one table of shadows.

A tracker of all objects takes them to be as low as targets, and still lets detections of hidden ones in:
they are agents.

Slant ranges become ranges over ground in the same way, kind by kind, unless the sensor measures heights.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

import numpy as np

from gcs.config import Config
from gcs.model import FloatArray, Scan, Sensor, Viewpoint, Visibility, read_only
from gcs.terrain.elevation_grid import Elevation
from gcs.tracking.models.sensor_geometry import map_coordinates, sensor_coordinates
from gcs.tracking.models.sensor_terrain import (
    ground_range_m,
    range_over_terrain_m,
    sensor_alt_msl_m,
    sensor_line_of_sight,
    sensor_reach_m,
)

SeenKind: TypeAlias = Literal["agents", "targets", "all"]

TARGET_HEIGHT_M: Final = 2.0
"""Height of a target above the ground."""
_MIN_SHARE: Final[dict[SeenKind, float]] = {"agents": 0.0, "targets": 0.0, "all": 0.01}
_MAX_BELOW_M: Final = 30.0
"""Depth under the ground at which an announced height is wrong, not the elevation model."""
_MAX_VIEWS: Final = 32
"""Sensors whose views are kept; a view has 2 MB for each kind at most."""


@dataclass(frozen=True, slots=True)
class _View:
    """Height of a sensor, and what it sees of each kind, from one viewpoint."""

    viewpoint: Viewpoint
    reach_m: float
    alt_msl_m: float
    seen: dict[SeenKind, Visibility]


class TerrainSight:
    """Scans as measurements of one kind of object; without an elevation model all is in sight."""

    def __init__(self, config: Config, kinds: Sequence[SeenKind] = ("agents", "targets")) -> None:
        self._elevation = config.elevation
        self._heights_agl_m: dict[SeenKind, tuple[float, float]] = {}
        if config.terrain is not None:
            heights: dict[SeenKind, tuple[float, float]] = {
                "agents": (config.terrain.min_agl_m, config.terrain.max_agl_m),
                "targets": (TARGET_HEIGHT_M, TARGET_HEIGHT_M),
                "all": (TARGET_HEIGHT_M, TARGET_HEIGHT_M),
            }
            self._heights_agl_m = {kind: heights[kind] for kind in kinds}
        self._views: OrderedDict[str, _View] = OrderedDict()

    def refusal(self, sensor: Sensor) -> str:
        """Return why the announced place of a sensor cannot be right; empty if it can."""
        viewpoint = sensor.viewpoint
        if self._elevation is None or viewpoint is None:
            return ""
        ground_m = self._elevation.height_msl_m(viewpoint.east_m, viewpoint.north_m)
        place = f"east {viewpoint.east_m:.0f} m, north {viewpoint.north_m:.0f} m"
        if viewpoint.is_agl and math.isnan(ground_m):
            return f"is from {place}, outside the elevation model: give alt_msl_m, not height_agl_m"
        if not viewpoint.is_agl and viewpoint.height_m < ground_m - _MAX_BELOW_M:
            return (
                f"is from {viewpoint.height_m:.0f} m AMSL at {place}, but the ground is at {ground_m:.0f} m"
            )
        return ""

    def scan_of(self, scan: Scan, kind: SeenKind) -> Scan:
        """Return a scan as a measurement of one kind: with what is hidden, and ranges over ground."""
        elevation = self._elevation
        sensor = scan.sensor
        if elevation is None or sensor.viewpoint is None:
            return scan
        view = self._view(elevation, sensor, sensor.viewpoint)
        z_m = self._over_ground(elevation, scan, view.alt_msl_m, kind)
        return replace(scan, sensor=replace(sensor, visibility=view.seen[kind]), z_m=z_m)

    def _view(self, elevation: Elevation, sensor: Sensor, viewpoint: Viewpoint) -> _View:
        view = self._views.get(sensor.name)
        reach_m = sensor_reach_m(sensor, viewpoint)
        if view is None or (view.viewpoint, view.reach_m) != (viewpoint, reach_m):
            lines = sensor_line_of_sight(elevation, sensor, viewpoint)
            seen = {
                kind: lines.visibility(*heights, _MIN_SHARE[kind])
                for kind, heights in self._heights_agl_m.items()
            }
            view = _View(viewpoint, reach_m, sensor_alt_msl_m(elevation, viewpoint), seen)
            self._views[sensor.name] = view
            if len(self._views) > _MAX_VIEWS:
                self._views.popitem(last=False)
        self._views.move_to_end(sensor.name)
        return view

    def _over_ground(self, elevation: Elevation, scan: Scan, alt_msl_m: float, kind: SeenKind) -> FloatArray:
        """Return the detections (m, 2) of a scan, with ranges over ground in place of slant ranges."""
        polar = scan.sensor.polar
        if polar is None or not polar.is_slant or not len(scan.z_m):
            return scan.z_m
        z = sensor_coordinates(scan.sensor, scan.z_m)
        if scan.heights_msl_m is None:
            agl_m = sum(self._heights_agl_m[kind]) / 2.0
            range_m = range_over_terrain_m(elevation, polar, z, alt_msl_m, agl_m)
        else:
            range_m = ground_range_m(z[:, 0], scan.heights_msl_m - alt_msl_m)
        return read_only(map_coordinates(polar, np.column_stack([range_m, z[:, 1]])))
