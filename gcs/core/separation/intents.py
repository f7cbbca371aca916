"""What each vehicle in the air will fly, as far as telemetry and its onboard mission tell.

* AUTO with a verified mission: its items, from the current one on.
* RTL: straight to the nearest rally point, or home, at its return height, and round a circle there. A PX4
  descends in that circle to RTL_DESCEND_ALT, if that is lower. With a landing in its mission, and RTL_TYPE
  1, it climbs to its return height where it is and lands by its mission.
* A PX4 that begins a mission in the air climbs in a circle where it is, if the first point is higher by more
  than `FIRST_CLIMB_M`. The climb goes on if it is set to LOITER then.
* LOITER: a circle round the place where it began.
* Circles have the radius, and the side, of the vehicle's last one; before that those of its parameter, or
  60 m, to the right.
* Other modes, or an unknown mission: turn rate and vertical speed are kept.

The wind is the vehicle's own estimate (WIND, WIND_COV); without one it counts as none.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.config.airframe import density_ratio
from gcs.core.preflight.return_heights import ReturnHeightMonitor
from gcs.core.separation.forward_flight import (
    CLIMB_M_S,
    STEP_S,
    Flight,
    Goal,
    GoalKind,
)
from gcs.core.separation.separation_state import FirstClimb
from gcs.core.state import Agent
from gcs.core.tasking.upload_latency import DELIVERY_S, late_s
from gcs.fence import rally_of
from gcs.geo import wrap_pi
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.mavlink.mission.items import Item
from gcs.model import NS_PER_S, Route, VehicleState
from gcs.planning.circle_guidance import commanded_radius_m
from gcs.planning.wind_triangle import airspeed_m_s, plausible_wind_m_s

_G_M_S2: Final = 9.80665
_MAX_AGE_S: Final = 10.0
"""Age of a position beyond which a vehicle is not predicted; its link is down by then."""
_MIN_ITEMS: Final = 8
_AHEAD_S: Final = 40.0
"""Items that are flown sooner count, and at least `_MIN_ITEMS`: over terrain waypoints are close together."""
_CIRCLE_RADIUS_M: Final = 60.0
"""Default WP_LOITER_RAD of ArduPlane."""
_RETURN_HEIGHT_M: Final = 100.0
"""Default RTL_ALTITUDE of ArduPlane, for a vehicle that did not tell its own."""
_STRAIGHT_RAD_S: Final = 0.03
_SETTLED: Final = 0.1
"""Relative difference of the distance from the centre and the radius of a turn on a circle.

Where a vehicle joins it, they differ more.
"""
_TANGENT: Final = 0.95
"""Sine of the angle between course and radius on a circle."""
_MAX_RADIUS_M: Final = 150.0
"""A circle as large as this is part of another turn."""
_ARRIVED: Final = 1.3
"""Distance from the centre of a circle, in radii, within which a vehicle has reached it."""
_LEVEL_M_S: Final = 0.7
FIRST_CLIMB_M: Final = 10.0
"""Default NAV_FW_ALT_RAD of PX4."""
_FIRST_CLIMB_M_S: Final = 3.0
"""Default FW_T_CLMB_R_SP of PX4."""
_MODE_DELAY_S: Final = 0.3
"""Time from an order to hold until the autopilot changes its mode."""
_TURN_DELAY_S: Final = 0.75
"""Time from the delivery of a mission until the vehicle turns to its first point at its full turn rate."""
_HOLD_BANK_DEG: Final = 38.0
"""Limit of the bank in a turn to a hold: autopilots bank more than routes are planned with."""
_PLACES: Final = 16_384
"""Homes and mission items whose places are kept: those of a thousand vehicles."""
_KINDS: Final = {
    dialect.MAV_CMD_NAV_WAYPOINT: GoalKind.WAYPOINT,
    dialect.MAV_CMD_NAV_TAKEOFF: GoalKind.CLIMB,
    dialect.MAV_CMD_NAV_LAND: GoalKind.LAND,
    dialect.MAV_CMD_NAV_LOITER_UNLIM: GoalKind.CIRCLE,
    dialect.MAV_CMD_NAV_LOITER_TIME: GoalKind.CIRCLE,
}


class Intents:
    """Predicted flights of all vehicles in the air, or about to take off."""

    def __init__(
        self,
        config: Config,
        fleet: Fleet,
        agents: Mapping[int, Agent],
        return_heights: ReturnHeightMonitor,
    ) -> None:
        self._fleet = fleet
        self._agents = agents
        self._return_heights = return_heights
        self._frame = config.local_frame
        self._to_local = lru_cache(_PLACES)(config.local_frame.to_local)
        self._airframes = config.airframes_of_agents
        self._rally = [
            (*config.local_frame.to_local(point.lat_deg, point.lon_deg), float(point.alt_rel_m))
            for point in rally_of(config)
        ]

    def in_air(self, t_ns: int) -> list[VehicleState]:
        """Return the vehicles in the air whose positions are fresh enough."""
        return self._in_air(self._fleet.states(), t_ns)

    def flying(self, t_ns: int) -> list[VehicleState]:
        """Return the vehicles in the air, and those that are about to take off."""
        return self._flying(self._fleet.states(), t_ns)

    def flying_near(self, vehicle: int, for_s: float, distance_m: float, t_ns: int) -> list[VehicleState]:
        """Return those of `flying` that may come within a distance of a vehicle; itself, if it is one."""
        own = self._fleet.state(vehicle)
        if own is None:
            return []
        reach_m = self._reach_m(own, for_s, t_ns) + distance_m
        place_m = (own.east_m, own.north_m)
        near = [
            state
            for state in self._fleet.states()
            if math.dist(place_m, (state.east_m, state.north_m))
            <= reach_m + self._reach_m(state, for_s, t_ns)
        ]
        return self._flying(near, t_ns)

    def _in_air(self, states: Iterable[VehicleState], t_ns: int) -> list[VehicleState]:
        return [
            state
            for state in states
            if _is_fresh(state, t_ns)
            and state.mode
            and not is_on_ground(state, self._fleet.home(state.system_id))
        ]

    def _flying(self, states: Sequence[VehicleState], t_ns: int) -> list[VehicleState]:
        in_air = self._in_air(states, t_ns)
        found = {state.system_id for state in in_air}
        return in_air + [
            state
            for state in states
            if state.system_id not in found
            and _is_fresh(state, t_ns)
            and state.armed
            and self.is_climbing_out(state)
        ]

    def _reach_m(self, state: VehicleState, for_s: float, t_ns: int) -> float:
        """Return an upper bound of the distance of a vehicle from its last position after some time."""
        for_s += max(t_ns - state.t_ns, 0) / NS_PER_S
        wind_m_s = math.hypot(*(self._agents[state.system_id].link.wind_m_s or (0.0, 0.0)))
        return for_s * max(
            state.ground_speed_m_s + 2.0 * wind_m_s, self._airframes[state.system_id].speed_m_s
        )

    def flight(self, state: VehicleState, t_ns: int, mode: str | None = None) -> Flight:
        """Return what a vehicle flies, or would fly in another mode."""
        speed_m_s = max(state.ground_speed_m_s, 1.0)
        wind_m_s = self._wind_m_s(state)
        if is_on_ground(state, self._fleet.home(state.system_id)):
            speed_m_s = self._airframes[state.system_id].speed_m_s
            wind_m_s = (0.0, 0.0)
        through_air_m_s = airspeed_m_s(speed_m_s, state.course_rad, wind_m_s)
        rate = self._agents[state.system_id].separation.rate_rad_s
        max_rate = max(self.turn_rate_rad_s(state.system_id, through_air_m_s), abs(rate))
        age_s = max(t_ns - state.t_ns, 0) / NS_PER_S
        if mode == LOITER and state.mode != LOITER:
            state = _after(state, age_s + _MODE_DELAY_S, rate)
            age_s = -_MODE_DELAY_S
            max_rate = max(max_rate, _turn_rate_rad_s(_HOLD_BANK_DEG, through_air_m_s))
        return Flight(
            vehicle=state.system_id,
            east_m=state.east_m,
            north_m=state.north_m,
            height_m=state.alt_msl_m,
            speed_m_s=speed_m_s,
            course_rad=state.course_rad,
            climb_m_s=state.climb_m_s,
            turn_rate_rad_s=rate,
            max_turn_rate_rad_s=max_rate,
            goals=self._goals(state, mode or state.mode),
            age_s=age_s,
            climb_gradient=self.climb_gradient(state.system_id),
            wind_m_s=wind_m_s,
        )

    def _wind_m_s(self, state: VehicleState) -> tuple[float, float]:
        """Return the wind that a vehicle estimates; none where its airspeed would be no such aeroplane's."""
        vehicle = state.system_id
        reported_m_s = self._agents[vehicle].link.wind_m_s
        flown = state.ground_speed_m_s, state.course_rad
        return plausible_wind_m_s(reported_m_s, *flown, self._airframes[vehicle].speed_m_s) or (0.0, 0.0)

    def reach_m(self, state: VehicleState, for_s: float) -> float:
        """Return the greatest distance that a vehicle flies over ground in some time: downwind."""
        wind_m_s = self._wind_m_s(state)
        through_air_m_s = airspeed_m_s(state.ground_speed_m_s, state.course_rad, wind_m_s)
        return for_s * (through_air_m_s + math.hypot(*wind_m_s))

    def _goals(self, state: VehicleState, mode: str) -> tuple[Goal, ...]:
        if mode == RTL:
            return tuple(self._landing(state)) or tuple(self._return(state))
        if mode == LOITER:
            return (self._hold(state),)
        return (tuple(self._mission(state)) if mode == AUTO else ()) or (Goal(GoalKind.DRIFT),)

    def stacked_routes(self) -> dict[int, Route]:
        """Return the routes of missions that return vehicles to a circle, or hold them, in a layer."""
        stacked = {v: agent.routes.stacked for v, agent in self._agents.items()}
        return {
            vehicle: route
            for vehicle, route in stacked.items()
            if route is not None and self._airframes[vehicle].end != "land"
        }

    def return_warning(self, vehicles: Collection[int]) -> str:
        """Return which vehicles would return by RTL at one height, in words; empty if none would."""
        return self._return_heights.warning(vehicles)

    def is_climbing_out(self, state: VehicleState) -> bool:
        """Return True if a vehicle is at the take-off of its mission."""
        first = next(self._mission(state), None) if state.mode == AUTO else None
        return first is not None and first.kind is GoalKind.CLIMB

    def ground_m(self, vehicle: int) -> float:
        """Return the height above sea level of a vehicle's home."""
        return self._home(vehicle)[2]

    def climb_gradient(self, vehicle: int) -> float:
        """Return the vertical speed of a vehicle's take-off climb, by ground speed: as it climbed before."""
        measured = self._agents[vehicle].separation.climb_gradient
        return measured or math.tan(math.radians(self._airframes[vehicle].climb_deg))

    def mission_delay_s(self, vehicle: int) -> float:
        """Return the time until a vehicle turns to the first point of a mission whose upload begins now."""
        return DELIVERY_S + late_s(self._agents[vehicle].tasking) + _TURN_DELAY_S

    def turn_rate_rad_s(self, vehicle: int, speed_m_s: float) -> float:
        """Return the planned turn rate of a vehicle at a speed."""
        return _turn_rate_rad_s(self._airframes[vehicle].bank_deg, speed_m_s)

    def _home(self, vehicle: int) -> tuple[float, float, float]:
        """Return east, north and height above sea level of a vehicle's home."""
        home = self._fleet.home(vehicle)
        if home is None:
            return 0.0, 0.0, self._frame.alt_msl_m
        return (*self._to_local(home.lat_deg, home.lon_deg), home.alt_msl_m)

    def _hold(self, state: VehicleState) -> Goal:
        seen = self._agents[state.system_id].separation
        centre_m = (state.east_m, state.north_m)
        if seen.first_climb is not None:
            return self._circle_up(state, seen.first_climb)
        if state.mode == LOITER and seen.hold_m is not None:
            centre_m = seen.hold_m
        radius_m = self._circle_radius_m(state.system_id, state.alt_msl_m)
        return Goal(GoalKind.CIRCLE, *centre_m, radius_m, state.alt_msl_m)

    def first_climb(self, state: VehicleState, height_msl_m: float) -> Iterator[Goal]:
        """Yield the climb of a vehicle that begins a mission now, with its first point at a height."""
        if self._climbs_first(state, height_msl_m) and self._noted_mode(state) != AUTO:
            yield self._circle_up(state, FirstClimb(state.east_m, state.north_m, height_msl_m))

    def _noted_mode(self, state: VehicleState) -> str:
        """Return the mode at the last look at a vehicle: what it began since is not noted yet."""
        return self._agents[state.system_id].separation.mode or state.mode

    def _climbs_first(self, state: VehicleState, height_msl_m: float) -> bool:
        profile = self._fleet.profile(state.system_id)
        is_below = height_msl_m - state.alt_msl_m > FIRST_CLIMB_M
        on_ground = is_on_ground(state, self._fleet.home(state.system_id))
        return profile is not None and profile.climbs_first and is_below and not on_ground

    def _circle_up(self, state: VehicleState, climb: FirstClimb) -> Goal:
        rate_m_s = state.climb_m_s if state.climb_m_s > _LEVEL_M_S else _FIRST_CLIMB_M_S
        for_s = max(climb.height_msl_m - state.alt_msl_m, 0.0) / rate_m_s + STEP_S
        radius_m = self._circle_radius_m(state.system_id, climb.height_msl_m)
        return Goal(GoalKind.CIRCLE, climb.east_m, climb.north_m, radius_m, climb.height_msl_m, for_s)

    def note_first_climb(self, state: VehicleState) -> None:
        """Note the begin, and the end, of a climb to the first point of a mission."""
        seen = self._agents[state.system_id].separation
        goal = next(self._items(state), None) if state.mode == AUTO else None
        if goal is not None and goal.kind is not GoalKind.CLIMB and seen.mode not in ("", AUTO):
            seen.first_climb = FirstClimb(state.east_m, state.north_m, goal.height_m)
        elif (
            goal is not None
            and seen.first_climb is not None
            and goal.height_m != seen.first_climb.height_msl_m
        ):
            seen.first_climb = None  # another mission, or another point of it
        climb = seen.first_climb
        is_over = climb is not None and not self._climbs_first(state, climb.height_msl_m)
        if is_over or state.mode not in (AUTO, LOITER):
            seen.first_climb = None
        seen.mode = state.mode

    def _circle_radius_m(self, vehicle: int, height_msl_m: float, *, in_return: bool = False) -> float:
        """Return the radius of a circle in LOITER or RTL: as the vehicle's parameter, or as the last one."""
        told_m = self._return_heights.circle_radius_m(vehicle, in_return=in_return)
        seen_m = self._agents[vehicle].separation.radius_m
        if told_m is None and seen_m:
            return commanded_radius_m(seen_m, self._airframes[vehicle].speed_m_s)
        return self._wide_m(vehicle, told_m or _CIRCLE_RADIUS_M, height_msl_m)

    def _mission_radius_m(self, vehicle: int, circle: Goal) -> float:
        """Return the radius of a circle of a mission; one without a radius is flown as in LOITER."""
        if circle.radius_m:
            return self._wide_m(vehicle, circle.radius_m, circle.height_m)
        return self._circle_radius_m(vehicle, circle.height_m)

    def _wide_m(self, vehicle: int, radius_m: float, height_msl_m: float) -> float:
        """Return the radius by which a commanded circle is flown: in thin air ArduPlane widens it."""
        profile = self._fleet.profile(vehicle)
        is_wider = profile is not None and profile.widens_circles
        return radius_m / density_ratio(height_msl_m) if is_wider else radius_m

    def note_circle(self, state: VehicleState) -> None:
        """Note the radius of the circle that a vehicle flies in LOITER or RTL."""
        seen = self._agents[state.system_id].separation
        if state.mode not in (LOITER, RTL) or abs(seen.rate_rad_s) <= _STRAIGHT_RAD_S:
            return
        circle = self._goals(state, state.mode)[-1]
        turned_m = state.ground_speed_m_s / seen.rate_rad_s
        east_m = state.east_m - circle.east_m
        north_m = state.north_m - circle.north_m
        away_m = math.hypot(east_m, north_m)
        outwards = math.atan2(east_m, north_m)
        is_tangent = math.copysign(1.0, turned_m) * math.sin(state.course_rad - outwards) > _TANGENT
        is_settled = abs(away_m - abs(turned_m)) < _SETTLED * away_m and away_m < _MAX_RADIUS_M
        if circle.kind is GoalKind.CIRCLE and is_tangent and is_settled:
            seen.radius_m = math.copysign(away_m, turned_m)

    def _landing(self, state: VehicleState) -> Iterator[Goal]:
        """Yield the return of a vehicle that lands by its mission; nothing if it does not."""
        onboard = self._agents[state.system_id].tasking.onboard
        if onboard is None or not self._return_heights.lands_by_mission(state.system_id):
            return
        landings = [item for item in onboard.items if item.command == dialect.MAV_CMD_NAV_LAND]
        known = self._return_heights.height(state.system_id)
        ground_m = self.ground_m(state.system_id)
        height_m = ground_m + (_RETURN_HEIGHT_M if known is None else known.height_m)
        is_begun = state.mode == RTL and state.climb_m_s < _LEVEL_M_S
        if landings and not is_begun and height_m > state.alt_msl_m:
            climb_s = (height_m - state.alt_msl_m) / CLIMB_M_S
            place_m = (state.east_m, state.north_m)
            radius_m = self._circle_radius_m(state.system_id, height_m)
            yield Goal(GoalKind.CIRCLE, *place_m, radius_m, height_m, climb_s)
        for item in landings[:1]:
            yield self._goal(item, ground_m)

    def _return(self, state: VehicleState) -> Iterator[Goal]:
        """Yield the circle at the return height, and on a PX4 the lower one in which the return ends."""
        east_m, north_m, ground_m = self._home(state.system_id)
        known = self._return_heights.height(state.system_id)
        profile = self._fleet.profile(state.system_id)
        above_m = _RETURN_HEIGHT_M if known is None else known.height_m
        if known is None and state.mode == RTL and abs(state.climb_m_s) < _LEVEL_M_S:
            above_m = state.alt_msl_m - ground_m  # it has reached it
        height_m = ground_m + above_m
        if self._rally:
            east_m, north_m, rally_m = min(
                self._rally, key=lambda point: math.dist(point[:2], (state.east_m, state.north_m))
            )
            height_m = max(height_m, ground_m + rally_m) if known is None else height_m
        if profile is not None and profile.atomic:  # PX4 returns no lower than it is
            height_m = max(height_m, state.alt_msl_m)
        radius_m = self._circle_radius_m(state.system_id, height_m, in_return=True)
        end_m = self._return_heights.circle_height_m(state.system_id)
        away_m = math.dist((state.east_m, state.north_m), (east_m, north_m))
        if end_m is None:
            yield Goal(GoalKind.CIRCLE, east_m, north_m, radius_m, height_m)
            return
        is_there = state.mode == RTL and away_m <= _ARRIVED * abs(radius_m)
        if not is_there or state.climb_m_s > _LEVEL_M_S:
            yield Goal(GoalKind.CIRCLE, east_m, north_m, radius_m, height_m, STEP_S)
        yield Goal(GoalKind.CIRCLE, east_m, north_m, radius_m, min(height_m, ground_m + end_m))

    def _mission(self, state: VehicleState) -> Iterator[Goal]:
        climb = self._agents[state.system_id].separation.first_climb
        for number, goal in enumerate(self._items(state)):
            if number == 0 and state.mode == AUTO and climb is not None:
                yield self._circle_up(state, climb)
            elif number == 0 and goal.kind is not GoalKind.CLIMB:
                yield from self.first_climb(state, goal.height_m)
            yield goal

    def _items(self, state: VehicleState) -> Iterator[Goal]:
        """Yield the items of the onboard mission, from the current one on, that are flown soon."""
        tasking = self._agents[state.system_id].tasking
        profile = self._fleet.profile(state.system_id)
        if tasking.onboard is None or not tasking.is_selected or profile is None or state.mission_seq < 0:
            return
        first = max(state.mission_seq, profile.home_items)
        ground_m = self.ground_m(state.system_id)
        left_m = self.reach_m(state, _AHEAD_S)
        place_m = (state.east_m, state.north_m)
        for number, item in enumerate(tasking.onboard.items[first:]):
            if number >= _MIN_ITEMS and left_m < 0.0:
                return
            if item.command in _KINDS:
                goal = self._goal(item, ground_m)
                if goal.kind is GoalKind.CIRCLE:
                    goal = replace(goal, radius_m=self._mission_radius_m(state.system_id, goal))
                yield goal
                left_m -= math.dist(place_m, (goal.east_m, goal.north_m))
                place_m = (goal.east_m, goal.north_m)

    def _goal(self, item: Item, ground_m: float) -> Goal:
        kind = _KINDS[item.command]
        is_global = item.frame in (dialect.MAV_FRAME_GLOBAL, dialect.MAV_FRAME_GLOBAL_INT)
        radius_m = {GoalKind.WAYPOINT: item.param2, GoalKind.CIRCLE: item.param3}.get(kind, 0.0)
        is_timed = item.command == dialect.MAV_CMD_NAV_LOITER_TIME
        return Goal(
            kind,
            *self._to_local(item.x * 1e-7, item.y * 1e-7),
            radius_m,
            item.z_m + (0.0 if is_global else ground_m),
            item.param1 if is_timed else math.inf,
        )


def _is_fresh(state: VehicleState, t_ns: int) -> bool:
    return t_ns - state.t_ns <= _MAX_AGE_S * NS_PER_S


def _after(state: VehicleState, after_s: float, rate_rad_s: float) -> VehicleState:
    """Return the state of a vehicle that flies on with its turn rate for some time."""
    half = 0.5 * rate_rad_s * after_s
    way_m = max(state.ground_speed_m_s, 1.0) * after_s
    return replace(
        state,
        east_m=state.east_m + way_m * math.sin(state.course_rad + half),
        north_m=state.north_m + way_m * math.cos(state.course_rad + half),
        course_rad=wrap_pi(state.course_rad + 2.0 * half),
    )


def _turn_rate_rad_s(bank_deg: float, airspeed_m_s: float) -> float:
    return _G_M_S2 * math.tan(math.radians(bank_deg)) / airspeed_m_s
