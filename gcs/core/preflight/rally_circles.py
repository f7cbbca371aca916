"""Circles round rally points, in which returns end: above the ground, inside the fence, clear of obstacles.

ArduPlane circles at the height of the rally point, with RTL_RADIUS. PX4 descends to RTL_DESCEND_ALT above
it, and circles with RTL_LOITER_RAD. In wind circles are up to a fifth wider. Straight returns to the points
are not checked here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from gcs.config import Config
from gcs.config.airframe import UNKNOWN_LOITER_RADIUS_M
from gcs.core.airspace.obstacle_map import ObstacleMap
from gcs.core.preflight.check_codes import CheckCode
from gcs.core.preflight.result import Check
from gcs.fence import Fence, Rally, fence_of, rally_of
from gcs.mavlink.autopilots import AutopilotProfile
from gcs.model import FloatArray, LayerHeights, Parameter
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.limited_area import blocked_by

WIDEST: Final = 1.2
"""Greatest distance from the centre of a circle in wind, in radii."""
_ANGLES: Final = np.arange(0.0, 2.0 * math.pi, math.pi / 16.0)
_RING: Final = np.stack((np.sin(_ANGLES), np.cos(_ANGLES)), axis=1)
DISC: Final = np.concatenate([part * WIDEST * _RING for part in (1 / 3, 2 / 3, 1.0)])
"""Places in a circle of radius 1, and a little beside it."""
_HALF_DIAGONAL: Final = 0.7072
"""In cells."""


def return_radius_m(profile: AutopilotProfile, values: Mapping[str, float], turn_radius_m: float) -> float:
    """Return the radius of the circle in which a return ends, from the parameters `values` of a vehicle."""
    radius_m = profile.circle_radius_m(values, in_return=True) or UNKNOWN_LOITER_RADIUS_M
    return max(abs(radius_m), turn_radius_m)


class RallyCircles:
    """Checks of the circles of one vehicle.

    Parameters
    ----------
    values : mapping of str to float
        Parameters of the vehicle.
    home_msl_m : float
        Height of its home above mean sea level.
    """

    def __init__(
        self,
        vehicle: int,
        config: Config,
        obstacles: ObstacleMap,
        profile: AutopilotProfile,
        values: Mapping[str, float],
        home_msl_m: float,
    ) -> None:
        self._vehicle = vehicle
        self._config = config
        self._obstacles = obstacles
        self._profile = profile
        self._values = values
        self._home_msl_m = home_msl_m
        self._end_m = values.get(profile.return_circle_parameter, 0.0)
        self._radius_m = return_radius_m(profile, values, config.airframes_of_agents[vehicle].turn_radius_m)

    def checks(self) -> Iterator[Check]:
        """Yield what stands against each rally point of the mission file, or that nothing does."""
        fence = fence_of(self._config, self._config.name)
        for number, point in enumerate(rally_of(self._config), start=1):
            place_m = self._config.local_frame.to_local(point.lat_deg, point.lon_deg)
            beside = [*self._fence(place_m, fence)] or [*self._near(point, place_m)]
            found = [*self._ground(point, place_m), *beside]
            parameters: dict[str, Parameter] = {
                "number": number,
                "lat_deg": point.lat_deg,
                "lon_deg": point.lon_deg,
                "radius_m": self._radius_m,
                "height_m": point.alt_rel_m + self._end_m,
            }
            for code, more in found or [(CheckCode.RALLY_CIRCLE, {})]:
                yield Check(self._vehicle, code, parameters | more)

    def _ground(self, point: Rally, place_m: Point) -> Iterator[tuple[CheckCode, dict[str, Parameter]]]:
        elevation = self._config.elevation
        terrain = self._config.terrain
        if elevation is None or terrain is None:
            return
        ground_msl_m = elevation.heights_at(np.array(place_m) + self._radius_m * DISC)
        if not np.isfinite(ground_msl_m).any():
            return
        low_msl_m = self._home_msl_m + point.alt_rel_m + self._end_m
        above_m = low_msl_m - float(np.nanmax(ground_msl_m))
        least_m = terrain.flown_min_agl_m
        if above_m < least_m:
            raised_m = point.alt_rel_m + math.ceil(least_m - above_m)
            yield (
                CheckCode.RALLY_INTO_GROUND,
                {"above_m": above_m, "min_above_m": least_m, "min_alt_rel_m": raised_m},
            )

    def _fence(self, place_m: Point, fence: Fence) -> Iterator[tuple[CheckCode, dict[str, Parameter]]]:
        ring_m = np.array(place_m) + WIDEST * self._radius_m * np.vstack((_RING, _RING[:1]))
        beyond_m = fence.beyond(ring_m, self._config.local_frame)
        if beyond_m:
            yield CheckCode.RALLY_BEYOND_FENCE, {"beyond_m": beyond_m, "min_away_m": self._room_m}

    def _near(self, point: Rally, place_m: Point) -> Iterator[tuple[CheckCode, dict[str, Parameter]]]:
        """Yield an obstacle or a no-fly zone of the mission file at the heights of the end of a return."""
        returns = self._profile.return_heights(self._values, [float(point.alt_rel_m)])
        heights = LayerHeights(
            point.alt_rel_m + self._end_m,
            max((one.height_m for one in returns[:1]), default=float(point.alt_rel_m)),
            self._home_msl_m,
            self._config.planning.vertical_clearance_m,
        )
        met = (one for one in self._obstacles.limited if heights.meet(one.limits))
        away_m = _distance_m(blocked_by(self._obstacles.full, met), place_m)
        if away_m < self._room_m:
            yield CheckCode.RALLY_NEAR_OBSTACLE, {"away_m": away_m, "min_away_m": self._room_m}

    @property
    def _room_m(self) -> float:
        return WIDEST * self._radius_m


def _distance_m(grid: Grid, place_m: Point) -> float:
    """Return the distance of a place from the nearest blocked cell; infinite if there is none."""
    cells: FloatArray = np.argwhere(grid.blocked)[:, ::-1] * grid.spacing_m + np.array(grid.origin_m)
    away_m = np.hypot(*(cells - np.array(place_m)).T) - _HALF_DIAGONAL * grid.spacing_m
    return max(float(away_m.min(initial=math.inf)), 0.0)
