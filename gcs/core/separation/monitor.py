"""Separation monitor: warnings and alarms of vehicles that come, or are, too near to each other in the air.

Once a second the flights of all vehicles in the air are simulated for `LOOK_AHEAD_S`
(`gcs.core.separation.forward_flight`). A pair that comes too near is told at once, again shortly before, and
when separation is lost: nearer than `planning.separation_m` horizontally and half a layer in height. The
all-clear comes when the pair was well apart for a while.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from gcs.config import Config
from gcs.core.preflight.return_heights import ReturnHeightMonitor
from gcs.core.separation.aircraft import AirTraffic, is_aircraft
from gcs.core.separation.avoidance import Avoidances
from gcs.core.separation.forward_flight import FlightPaths, simulate_flights
from gcs.core.separation.intents import Intents
from gcs.core.separation.look_ahead import GROWTH_M_S, LOOK_AHEAD_S, Encounter, encounters
from gcs.core.separation.minima import (
    AIRCRAFT_HEIGHT_M,
    AIRCRAFT_M,
    LOST_SHARE,
    PREDICTED_SHARE,
    layer_step_m,
    min_distance_m,
)
from gcs.core.separation.predicted_flights import PredictedFlights
from gcs.core.separation.separation_state import Approach
from gcs.core.state import State
from gcs.geo import wrap_pi
from gcs.mavlink.autopilots.modes import LOITER
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Effect, Notice, NoticeCode, Parameter, VehicleState

WARNING_TIMES_S: Final = (LOOK_AHEAD_S, 10.0)
"""Times before a loss of separation at which it is told."""
_PERIOD_NS: Final = ns(1.0)
_APART_NS: Final = ns(5.0)
_AGAIN_NS: Final = ns(10.0)
"""Time from a hold of one of a pair to the next hold, if they still come near each other."""
_HYSTERESIS: Final = 1.5
"""Multiple of the minimum distance at which a pair that was told counts as apart."""
_MIN_TURN_NS = ns(0.75)
_MAX_TURN_NS = ns(3.0)
"""Time between two courses that give a turn rate."""
_MIN_CLIMB_M_S = 1.0
_GRADIENT_GAIN = 0.3
_MAX_HOLD_M: Final = 200.0
"""Distance from the centre of its circle at which a vehicle in LOITER was sent elsewhere."""


class SeparationMonitor:
    """Look-ahead over all pairs of vehicles in the air."""

    def __init__(
        self,
        config: Config,
        intents: Intents,
        return_heights: ReturnHeightMonitor,
        avoidances: Avoidances,
        air_traffic: AirTraffic,
        state: State,
    ) -> None:
        self._avoidances = avoidances
        self._air_traffic = air_traffic
        self._return_heights = return_heights
        self._intents = intents
        self._agents = state.agents
        self._state = state.separation
        self._base_msl_m = config.frame.alt_msl_m
        self._min_m = min_distance_m(config)
        self._step_m = layer_step_m(config)
        self._lost = len(WARNING_TIMES_S) + 1

    def check(self, t_ns: int) -> list[Effect]:
        """Check once a second; return alarms and all-clears."""
        state = self._state
        if t_ns < state.next_check_t_ns:
            return []
        state.next_check_t_ns = t_ns + _PERIOD_NS
        in_air = self._intents.in_air(t_ns)
        for one in in_air:
            self._note(one)
        effects: list[Effect] = [*self._return_heights.check(t_ns)]
        predicted = PredictedFlights(self._intents, t_ns)
        flights = [predicted.of(one.system_id) for one in in_air]
        if len(flights) > 1:
            paths = simulate_flights(flights, LOOK_AHEAD_S)
            for encounter in encounters(paths, self._min_m, PREDICTED_SHARE * self._step_m):
                effects += self._tell(encounter, predicted)
            self._note_still_near(paths, t_ns)
        aircraft = self._air_traffic.flights(t_ns) if flights else []
        if aircraft:
            paths = simulate_flights([*flights, *aircraft], LOOK_AHEAD_S)
            for encounter in encounters(paths, AIRCRAFT_M, AIRCRAFT_HEIGHT_M, growth_m_s=0.0):
                if is_aircraft(encounter.vehicles[1]) and not is_aircraft(encounter.vehicles[0]):
                    effects += self._tell_of_aircraft(encounter, predicted)
        return effects + self._end(t_ns)

    def _note(self, state: VehicleState) -> None:
        """Note the turn rate of a vehicle, where it holds, and its climb in a take-off."""
        seen = self._agents[state.system_id].separation
        place_m = (state.east_m, state.north_m)
        if state.mode != LOITER:
            seen.hold_m = None
        elif seen.hold_m is None or math.dist(seen.hold_m, place_m) > _MAX_HOLD_M:
            seen.hold_m = place_m
        self._intents.note_first_climb(state)
        passed_ns = state.t_ns - seen.t_ns
        if passed_ns < _MIN_TURN_NS:
            return
        turned_rad = wrap_pi(state.course_rad - seen.course_rad)
        seen.rate_rad_s = turned_rad * NS_PER_S / passed_ns if passed_ns <= _MAX_TURN_NS else 0.0
        seen.t_ns = state.t_ns
        seen.course_rad = state.course_rad
        self._intents.note_circle(state)
        if self._intents.is_climbing_out(state) and state.climb_m_s > _MIN_CLIMB_M_S:
            gradient = state.climb_m_s / max(state.ground_speed_m_s, 1.0)
            gain = _GRADIENT_GAIN if seen.climb_gradient else 1.0
            seen.climb_gradient += gain * (gradient - seen.climb_gradient)

    def _tell(self, encounter: Encounter, flights: PredictedFlights) -> list[Effect]:
        t_ns = flights.t_ns
        first, second = (flights.states[vehicle] for vehicle in encounter.vehicles)
        distance_m = math.hypot(first.east_m - second.east_m, first.north_m - second.north_m)
        height_m = abs(first.alt_msl_m - second.alt_msl_m)
        is_lost = distance_m < self._min_m and height_m < LOST_SHARE * self._step_m
        stage = self._lost if is_lost else sum(encounter.after_s <= at_s for at_s in WARNING_TIMES_S)
        approach = self._state.approaches.get(encounter.vehicles)
        if approach is None:
            # An early warning needs a second look: courses in a turn mislead.
            approach = self._state.approaches[encounter.vehicles] = Approach(0, t_ns)
            if stage == 1:
                return []
        approach.seen_t_ns = t_ns
        if stage == 1 and encounter.distance_m > self._min_m:
            # Far ahead, and near only as predictions go: not told yet, but a new mission takes its time.
            return self._avoidances.make_way(encounter, flights)
        if is_lost and (approach.nearest_m is None or distance_m < approach.nearest_m):
            approach.nearest_m = distance_m
            approach.nearest_height_m = height_m
        avoided = self._avoid(encounter, approach, stage, flights)
        if stage <= approach.stage:
            return avoided
        approach.stage = stage
        parameters: dict[str, Parameter] = {"other": encounter.vehicles[1], **self._figures(encounter)}
        if is_lost:
            parameters |= {"distance_m": distance_m, "height_m": height_m}
        code = NoticeCode.SEPARATION_LOST if is_lost else NoticeCode.COMES_NEAR
        return [Notice(t_ns, code, encounter.vehicles[0], parameters), *avoided]

    def _tell_of_aircraft(self, encounter: Encounter, flights: PredictedFlights) -> list[Effect]:
        t_ns = flights.t_ns
        vehicle, number = encounter.vehicles
        approach = self._state.approaches.setdefault(encounter.vehicles, Approach(0, t_ns))
        approach.seen_t_ns = t_ns
        stage = sum(encounter.after_s <= at_s for at_s in WARNING_TIMES_S)
        avoided = self._avoid(encounter, approach, stage, flights)
        if stage <= approach.stage:
            return avoided
        approach.stage = stage
        approach.name = self._air_traffic.name(number)
        parameters: dict[str, Parameter] = {"aircraft": approach.name, **self._figures(encounter)}
        return [Notice(t_ns, NoticeCode.AIRCRAFT_NEAR, vehicle, parameters), *avoided]

    def _avoid(
        self, encounter: Encounter, approach: Approach, stage: int, flights: PredictedFlights
    ) -> list[Effect]:
        """Keep one of a pair apart from the other; for an aircraft once, since ADS-B can be forged."""
        t_ns = flights.t_ns
        before_t_ns = approach.avoided_t_ns
        if before_t_ns is not None and is_aircraft(encounter.vehicles[1]):
            return []
        effects = self._avoidances.stack(encounter, flights)
        is_due = stage > 1 or self._avoidances.is_last_chance(encounter, flights)
        if not effects and is_due and (before_t_ns is None or t_ns - before_t_ns >= _AGAIN_NS):
            effects = self._avoidances.hold(encounter, flights)
        if effects:
            approach.avoided_t_ns = t_ns
        return effects

    def _figures(self, encounter: Encounter) -> dict[str, Parameter]:
        east_m, north_m, msl_m = encounter.place_m
        return {
            "distance_m": encounter.distance_m,
            "height_m": encounter.height_m,
            "after_s": encounter.after_s,
            "east_m": east_m,
            "north_m": north_m,
            "place_height_m": msl_m - self._base_msl_m,
        }

    def _note_still_near(self, paths: FlightPaths, t_ns: int) -> None:
        """Note the pairs that were told and are not predicted to be well apart."""
        approaches = self._state.approaches
        if not any(one.stage for one in approaches.values()):
            return
        min_m = _HYSTERESIS * self._min_m
        growth_m_s = _HYSTERESIS * GROWTH_M_S
        for encounter in encounters(paths, min_m, PREDICTED_SHARE * self._step_m, growth_m_s):
            approach = approaches.get(encounter.vehicles)
            if approach is not None and approach.stage:
                approach.seen_t_ns = t_ns

    def _end(self, t_ns: int) -> list[Effect]:
        effects: list[Effect] = []
        approaches = self._state.approaches
        for vehicles in sorted(v for v, one in approaches.items() if t_ns - one.seen_t_ns >= _APART_NS):
            approach = approaches.pop(vehicles)
            if approach.stage == 0:
                continue
            if is_aircraft(vehicles[1]):
                gone: dict[str, Parameter] = {"aircraft": approach.name}
                effects.append(Notice(t_ns, NoticeCode.AIRCRAFT_GONE, vehicles[0], gone))
                continue
            parameters: dict[str, Parameter] = {"other": vehicles[1]}
            if approach.nearest_m is not None:
                parameters["nearest_m"] = approach.nearest_m
                parameters["nearest_height_m"] = approach.nearest_height_m
            effects.append(Notice(t_ns, NoticeCode.APART_AGAIN, vehicles[0], parameters))
        return effects

    @property
    def near(self) -> Iterable[tuple[int, int]]:
        """Pairs that were told and are not apart again."""
        return [
            pair
            for pair, approach in sorted(self._state.approaches.items())
            if approach.stage and not is_aircraft(pair[1])
        ]
