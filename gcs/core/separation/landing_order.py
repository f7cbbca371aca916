"""Landing order: landings of missions follow one another; who waits, and how long.

A mission that lands goes on by itself, whether or not its vehicle is heard. So the order is part of the
mission: a vehicle that would land at the time of another one waits before, on a circle in its layer, for a
time that is computed when the mission is made (NAV_LOITER_TIME). Each landing has a slot: as long as the
descent and the approach take, and a margin for a turn more on the circle and for wind. The slots of others
follow from what is left of their onboard missions.

The circle is at a corner of the return route, or on a leg of it where the route has no heights of its own.
Where none of these is clear, the route is planned past a place beside its target (`places_beside`).

A descent crosses the layers below its own. So a vehicle lands after those that circle below its descent
until they land, and waits beside the descents of those that land before it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise, product
from typing import Final, TypeAlias

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.config.airframe import AgentAirframe
from gcs.core.state import Agent
from gcs.core.tasking.mission_builder import corners_of
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.mavlink.mission.item_builder import DESCENT_SLOPE
from gcs.mavlink.services.retry import ns
from gcs.model import APPROACH_M, NS_PER_S, FloatArray, LandingWait, Route, read_only, vehicle_name
from gcs.planning.flight_variants import wind_margin_m, windy_flights
from gcs.planning.forward_simulation import Motion, RemainingMission
from gcs.planning.manoeuvres.landing import ReturnRoute
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight
from gcs.planning.wind_triangle import leg_time_s, plausible_wind_m_s

_MARGIN_S: Final = 40.0
_TOLERANCE_NS: Final = ns(20.0)
"""Part of the margin that a slot may be shorter than planned: a new mission keeps its slot between others."""
_SAME_FIELD_M: Final = 2000.0
"""Vehicles whose landing points are farther apart do not wait for each other."""
_MIN_WAIT_S: Final = 20.0
_CIRCLE_MARGIN_M: Final = 60.0
"""Overshoot of a vehicle that enters its circle."""
_DRIFT_S: Final = 8.0
"""Time in which the wind would take a vehicle as far off its circle as it is flown."""
_EXIT_RADII: Final = 1.2
"""Distance from the centre of a circle, in radii, of a point towards which a vehicle can leave it."""
_EXIT_SHARES: Final = (0.8, 1.0, 1.3)
"""Distances from the centre where it may leave the circle, in radii."""
_EXIT_TURNS_RAD: Final = (-0.35, 0.0, 0.35)
"""Angles round the centre from the point of the tangent to where it may leave."""
_EXIT_COURSES_RAD: Final = (-0.2, 0.2)
"""Differences of its course from the bearing of that point."""
_CIRCLE_RADIUS_M: Final = 80.0
"""Radius of a circle that the autopilot sets."""
_PLACE_STEP_M: Final = 50.0
"""Distance of places on a leg at which a vehicle may wait."""
_BESIDE_M: Final = 500.0
"""Distance east and north of the end of a route up to which places are tried."""
_WaitingPlace: TypeAlias = tuple[int, FloatArray]
"""Corner of a return route where a vehicle may wait, as in `LandingWait`, and the route from its end on."""


class LandingOrder:
    """Finds when each vehicle may land."""

    def __init__(self, config: Config, fleet: Fleet, agents: Mapping[int, Agent]) -> None:
        self._config = config
        self._fleet = fleet
        self._agents = agents
        self._frame = config.local_frame
        self._airframes = config.airframes_of_agents

    def wait(self, route: Route, planned: ReturnRoute, grid: Grid, t_ns: int) -> tuple[ReturnRoute, str]:
        """Return a return route with the wait before its landing, and a warning if there is no place to wait.

        The place may be one more point of the route. The slot of the landing is reserved.
        """
        vehicle = route.vehicle
        return_m = np.vstack((route.points_m[-1:], planned.points_m))
        speed_m_s = self._airframes[vehicle].speed_m_s
        flown_s = self._flown_s(route, return_m)
        climb_s = 0.0
        if is_on_ground(self._fleet.state(vehicle), self._fleet.home(vehicle)):
            altitude_rel_m = self._config.takeoff_altitude_rel_m(route.layer)
            climb_s = self._airframes[vehicle].climb_length_m(altitude_rel_m) / speed_m_s
        earliest_ns = t_ns + ns(climb_s + flown_s)
        place_m = (float(return_m[-1, 0]), float(return_m[-1, 1]))
        others = dict(self._landings(vehicle, place_m, t_ns))
        lands_ns = earliest_ns
        before = 0
        descent_m = self._descent_m(vehicle, route.layer, return_m)
        for other, taken_ns in sorted(others.items(), key=lambda item: item[1]):
            slot_ns = ns(max(self._slot_s(vehicle), self._slot_s(other)))
            waits_below = lands_ns < taken_ns and self._waits_below(other, route.layer, descent_m)
            if waits_below or abs(lands_ns - taken_ns) < slot_ns - _TOLERANCE_NS:
                lands_ns = max(lands_ns, taken_ns + slot_ns)
                before = other
        separation = self._agents[vehicle].separation
        separation.landing_t_ns = lands_ns
        separation.landing_wait_m = None
        wait_s = (lands_ns - earliest_ns) / NS_PER_S
        if wait_s <= 0.0:
            return planned, ""
        seconds = round(max(wait_s, _MIN_WAIT_S))
        if route.heights_msl_m is not None and route.wait_m is not None:
            separation.landing_wait_m = route.wait_m  # the circle there is clear of the ground
            return replace(planned, wait=LandingWait(-1, seconds)), ""
        above_m = self._descents_above(route, [v for v, taken_ns in others.items() if taken_ns < lands_ns])
        places = self._corners(return_m)
        if route.heights_msl_m is None:
            places += self._on_legs(route.layer, return_m)
        place = self._place(vehicle, places, grid, above_m)
        if place is None:
            separation.landing_t_ns = earliest_ns
            return planned, (
                f"its landing comes too near to that of agent {vehicle_name(before)} in time, and there is "
                "no clear circle to wait on: hold one until the other is down"
            )
        corner, return_m = place
        separation.landing_wait_m = (float(return_m[corner + 1, 0]), float(return_m[corner + 1, 1]))
        wait = LandingWait(corner, seconds)
        if len(return_m) == len(planned.points_m) + 1:
            return replace(planned, wait=wait), ""
        return replace(planned, points_m=read_only(return_m[1:]), is_straight=False, wait=wait), ""

    def claim(self, vehicle: int, t_ns: int) -> bool:
        """Give a held vehicle the landing time of its onboard mission, flown from now on.

        Returns False if the mission comes too near to another landing: the vehicle needs a new one.
        """
        state = self._fleet.state(vehicle)
        home = self._fleet.home(vehicle)
        if state is None or home is None or is_on_ground(state, home):
            return True
        seq = max(state.mission_seq, 0)
        left_s = self._left_s(vehicle, (state.east_m, state.north_m), seq, is_begun=False)
        if left_s is None:
            return True
        lands_ns = t_ns + ns(left_s)
        routes = self._agents[vehicle].routes
        descent_m = np.zeros((0, 2))
        layer = 0
        if routes.latest is not None and routes.return_m is not None:
            layer = routes.latest.layer
            descent_m = self._descent_m(vehicle, layer, routes.return_m)
        home_m = self._frame.to_local(home.lat_deg, home.lon_deg)
        for other, taken_ns in self._landings(vehicle, home_m, t_ns):
            waits_below = lands_ns < taken_ns and self._waits_below(other, layer, descent_m)
            slot_ns = ns(max(self._slot_s(vehicle), self._slot_s(other)))
            if waits_below or abs(lands_ns - taken_ns) < slot_ns - _TOLERANCE_NS:
                return False
        self._agents[vehicle].separation.landing_t_ns = lands_ns
        return True

    # ------------------------------------------------------------ descents and circles

    def _descent_m(self, vehicle: int, layer: int, return_m: FloatArray) -> FloatArray:
        """Return the part of a return route on which a vehicle is below its layer, (k, 2)."""
        left_m = self._zone_m(layer) + 2.0 * self._airframes[vehicle].turn_radius_m
        points = return_m[-1:]
        for point in return_m[-2::-1]:
            points = np.vstack((point, points))
            left_m -= math.dist(point, points[1])
            if left_m <= 0.0:
                points[0] += (points[1] - point) * min(-left_m / math.dist(point, points[1]), 1.0)
                break
        return points

    def _zone_m(self, layer: int) -> float:
        """Return the length of the descent from a layer and the approach."""
        mission = self._config.mission
        return APPROACH_M + (mission.altitude_rel_m + layer * mission.layer_step_m) / DESCENT_SLOPE

    def _waits_below(self, other: int, layer: int, descent_m: FloatArray) -> bool:
        """Return True if another vehicle waits for its landing in a lower layer, below a descent."""
        place_m = self._agents[other].separation.landing_wait_m
        latest = self._agents[other].routes.latest
        is_lower = place_m is not None and latest is not None and latest.layer < layer
        return is_lower and place_m is not None and self._is_below(other, place_m, descent_m)

    def _is_below(self, vehicle: int, place_m: Point, descent_m: FloatArray) -> bool:
        """Return True if the circle of a vehicle is below a descent; turns may lead beside its legs."""
        airframe = self._airframes[vehicle]
        near_m = self._config.planning.separation_m + airframe.circle_radius_m
        return _distance_m(place_m, descent_m) < near_m + 2.0 * airframe.turn_radius_m

    def _descents_above(self, route: Route, others: Sequence[int]) -> list[FloatArray]:
        """Return the descents of others from layers above that of a route."""
        found = []
        for other in others:
            routes = self._agents[other].routes
            if routes.latest is None or routes.return_m is None or routes.latest.layer <= route.layer:
                continue
            found.append(self._descent_m(other, routes.latest.layer, routes.return_m))
        return found

    def _slot_s(self, vehicle: int) -> float:
        """Return the least time between a landing and that of another vehicle."""
        latest = self._agents[vehicle].routes.latest
        zone_m = self._zone_m(self._config.mission.layers if latest is None else latest.layer)
        return zone_m / self._airframes[vehicle].speed_m_s + _MARGIN_S

    def _corners(self, return_m: FloatArray) -> list[_WaitingPlace]:
        """Return the end of a route, and the corners behind it."""
        return [(corner, return_m) for corner in range(-1, len(return_m) - 3)]

    def _on_legs(self, layer: int, return_m: FloatArray) -> list[_WaitingPlace]:
        """Return places between the points of a return route, before the descent."""
        return [
            (corner, np.insert(return_m, corner + 1, place_m, axis=0))
            for corner, place_m in _places_on_legs(return_m, self._zone_m(layer))
        ]

    def _place(
        self, vehicle: int, places: Sequence[_WaitingPlace], grid: Grid, above_m: Sequence[FloatArray]
    ) -> _WaitingPlace | None:
        """Return the first place with a clear circle; one beside the descents of others is preferred."""

        def is_below(place: _WaitingPlace) -> bool:
            east_m, north_m = place[1][place[0] + 1].tolist()
            return any(self._is_below(vehicle, (east_m, north_m), descent_m) for descent_m in above_m)

        for corner, return_m in sorted(places, key=is_below):
            if self._is_place_clear(vehicle, return_m, corner, grid):
                return corner, return_m
        return None

    def places_beside(self, vehicle: int, end_m: Point, grid: Grid) -> Iterator[Point]:
        """Yield clear places for a wait in sight of the end of a route, the nearest first."""
        reach = round(_BESIDE_M / _PLACE_STEP_M)
        steps = sorted(product(range(-reach, reach + 1), repeat=2), key=lambda step: math.hypot(*step))
        for east, north in steps:
            place_m = end_m[0] + east * _PLACE_STEP_M, end_m[1] + north * _PLACE_STEP_M
            if self._is_circle_clear(vehicle, place_m, grid) and line_of_sight(grid, end_m, place_m):
                yield place_m

    def _is_circle_clear(self, vehicle: int, place_m: Point, grid: Grid) -> bool:
        """Return True if a vehicle can circle at a place."""
        airframe = self._airframes[vehicle]
        room_m = (airframe.loiter_radius_m or _CIRCLE_RADIUS_M) + _CIRCLE_MARGIN_M
        if airframe.wind_m_s > 0.0:
            room_m = max(room_m, airframe.circle_radius_m + _DRIFT_S * airframe.wind_m_s)
        return _is_clear(grid, place_m, room_m)

    def _is_place_clear(self, vehicle: int, return_m: FloatArray, corner: int, grid: Grid) -> bool:
        """Return True if a vehicle can circle at a point of its return route, and leave it in wind."""
        airframe = self._airframes[vehicle]
        east_m, north_m = return_m[corner + 1].tolist()
        return self._is_circle_clear(vehicle, (east_m, north_m), grid) and (
            airframe.wind_m_s == 0.0 or _is_left_clear(grid, airframe, return_m[corner + 1 : -1][:3])
        )

    def _landings(self, vehicle: int, place_m: Point, t_ns: int) -> Iterator[tuple[int, int]]:
        """Yield the other vehicles that will land in the same field, and when."""
        for other, agent in self._agents.items():
            home = self._fleet.home(other)
            status = agent.perception.status.status
            if other == vehicle or self._airframes[other].end != "land" or status == "lost":
                continue
            home_m = (0.0, 0.0) if home is None else self._frame.to_local(home.lat_deg, home.lon_deg)
            if math.dist(home_m, place_m) > _SAME_FIELD_M:
                continue
            lands_ns = self._lands_at(other, t_ns)
            if lands_ns is not None:
                yield other, lands_ns

    def _lands_at(self, vehicle: int, t_ns: int) -> int | None:
        """Return when a vehicle will land: by its onboard mission, or as planned while that is on its way."""
        agent = self._agents[vehicle]
        state = self._fleet.state(vehicle)
        planned_ns = agent.separation.landing_t_ns
        wanted = agent.routes.flown or agent.routes.stacked
        if state is None or (agent.control.suspension is not None and wanted is None):
            return None
        is_flown = state.mode == AUTO and agent.tasking.is_selected and state.mission_seq >= 0
        grounded = is_on_ground(state, self._fleet.home(vehicle))
        onboard = agent.tasking.onboard
        is_newest = onboard is not None and (wanted is None or onboard.route.is_same(wanted))
        if is_newest and is_flown and not grounded:
            left_s = self._left_s(vehicle, (state.east_m, state.north_m), state.mission_seq)
            if left_s is not None:
                return t_ns + ns(left_s)
        return planned_ns if planned_ns > t_ns and (wanted is not None or not grounded) else None

    def _wind_m_s(self, vehicle: int) -> tuple[float, float]:
        """Return the wind that a vehicle in the air reports; none before it does."""
        state = self._fleet.state(vehicle)
        if state is None or is_on_ground(state, self._fleet.home(vehicle)):
            return 0.0, 0.0
        reported_m_s = self._agents[vehicle].link.wind_m_s
        flown = state.ground_speed_m_s, state.course_rad
        return plausible_wind_m_s(reported_m_s, *flown, self._airframes[vehicle].speed_m_s) or (0.0, 0.0)

    def _flown_s(self, route: Route, return_m: FloatArray) -> float:
        """Return the time of a route and its return route; turns take as long as without wind."""
        speed_m_s = self._airframes[route.vehicle].speed_m_s
        flown_m = route.length_m + _length_m(return_m)
        wind_m_s = self._wind_m_s(route.vehicle)
        state = self._fleet.state(route.vehicle)
        if state is None or wind_m_s == (0.0, 0.0):
            return flown_m / speed_m_s
        place_m = state.east_m, state.north_m
        legs_m = np.diff(np.vstack((place_m, route.flown_m, return_m)), axis=0)
        in_wind_s = sum(
            leg_time_s((east_m, north_m), speed_m_s, wind_m_s) for east_m, north_m in legs_m.tolist()
        )
        return flown_m / speed_m_s + in_wind_s - float(np.hypot(*legs_m.T).sum()) / speed_m_s

    def _left_s(self, vehicle: int, place_m: Point, seq: int, *, is_begun: bool = True) -> float | None:
        """Return the time until a vehicle lands by its mission; None if it does not.

        None also for a vehicle that has begun to wait on a circle, or to take off.
        """
        onboard = self._agents[vehicle].tasking.onboard
        left_s = 0.0
        items = () if onboard is None else onboard.items[seq:]
        if not items or items[-1].command != dialect.MAV_CMD_NAV_LAND:
            return None
        if is_begun and items[0].command in (dialect.MAV_CMD_NAV_LOITER_TIME, dialect.MAV_CMD_NAV_TAKEOFF):
            return None  # as planned
        wind_m_s = self._wind_m_s(vehicle)
        for item in items:
            there_m = self._frame.to_local(item.x * 1e-7, item.y * 1e-7)
            leg_m = there_m[0] - place_m[0], there_m[1] - place_m[1]
            left_s += leg_time_s(leg_m, self._airframes[vehicle].speed_m_s, wind_m_s)
            left_s += item.param1 if item.command == dialect.MAV_CMD_NAV_LOITER_TIME else 0.0
            place_m = there_m
        return left_s


def _places_on_legs(return_m: FloatArray, before_end_m: float) -> Iterator[tuple[int, Point]]:
    """Yield the points before places on the legs of a return route, and the places, up to its last part."""
    left_m = _length_m(return_m)
    for corner, (begin_m, end_m) in enumerate(pairwise(return_m.tolist())):
        leg_m = math.dist(begin_m, end_m)
        for k in range(1, math.ceil(leg_m / _PLACE_STEP_M)):
            along_m = k * _PLACE_STEP_M
            if left_m - along_m < before_end_m:
                return
            share = along_m / leg_m
            yield (
                corner,
                (begin_m[0] + share * (end_m[0] - begin_m[0]), begin_m[1] + share * (end_m[1] - begin_m[1])),
            )
        left_m -= leg_m


def _length_m(points_m: FloatArray) -> float:
    points: Sequence[Point] = [(east_m, north_m) for east_m, north_m in points_m.tolist()]
    return math.fsum(map(math.dist, points, points[1:]))


def _distance_m(place_m: Point, points_m: FloatArray) -> float:
    """Return the distance of a place from a line through points, (k, 2)."""
    begins_m = points_m[:-1]
    legs_m = np.diff(points_m, axis=0)
    offsets_m = np.array(place_m) - begins_m
    squares = np.maximum((legs_m**2).sum(axis=1), 1e-9)
    shares = np.clip((offsets_m * legs_m).sum(axis=1) / squares, 0.0, 1.0)
    return float(np.hypot(*(offsets_m - shares[:, None] * legs_m).T).min(initial=math.inf))


def _is_left_clear(grid: Grid, airframe: AgentAirframe, points_m: FloatArray) -> bool:
    """Return True if a vehicle can leave a circle at the first point, and its flights in wind are clear.

    It leaves where its course leads to the second point. Its path is no exact circle in wind.
    """
    turns = corners_of(airframe)
    next_m = tuple((east_m, north_m) for east_m, north_m in points_m[1:].tolist())
    ahead = RemainingMission(next_m, tuple(turns.accept_radii_m(points_m).tolist()))
    for_s = (_length_m(points_m) + 2.0 * math.pi * airframe.circle_radius_m) / max(
        airframe.speed_m_s - airframe.wind_m_s, 1.0
    )
    east_m, north_m = points_m[0].tolist()
    leg_m = math.dist((east_m, north_m), next_m[0])
    bearing = math.atan2(next_m[0][0] - east_m, next_m[0][1] - north_m)
    if leg_m < _EXIT_RADII * airframe.circle_radius_m:
        return False
    for share, turned_rad, off_rad in product(_EXIT_SHARES, _EXIT_TURNS_RAD, _EXIT_COURSES_RAD):
        radius_m = share * airframe.circle_radius_m
        angle = bearing - math.acos(min(radius_m / leg_m, 1.0)) + turned_rad
        place_m = (east_m + radius_m * math.sin(angle), north_m + radius_m * math.cos(angle))
        course_rad = math.atan2(next_m[0][0] - place_m[0], next_m[0][1] - place_m[1]) + off_rad
        rate_rad_s = airframe.speed_m_s / radius_m
        motion = Motion(*place_m, airframe.speed_m_s, course_rad, rate_rad_s, ahead=ahead)
        flights = windy_flights(grid, motion, for_s, turns, airframe.turn_lag_s, wind_margin_m(turns))
        if not all(flight.is_clear for flight in flights):
            return False
    return True


def _is_clear(grid: Grid, place_m: Point, radius_m: float) -> bool:
    """Return True if a circle is clear of obstacles and inside the map."""
    east_m, north_m = place_m
    sides = ((radius_m, 0.0), (-radius_m, 0.0), (0.0, radius_m), (0.0, -radius_m))
    inside = all(grid.contains((east_m + de, north_m + dn)) for de, dn in sides)
    return inside and line_of_sight(grid, place_m, place_m, radius_m)
