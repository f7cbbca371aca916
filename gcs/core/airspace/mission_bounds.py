"""Bounds of a mission, checked before its upload: map, fence with ceilings, ground. With tolerances.

Items are checked one by one, and so is what the vehicle will fly between them: climb, legs, turns, loiter
circle and landing approach, forward-simulated from the items in the wind that the vehicle reports
(`gcs.planning.forward_simulation`). What is flown must keep inside the fence. Where routes are planned with
turns and a clearance, it must keep out of obstacles and no-fly zones as well. Over terrain it must keep half
of the least height above the ground, except in take-off; in a landing half of its height above home, if that
is less.

The check is independent of planning, which also keeps routes inside. The vehicle of a refused mission keeps
its onboard mission.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.config.airframe import UNKNOWN_LOITER_RADIUS_M
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.tasking.mission_builder import corners_of
from gcs.fence import Area, held_areas
from gcs.mavlink.mission.items import Item
from gcs.model import BoolArray, FloatArray, IntArray, VehicleState
from gcs.planning.flown_heights import lowest_heights_m
from gcs.planning.forward_simulation import LoiterCircle, Motion, RemainingMission, predict_motion
from gcs.planning.map.grid import Grid, Point, free_grid_like
from gcs.planning.map.limited_area import blocked_by
from gcs.planning.mission_flight import NOWHERE, simulate_mission
from gcs.planning.terrain.flown_route import FlightModel
from gcs.planning.terrain.ground import keeps_above_landing
from gcs.planning.wind_triangle import airspeed_m_s, plausible_wind_m_s

_ROUNDING_M: Final = 1.0
_PLACE_ROUNDING_M: Final = 0.02
"""Items hold 1e-7 degrees, 11 mm."""
_RELATIVE: Final = (dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)


class BoundsProblem(NamedTuple):
    """What of a mission is out of bounds."""

    kind: str
    """Identity: the bound, and the command of the item."""
    text: str


class MissionBoundsCheck:
    """Checks mission items, and the flight along them."""

    def __init__(self, config: Config, zones: NoFlyZones) -> None:
        self._frame = config.local_frame
        self._zones = zones
        self._airframes = config.airframes_of_agents
        self._areas = held_areas(config, config.name)
        self._ceiling_m = config.max_alt_rel_m
        self._elevation = config.elevation
        self._least_agl_m = 0.0 if config.terrain is None else config.terrain.flown_min_agl_m
        self._keeps_clear = config.planning.shape == "flyable" and config.planning.clearance_m > 0.0

    def problem(self, items: Sequence[Item], state: VehicleState | None) -> BoundsProblem | None:
        """Return the first item out of bounds.

        A vehicle inside an exclusion area may get items there: it has to leave it.

        Parameters
        ----------
        items : sequence of Item
            Mission items without home.
        state : VehicleState or None
            State of the vehicle.
        """
        areas = self._areas
        if state is not None:
            position_m = state.east_m, state.north_m
            areas = [area for area in areas if area.stay_in or not self._contains(area, position_m)]
        for number, item in enumerate(items, start=1):
            outside = self._outside(item, areas)
            if outside is not None:
                bound, problem = outside
                name = dialect.enums["MAV_CMD"][item.command].name.removeprefix("MAV_CMD_NAV_").lower()
                lat_lon = f"{item.x * 1e-7:.6f}, {item.y * 1e-7:.6f}"
                text = f"point {number} of {len(items)} ({name} at {lat_lon}) {problem}"
                return BoundsProblem(f"{bound} {item.command}", text)
        return None

    def flight_problem(
        self,
        items: Sequence[Item],
        vehicle: int,
        motion: Motion,
        upload_s: float,
        height_msl_m: float,
        home_msl_m: float,
        reported_wind_m_s: Point | None = None,
    ) -> BoundsProblem | None:
        """Return the first part of a flight that is not clear of fence, obstacles and ground.

        The part that leads a vehicle into the fence does not count, nor the way of a vehicle out of an
        obstacle: of that only the end does.

        Parameters
        ----------
        items : sequence of Item
            Mission items that the vehicle will fly.
        motion : Motion
            Motion of the vehicle now, and what it flies until then.
        upload_s : float
            Time until it takes the mission up.
        height_msl_m, home_msl_m : float
            Heights of the vehicle and of its home above mean sea level.
        reported_wind_m_s : tuple of float, optional
            Velocity of the air that the vehicle reports, east and north.
        """
        if not items:
            return None
        airframe = self._airframes[vehicle]
        reported_wind_m_s = plausible_wind_m_s(
            reported_wind_m_s, motion.speed_m_s, motion.course_rad, airframe.speed_m_s
        )
        begin = predict_motion(
            NOWHERE, motion, upload_s, airframe.turn_lag_s, reported_wind_m_s, airframe.still_air_radius_m
        )
        wind_m_s = reported_wind_m_s or (0.0, 0.0)
        begin = replace(begin, speed_m_s=airspeed_m_s(begin.speed_m_s, begin.course_rad, wind_m_s))
        flown_m, parts = self._flight(items, vehicle, begin, wind_m_s)
        points_m = np.vstack((begin.place_m, self._places_m(items)))
        heights_msl_m = _heights_msl_m(items, height_msl_m, home_msl_m)
        lowest_msl_m = lowest_heights_m(flown_m, parts, points_m, heights_msl_m)
        outside = self._is_outside(flown_m)
        inside = np.flatnonzero(~outside)
        begins = int(inside[0]) if len(inside) else 0
        wrong = begins + np.flatnonzero(outside[begins:])
        bound = "fence"
        what = "leaves the fence"
        if not len(wrong) and self._keeps_clear:
            blocked = _is_blocked(self._zones.grid, flown_m)
            blocked |= self._is_in_limited_area(flown_m, lowest_msl_m)
            if blocked.any() and blocked[0]:  # it leaves an obstacle by any way, for a clear end
                is_end = parts >= len(items) - 1
                blocked &= is_end
            wrong = np.flatnonzero(blocked)
            bound = "obstacle"
            what = "hits an obstacle, a no-fly zone or the fence"
        if not len(wrong):
            wrong = np.flatnonzero(self._is_near_ground(items, flown_m, parts, lowest_msl_m, home_msl_m))
            bound = "ground"
            what = f"comes nearer to the ground than {self._least_agl_m:g} m"
        if not len(wrong):
            return None
        first = int(wrong[0])
        lat_deg, lon_deg = self._frame.to_geodetic(*flown_m[first].tolist())
        index = int(parts[first])
        text = f"{_part(items, index)} {what} at {lat_deg:.6f}, {lon_deg:.6f}"
        return BoundsProblem(f"{bound} {items[index].command}", text)

    def _places_m(self, items: Sequence[Item]) -> list[Point]:
        return [self._frame.to_local(item.x * 1e-7, item.y * 1e-7) for item in items]

    def _flight(
        self, items: Sequence[Item], vehicle: int, motion: Motion, wind_m_s: Point
    ) -> tuple[FloatArray, IntArray]:
        """Return the simulated places of a flight (k, 2), and the item that it flies to at each.

        The speed of `motion` is the airspeed.
        """
        airframe = self._airframes[vehicle]
        places_m = self._places_m(items)
        first = int(items[0].command == dialect.MAV_CMD_NAV_TAKEOFF)
        if first:
            motion = replace(motion, speed_m_s=airframe.speed_m_s)
        end = len(items)
        circle = None
        if items[-1].command == dialect.MAV_CMD_NAV_LOITER_UNLIM:
            widest_m = items[-1].param3 / airframe.air_density or UNKNOWN_LOITER_RADIUS_M
            radius_m = max(widest_m, airframe.turn_radius_m)
            end = len(items) - 1
            circle = LoiterCircle(places_m[-1], radius_m)
        radii_m = tuple(item.param2 for item in items[first:end])
        model = FlightModel(airframe.speed_m_s, airframe.turn_lag_s, corners_of(airframe), wind_m_s)
        flight = simulate_mission(
            motion,
            places_m[0] if first else None,
            RemainingMission(tuple(places_m[first:end]), radii_m, circle=circle),
            model.turn_lag_s,
            model.turn_radius_m,
            wind_m_s,
        )
        parts = first + flight.passed
        is_flown = parts < len(items)  # behind the landing nothing is flown
        return flight.places_m[is_flown], parts[is_flown]

    def _is_in_limited_area(self, flown_m: FloatArray, lowest_msl_m: FloatArray) -> BoolArray:
        """Return a mask of the places nearer than half of the clearance over or under an area."""
        obstacles = self._zones.obstacles
        margin_m = 0.5 * obstacles.layers.clearance_m
        blocked = np.zeros(len(flown_m), dtype=np.bool_)
        for area in obstacles.limited:
            if obstacles.layers.meet(area.limits):
                continue  # blocked at all heights
            floor_m, ceiling_m = area.limits.bounds_m
            heights_m = lowest_msl_m - obstacles.zero_msl_m(area.limits.reference, flown_m)
            is_level_with_it = (heights_m > floor_m - margin_m) & (heights_m < ceiling_m + margin_m)
            if is_level_with_it.any():
                alone = blocked_by(free_grid_like(self._zones.grid), [area])
                blocked |= is_level_with_it & _is_blocked(alone, flown_m)
        return blocked

    def _is_near_ground(
        self,
        items: Sequence[Item],
        flown_m: FloatArray,
        parts: IntArray,
        lowest_msl_m: FloatArray,
        home_msl_m: float,
    ) -> BoolArray:
        """Return a mask of the places too near to the ground; a take-off does not count.

        A landing, from the descent to its approach on, is above home, on the ground there.
        """
        if self._elevation is None:
            return np.zeros(len(flown_m), dtype=np.bool_)
        first = int(items[0].command == dialect.MAV_CMD_NAV_TAKEOFF)
        ground_msl_m = self._elevation.heights_at(flown_m)
        is_low = lowest_msl_m < ground_msl_m + self._least_agl_m
        if items[-1].command == dialect.MAV_CMD_NAV_LAND:
            landing_msl_m = self._elevation.height_msl_m(*self._places_m(items[-1:])[0])
            above_m = lowest_msl_m - home_msl_m
            is_landing = parts >= len(items) - 2
            is_clear = keeps_above_landing(above_m, ground_msl_m - landing_msl_m, self._least_agl_m)
            is_low = np.where(is_landing, ~is_clear, is_low)
        return is_low & (parts >= first)

    def _is_outside(self, flown_m: FloatArray) -> BoolArray:
        """Return a mask of the places outside the fence."""
        outside = np.zeros(len(flown_m), dtype=np.bool_)
        for area in self._areas:
            outside |= area.contains(flown_m, self._frame) != area.stay_in
        return outside

    def _outside(self, item: Item, areas: Sequence[Area]) -> tuple[str, str] | None:
        """Return the bound that an item is out of, and the problem in words."""
        if not math.isfinite(item.z_m):
            return "height", "has no height"
        ceiling_m = self._ceiling_m
        if ceiling_m and item.frame in _RELATIVE and item.z_m > ceiling_m + _ROUNDING_M:
            return "ceiling", f"is {item.z_m:.0f} m high, above the fence's ceiling of {ceiling_m:g} m"
        position_m = self._frame.to_local(item.x * 1e-7, item.y * 1e-7)
        if not self._zones.grid.contains(position_m, _PLACE_ROUNDING_M):
            return "map", "lies outside the map"
        if any(self._contains(area, position_m) != area.stay_in for area in areas):
            return "fence", "lies outside the fence"
        return None

    def _contains(self, area: Area, position_m: tuple[float, float]) -> bool:
        return bool(area.contains(np.array([position_m]), self._frame)[0])


def _heights_msl_m(items: Sequence[Item], begin_msl_m: float, home_msl_m: float) -> FloatArray:
    """Return the height of a vehicle, then those of items, above mean sea level."""
    above = [item.z_m + home_msl_m * (item.frame in _RELATIVE) for item in items]
    return np.array([begin_msl_m, *above])


def _is_blocked(grid: Grid, flown_m: FloatArray) -> BoolArray:
    """Return a mask of the places in blocked cells; none is outside the map."""
    cells = np.round((flown_m - grid.origin_m) / grid.spacing_m).astype(np.int64)
    rows, cols = grid.blocked.shape
    col, row = cells.T
    is_on_map = (col >= 0) & (col < cols) & (row >= 0) & (row < rows)
    blocked: BoolArray = is_on_map & grid.blocked[np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1)]
    return blocked


def _part(items: Sequence[Item], index: int) -> str:
    """Return the part of a flight that leads to an item, in words."""
    match items[index].command:
        case dialect.MAV_CMD_NAV_TAKEOFF:
            return "its climb"
        case dialect.MAV_CMD_NAV_LOITER_UNLIM:
            return "its loiter circle"
        case dialect.MAV_CMD_NAV_LAND:
            return "its landing approach"
    return f"its flight to point {index + 1} of {len(items)}"
