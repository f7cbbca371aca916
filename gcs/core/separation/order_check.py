"""Separation of ordered vehicles: what an order to hold, return or resume, or a new mission, leads into.

An order changes what a vehicle flies from where it is: it leaves its layer, or circles at the height of
another vehicle. What it would fly is simulated against what the others fly, and compared with what it flies
now. So is what a new mission would lead through at once. Either is a problem only if it makes things worse.
Circles that overlap at one height count, too, wherever the vehicles are on them: unless the order leads away
from a vehicle that is nearer now.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from gcs.config import Config
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.separation.aircraft import AirTraffic
from gcs.core.separation.conflicts import CLEAR, GROWTH_M, Conflict, Conflicts, nearest_of
from gcs.core.separation.forward_flight import (
    MAX_ROUND_S,
    Flight,
    FlightPaths,
    Goal,
    GoalKind,
    simulate_flights,
)
from gcs.core.separation.ground_ahead import GroundAhead
from gcs.core.separation.intents import Intents
from gcs.core.separation.look_ahead import LOOK_AHEAD_S, encounters
from gcs.core.separation.minima import PREDICTED_SHARE, layer_step_m, min_distance_m
from gcs.core.separation.predicted_flights import PredictedFlights
from gcs.core.separation.zones_ahead import MAX_RETURN_S, ZonesAhead
from gcs.core.tasking.mission_builder import is_hold, route_heights_msl_m
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.model import FloatArray, Route, VehicleState
from gcs.planning.route_progress import points_within

_MIN_POINTS: Final = 8
"""Points of a new mission that count, or more if these are flown in less than `LOOK_AHEAD_S`."""
_OFF_BAND_M: Final = 5.0
"""Distance by which a hold, or the begin of a mission, may leave the flight band."""
LAST_OFF_BAND_M: Final = (10.0, 10.0)
"""Distances by which it may go below and above the band if a hold later would lead farther below, or late."""
LATE_OFF_BAND_M: Final = (10.0, math.inf)
"""The same shortly before separation would be lost."""
_WORSE: Final = 0.1
"""Share of the minimum distances by which an order must bring a vehicle nearer."""
_LATER_S: Final = 18.0
"""Time in which a climb leads a vehicle a layer away."""
_PASSED_S: Final = 5.0
"""Time in which a vehicle that is near for a moment only has passed."""
_HOLD_MARGIN: Final = 1.3
"""Multiple of the minimum distance at which a hold is clear of others: predicted turns are off by 20 m."""
_MISSION_MARGIN: Final = 1.3
"""The same for a new mission, which begins with a turn."""
_CLIMB_LAG_S: Final = 2.5
"""Time until a vehicle that held climbs as its mission asks for."""
_TURNS_BACK_RAD: Final = 2.3
"""Turn to the next point at which a vehicle may turn to either side."""
_JOINED_S: Final = 20.0
"""Time in which a vehicle that held is back on its route, which keeps clear of obstacles."""
_LEAST_STEPS: Final = 2
"""Positions of a predicted flight that give a course at its end."""
_RELEASE_INSIDE_M: Final = 5.0
"""Distance inside the flight band at which it may fly on: it turns later and wider than predicted."""
_RELEASE_MARGIN: Final = 1.5
"""Multiple of the minimum distance at which a vehicle that held may fly on: in wind predictions are off."""


class OrderCheck:
    """Predicts what orders to vehicles in the air lead to."""

    def __init__(self, config: Config, intents: Intents, air_traffic: AirTraffic, zones: NoFlyZones) -> None:
        self.intents = intents
        """What all vehicles fly."""
        self._air_traffic = air_traffic
        self._mission = config.mission
        self._airframes = config.airframes_of_agents
        self._min_m = min_distance_m(config)
        self._min_height_m = PREDICTED_SHARE * layer_step_m(config)
        self._conflicts = Conflicts(self._min_m, self._min_height_m, air_traffic.name)
        self._ground = GroundAhead(config)
        self._zones = ZonesAhead(zones, config.planning.clearance_m)

    def predict(self, t_ns: int) -> PredictedFlights:
        """Return what all vehicles in the air fly, for the checks of one time."""
        return PredictedFlights(self.intents, t_ns)

    def problem(self, vehicle: int, modes: Mapping[int, str], flights: PredictedFlights) -> str:
        """Return which vehicle, or ground, an order would bring a vehicle near to; else empty.

        Empty also if it is no nearer to a vehicle than now.

        Parameters
        ----------
        vehicle : int
            Vehicle of the order.
        modes : mapping of int to str
            Modes that are ordered now, by vehicle; that of the vehicle is among them.
        flights : PredictedFlights
            What all vehicles fly now.
        """
        if vehicle not in flights.states:
            return ""
        ordered = flights.of(vehicle, modes[vehicle])
        is_return = modes[vehicle] == RTL, flights.states[vehicle].mode == RTL
        near_ground = "" if modes[vehicle] == AUTO else self._ground_problem(ordered, modes[vehicle] == RTL)
        return (
            near_ground
            or self._area_problem(vehicle, modes[vehicle], flights)
            or (self._circle_problem(ordered, modes, flights) if modes[vehicle] == RTL else "")
            or self._worse(ordered, flights.of(vehicle), flights.others(vehicle, modes), is_return)
        )

    def _circle_problem(self, ordered: Flight, modes: Mapping[int, str], flights: PredictedFlights) -> str:
        """Return which circle at the end of a mission that of a return overlaps; empty if none."""
        overlaps = [
            *self._conflicts.overlapping(ordered, self._ends(ordered.vehicle, modes, flights), last=True)
        ]
        return f"would {min(overlaps).words}" if overlaps else ""

    def _ends(self, vehicle: int, leaving: Collection[int], flights: PredictedFlights) -> list[Flight]:
        """Return the circles at the ends of missions that return or hold others, however far away they are.

        Without those of vehicles that are led elsewhere now.
        """
        states = flights.states
        others = {v: route for v, route in self.intents.stacked_routes().items() if v in states}
        return [
            replace(flights.of(v), goals=self._stacked(states[v], route, flights.t_ns).goals[-2:])
            for v, route in others.items()
            if v != vehicle and v not in leaving
        ]

    def _area_problem(self, vehicle: int, mode: str, flights: PredictedFlights) -> str:
        """Return which zone or obstacle a mode leads a vehicle to; empty if to none, or as it flies now."""
        return self._zones.mode_problem(mode, flights.of(vehicle, mode), flights.of(vehicle))

    def release_problem(self, vehicle: int, flights: PredictedFlights) -> str:
        """Return what one that holds would come near to if it flew on: a vehicle, the ground, an area.

        Empty also if that is better than to hold on.
        """
        if vehicle not in flights.states:
            return ""
        others = self._others(vehicle, flights)
        led = flights.of(vehicle, AUTO)
        conflicts = [*self._conflicts.met(led, others, is_return=False, margin=_RELEASE_MARGIN)]
        present = flights.of(vehicle)
        below_m, above_m = self._off_band_m(led, _CLIMB_LAG_S)
        present_below_m, present_above_m = self._off_band_m(present)
        if below_m > max(-_RELEASE_INSIDE_M, present_below_m):
            return "would fly below the flight band"
        if above_m > max(_OFF_BAND_M, present_above_m):
            return "would fly above the flight band"
        if self._ground.is_known and abs(led.turn_rad) > _TURNS_BACK_RAD:
            return "would turn back beside its route"
        if zone := self._zones.first(led):
            return f"would fly into no-fly zone {zone}"
        if problem := self._zones.joining_problem(led, present, _JOINED_S):
            return problem
        held = self._nearness(present, others)
        if not conflicts or nearest_of(conflicts) - held > _WORSE:
            return ""
        return f"would {min(conflicts).words}"

    def _off_band_m(self, flight: Flight, lag_s: float = 0.0) -> tuple[float, float]:
        """Return how far a flight goes below and above the flight band; a landing does so by intent."""
        if any(goal.kind is GoalKind.LAND for goal in flight.goals):
            return -math.inf, -math.inf
        return self._ground.off_band_m(flight, LOOK_AHEAD_S, lag_s)

    def should_hold_before_zone(self, vehicle: int, flights: PredictedFlights) -> bool:
        """Return True if a flight leads into a zone, and a hold is clear of areas, the ground and others."""
        if vehicle not in flights.states or not self._zones.first(flights.of(vehicle)):
            return False
        hold = flights.of(vehicle, LOITER)
        for_s = hold.round_s
        is_clear = self._zones.is_on_map(hold, for_s) and not self._zones.problem(
            hold, for_s, self._zones.margin_m
        )
        return (
            is_clear and self.circles_in_band(vehicle, flights) and self.hold_gain(vehicle, flights) > -_WORSE
        )

    def circles_in_band(
        self,
        vehicle: int,
        flights: PredictedFlights,
        off_band_m: tuple[float, float] = (_OFF_BAND_M, _OFF_BAND_M),
        after_s: float = 0.0,
    ) -> bool:
        """Return True if a vehicle that holds now, or after some time, stays inside the flight band.

        `off_band_m`: distances by which it may go below and above the band.
        """
        if vehicle not in flights.states:
            return True
        before = simulate_flights([flights.of(vehicle)], after_s)
        below_m, above_m = self._departures_m(self._hold_behind(before, vehicle, flights))
        return below_m <= off_band_m[0] and above_m <= off_band_m[1]

    def _hold_behind(self, before: FlightPaths, vehicle: int, flights: PredictedFlights) -> Flight:
        """Return the flight of a vehicle that holds at the end of a predicted flight."""
        if len(before.east_m) < _LEAST_STEPS:
            return flights.of(vehicle, LOITER)
        state = _at_end(before, flights.states[vehicle], flights.t_ns)
        return self.intents.flight(state, flights.t_ns, LOITER)

    def _departures_m(self, hold: Flight) -> tuple[float, float]:
        return self._ground.departures_m(hold, hold.round_s)

    def _ground_problem(self, flight: Flight, is_return: bool = False) -> str:
        """Return where a flight to its last goal, and round it, comes near the ground; empty if nowhere.

        Others than returns are checked for `MAX_ROUND_S` at most.
        """
        ahead_s = flight.return_s(MAX_RETURN_S) + MAX_ROUND_S if is_return else flight.round_s
        found = self._ground.first(flight, ahead_s)
        if found is None:
            return ""
        return f"would come within {found.agl_m:.0f} m of the ground in {found.after_s:.0f} s"

    def mission_is_clear(self, vehicle: int, t_ns: int) -> bool:
        """Return True if AUTO leads a vehicle neither near the ground nor into a zone from where it is."""
        flights = self.predict(t_ns)
        if vehicle not in {state.system_id for state in self.intents.in_air(t_ns)}:
            return True
        near_ground = self._ground_problem(flights.of(vehicle, AUTO))
        return not (near_ground or self._area_problem(vehicle, AUTO, flights))

    def return_warning(self, vehicles: Collection[int]) -> str:
        """Return which vehicles would return by RTL at one height, in words; empty if none would."""
        return self.intents.return_warning(vehicles)

    def mission_problem(self, route: Route, uploading: Mapping[int, Route], t_ns: int) -> str:
        """Return what a new mission would at once lead a vehicle in the air near to; empty if to nothing.

        That is another vehicle, or the ground: below the flight band, and farther than the present flight.

        Parameters
        ----------
        uploading : mapping of int to Route
            Routes of missions that others are getting now; these count beside their present flights.
        """
        within_m = _MISSION_MARGIN * self._min_m + 2.0 * GROWTH_M
        flying = self.intents.flying_near(route.vehicle, LOOK_AHEAD_S, within_m, t_ns)
        near = {state.system_id: state for state in flying}
        state = near.pop(route.vehicle, None)
        if state is None or self.intents.is_climbing_out(state):
            return ""
        present = self.intents.flight(state, t_ns)
        led = self._led(state, route, t_ns)
        below_m = self._off_band_m(led, _CLIMB_LAG_S)[0]
        if below_m > _OFF_BAND_M and below_m > self._off_band_m(present)[0]:
            return f"would begin {below_m:.0f} m below the flight band"
        others = [self.intents.flight(one, t_ns) for one in near.values()]
        others += self._air_traffic.flights(t_ns)
        begun = [self._led(near[v], one, t_ns) for v, one in uploading.items() if v in near]
        is_return = False, state.mode == RTL
        problem = self._worse(led, present, [*others, *begun], is_return, _MISSION_MARGIN)
        led_away = [one for one in others if one.vehicle not in uploading]
        return problem or self._goes_along(led, present, [*led_away, *begun])

    def _goes_along(self, led: Flight, present: Flight, others: list[Flight]) -> str:
        """Return which vehicle a mission goes along with that the present flight leaves; empty if none.

        Two that climb from one place at one time stay as near to each other as they are. One that another
        passes would follow it, as near as it is passed.
        """
        near = [one for one in others if self._is_near(present, one)]
        passing = [one for one in others if not self._is_near(present, one)]
        along = [
            *self._along(led, present, near, _LATER_S),
            *self._along(led, present, passing, _PASSED_S),
        ]
        return f"would {min(along).words}" if along else ""

    def _along(self, led: Flight, present: Flight, others: list[Flight], from_s: float) -> list[Conflict]:
        """Return the conflicts of a mission after some time that the present flight does not have then."""
        met = [
            one
            for one in self._conflicts.met(led, others, is_return=False, from_s=from_s)
            if one.nearness < 1.0
        ]
        if not met:
            return []
        kept = {one.other for one in self._conflicts.met(present, others, is_return=False, from_s=from_s)}
        return [one for one in met if one.other not in kept]

    def _is_near(self, own: Flight, other: Flight) -> bool:
        away_m = math.dist((own.east_m, own.north_m), (other.east_m, other.north_m))
        return away_m < self._min_m and abs(own.height_m - other.height_m) < self._min_height_m

    def _led(self, state: VehicleState, route: Route, t_ns: int) -> Flight:
        """Return the begin of the flight on a route that a vehicle gets now."""
        reach_m = self.intents.reach_m(state, LOOK_AHEAD_S)
        count = points_within(route.flown_m, (state.east_m, state.north_m), reach_m)
        legs = self._legs(route, route.flown_m[: max(count, _MIN_POINTS)])
        climb = tuple(self.intents.first_climb(state, legs[0].height_m))
        delay_s = 0.0 if climb else self.intents.mission_delay_s(route.vehicle)
        goals = (*climb, *legs, Goal(GoalKind.KEEP))
        return replace(self.intents.flight(state, t_ns), goals=goals, delay_s=delay_s)

    def hold_gain(self, vehicle: int, flights: PredictedFlights) -> float:
        """Return how much farther from all others a vehicle stays if it holds now, as a share of the minimum.

        Negative if a hold leads it nearer.
        """
        if vehicle not in flights.states:
            return 0.0
        held = flights.of(vehicle, LOITER)
        present = flights.of(vehicle)
        if self._ground_problem(held) or self._zones.hold_problem(held, present):
            return -math.inf
        others = self._others(vehicle, flights)
        return self._nearness(held, others) - self._nearness(present, others)

    def held_apart_m(self, vehicle: int, pair: Collection[int], flights: PredictedFlights) -> float:
        """Return the least horizontal distance of a pair if one vehicle holds now, and the other flies on.

        Infinite if the other one is no vehicle of this mission.
        """
        (other,) = (v for v in pair if v != vehicle)
        if other not in flights.states:
            return math.inf
        led = [flights.of(vehicle, LOITER), flights.of(other)]
        paths = simulate_flights(led, LOOK_AHEAD_S)
        return float(np.hypot(np.diff(paths.east_m), np.diff(paths.north_m)).min())

    def holds_clear(self, vehicle: int, flights: PredictedFlights, after_s: float = 0.0) -> bool:
        """Return True if a hold that begins after some time is in the flight band and clear of all others."""
        state = flights.states.get(vehicle)
        if state is None:
            return False
        before = simulate_flights([flights.of(vehicle)], after_s)
        hold = self._hold_behind(before, vehicle, flights)
        if max(self._departures_m(hold)) > _OFF_BAND_M or self._zones.hold_problem(hold, flights.of(vehicle)):
            return False
        others = self._others(vehicle, flights)
        if any(self._conflicts.overlapping(hold, others)):
            return False
        reach_m = self.intents.reach_m(state, LOOK_AHEAD_S) + _HOLD_MARGIN * self._min_m
        place_m = (state.east_m, state.north_m)
        near = [
            one
            for one in others
            if math.dist(place_m, (one.east_m, one.north_m)) <= reach_m + one.reach_m(LOOK_AHEAD_S)
        ]
        own = before.joined(simulate_flights([hold], LOOK_AHEAD_S - after_s))
        paths = own.beside(simulate_flights(near, LOOK_AHEAD_S))
        found = encounters(paths, _HOLD_MARGIN * self._min_m, self._min_height_m, growth_m_s=0.0)
        return not any(vehicle in one.vehicles for one in found)

    def _others(self, vehicle: int, flights: PredictedFlights) -> list[Flight]:
        """Return what all others than a vehicle fly now, and aircraft."""
        return [*flights.others(vehicle, {}), *self._air_traffic.flights(flights.t_ns)]

    def _nearness(self, own: Flight, others: list[Flight]) -> float:
        return nearest_of(
            [*self._conflicts.met(own, others, is_return=False), *self._conflicts.overlapping(own, others)]
        )

    def stacking_problem(
        self,
        route: Route,
        planned: Mapping[int, Route],
        modes: Mapping[int, str],
        flights: PredictedFlights,
        *,
        circles_only: bool = False,
        is_strict: bool = False,
    ) -> str:
        """Return what a return or a hold by a mission would lead a vehicle near to; empty if nothing.

        That is another vehicle, or of a return a no-fly zone that its circle meets.

        Parameters
        ----------
        route : Route
            Route of the vehicle, which circles at its end.
        planned : mapping of int to Route
            The same of others that get such missions at this time.
        modes : mapping of int to str
            Modes that are ordered now, by vehicle.
        flights : PredictedFlights
            What all vehicles fly now.
        circles_only : bool
            True if the circle at its end alone is checked.
        is_strict : bool
            True if its way there must keep clear of all. Else it is no problem with a vehicle that its
            present flight comes as near to.
        """
        states = flights.states
        own = self._stacked(states[route.vehicle], route, flights.t_ns)
        led = {v: self._stacked(states[v], one, flights.t_ns) for v, one in planned.items() if v in states}
        others = flights.others(route.vehicle, modes, led)
        if not is_hold(route) and (problem := self._zones.circle_problem(own.goals[-1])):
            return problem
        ends = self._ends(route.vehicle, {*planned, *modes}, flights)
        conflicts = [*self._conflicts.overlapping(own, [*others, *ends], last=True)]
        if not conflicts and not circles_only:
            present = flights.of(route.vehicle)
            met = () if is_strict else self._conflicts.met(present, others, True, _MISSION_MARGIN)
            now = {one.other: one.nearness for one in met}
            conflicts = [
                one
                for one in self._conflicts.met(own, others, True, _MISSION_MARGIN)
                if one.nearness < now.get(one.other, CLEAR) - _WORSE
            ]
        return f"would {min(conflicts).words}" if conflicts else ""

    def _stacked(self, state: VehicleState, route: Route, t_ns: int) -> Flight:
        """Return the flight of a vehicle that returns or holds by a mission."""
        legs = self._legs(route, route.flown_m)
        radius_m = self._airframes[route.vehicle].circle_radius_m
        circle = replace(legs[-1], kind=GoalKind.CIRCLE, radius_m=radius_m)
        waypoints = legs[: len(route.points_m)]
        climb = self.intents.first_climb(state, legs[0].height_m)
        return replace(self.intents.flight(state, t_ns), goals=(*climb, *waypoints, circle))

    def _legs(self, route: Route, points_m: FloatArray) -> list[Goal]:
        mission = self._mission
        heights_m = route_heights_msl_m(route, self.intents.ground_m(route.vehicle), mission)
        return [
            Goal(GoalKind.WAYPOINT, east_m, north_m, mission.accept_radius_m, height_m)
            for (east_m, north_m), height_m in zip(points_m.tolist(), heights_m.tolist(), strict=False)
        ]

    def _worse(
        self,
        changed: Flight,
        present: Flight,
        others: list[Flight],
        is_return: tuple[bool, bool],
        margin: float = 1.0,
    ) -> str:
        """Return which vehicle a changed flight comes near to; empty if none, or no nearer than the present.

        Parameters
        ----------
        is_return : tuple of bool
            True for a return, of the changed and of the present flight.
        margin : float
            Multiple of the minimum distance at which it is near to a vehicle that it meets.
        """
        if not others:
            return ""
        led = (
            [*self._conflicts.met(changed, others, is_return[0], margin)],
            [*self._conflicts.overlapping(changed, others)],
        )
        if not any(led):
            return ""
        now = (
            [*self._conflicts.met(present, others, is_return[1], margin)],
            [*self._conflicts.overlapping(present, others)],
        )
        meets, overlaps = (nearest_of(one) - nearest_of(other) for one, other in zip(led, now, strict=True))
        if meets < -_WORSE:
            return f"would {min(led[0]).words}"
        if is_return[0]:  # it stays there: to leave another vehicle is no reason to circle with a third
            before = {one.other: one.nearness for one in now[1]}
            stays = [one for one in led[1] if one.nearness < before.get(one.other, CLEAR) - _WORSE]
            return f"would {min(stays).words}" if stays else ""
        return f"would {min(led[1]).words}" if overlaps < -_WORSE and meets < _WORSE else ""


def _at_end(paths: FlightPaths, state: VehicleState, t_ns: int) -> VehicleState:
    """Return the state of a vehicle at the end of its predicted flight, as if it were now."""
    east_m, north_m = (float(one[-1, 0]) for one in (paths.east_m, paths.north_m))
    course_rad = math.atan2(east_m - float(paths.east_m[-2, 0]), north_m - float(paths.north_m[-2, 0]))
    height_m = float(0.5 * (paths.low_m[-1, 0] + paths.high_m[-1, 0]))
    return replace(
        state, t_ns=t_ns, east_m=east_m, north_m=north_m, alt_msl_m=height_m, course_rad=course_rad
    )
