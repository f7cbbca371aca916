"""Avoidance: one of two vehicles that come too near to each other holds until they are apart.

The monitor finds the pair (`gcs.core.separation.monitor`). A vehicle may hold while it flies its mission for
this service, or has arrived, and circles at its target or comes home: not in a take-off or the descent of a
landing, and never against a pilot, a failsafe, an order or another station. Both choices are simulated, and
compared with flying on. The hold that keeps its vehicle farthest from all others begins, if it is an
improvement. Of two that are equal, that is the one which keeps its vehicle farther from the other one; else
that of the vehicle with more to fly.
Over terrain no vehicle holds where that would lead it out of the flight band. Shortly before a loss of
separation the hold may be a little outside the band, or far above it if separation would be lost; earlier,
too, if then it could not any more.

Two that wait near each other in LOITER, and whose circles overlap, are kept apart by height: one gets a
mission with a circle in a free altitude layer (`gcs.core.replanning.stacked_missions`). One that circles at
its target makes way for a vehicle that others steer (a failsafe, a pilot): by such a mission, or by one with
a circle beside its target.

A vehicle whose mission leads into a no-fly zone holds before it, if the circle is clear of zones, obstacles,
ground and others. It gets a new mission as soon as there is one, and else flies on when the zone is open.

A vehicle that holds for another one keeps its target and its mission. It flies on as soon as that leads
near no other vehicle, and gets a new mission if that takes too long, or if its landing time is taken by then.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import permutations
from typing import Final

from pymavlink.dialects.v20.ardupilotmega import (
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_WAYPOINT,
)

from gcs.config import Config
from gcs.core.airspace.incursion_warning import Incursion
from gcs.core.replanning.stacked_missions import StackedMissions
from gcs.core.separation.aircraft import AirTraffic, is_aircraft
from gcs.core.separation.landing_order import LandingOrder
from gcs.core.separation.look_ahead import Encounter
from gcs.core.separation.minima import LOST_SHARE, layer_step_m
from gcs.core.separation.order_check import LAST_OFF_BAND_M, LATE_OFF_BAND_M, OrderCheck
from gcs.core.separation.predicted_flights import PredictedFlights
from gcs.core.separation.separation_state import Avoidance
from gcs.core.state import Agent
from gcs.core.tasking.mission_builder import (
    flown_points,
    is_hold,
    returns_by_mission,
    route_heights_msl_m,
)
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.command_sender import CommandSender, set_mode
from gcs.mavlink.services.retry import ns
from gcs.model import Authority, Effect, FlightPhase, Notice, NoticeCode, Parameter, Route
from gcs.planning.route_progress import remaining_length_m

_MIN_GAIN: Final = 0.2
"""Share of the minimum distances by which a hold must keep its vehicle farther from others."""
_LEVEL_M: Final = 3.0
"""Difference in height below which neither of two vehicles is the higher one."""
_LATEST_S: Final = 6.0
"""Time before a loss of separation from which a hold may leave the flight band."""
_LATEST_BEFORE_ZONE_S: Final = 8.0
"""Time before a no-fly zone at which a vehicle holds although a new mission is queued."""
_SOON_S: Final = 4.0
"""Time for which a hold may be put off."""
_MIN_HOLD_NS: Final = ns(4.0)
_MAX_HOLD_NS: Final = ns(60.0)
_PERIOD_NS: Final = ns(1.0)
_GIVE_WAY_AGAIN_NS: Final = ns(1.0)
"""Time to the next search for a circle that is clear of a vehicle."""
_MAX_SEARCH_GAP_NS: Final = ns(5.0)
"""Time after which a search begins anew at the first place."""
_STEERED: Final = frozenset({Authority.OURS, Authority.RETURNING, Authority.HELD})
"""Authority over vehicles that fly, or hold, as this service ordered."""
_CONTROLS: Final = frozenset({Authority.OURS, Authority.RETURNING})
_TAKEN: Final = (Authority.COMMANDED, Authority.OVERRIDDEN, Authority.OTHER_STATION)
"""Claims of others, which an order to hold or return hides."""
_PHASES: Final = frozenset({FlightPhase.EN_ROUTE, FlightPhase.RETURNING})
_HOLDING: Final = frozenset({FlightPhase.EN_ROUTE, FlightPhase.AT_TARGET})


class Avoidances:
    """Holds of vehicles that would come near others."""

    def __init__(
        self,
        config: Config,
        fleet: Fleet,
        agents: Mapping[int, Agent],
        tasking: UploadManager,
        order_check: OrderCheck,
        landing_order: LandingOrder,
        air_traffic: AirTraffic,
        stacked_missions: StackedMissions,
    ) -> None:
        self._mission = config.mission
        self._lost_height_m = LOST_SHARE * layer_step_m(config)
        self._stacked = stacked_missions
        self._air_traffic = air_traffic
        self._is_enabled = config.planning.avoidance == "act"
        self._fleet = fleet
        self._agents = agents
        self._tasking = tasking
        self._order_check = order_check
        self._landing_order = landing_order

    def stack(self, encounter: Encounter, flights: PredictedFlights) -> list[Effect]:
        """Send one of two vehicles that circle near each other to a circle that is clear of all others.

        None climbs or descends through the other: the higher one goes up, or the lower one down.
        """
        t_ns = flights.t_ns
        ours = [vehicle for vehicle in encounter.vehicles if vehicle in self._agents]
        stacked = [route for v in ours if (route := self._agents[v].routes.stacked) is not None]
        if not self._is_enabled:
            return []
        may_stack = [] if any(map(is_hold, stacked)) else [v for v in ours if self._may_stack(v, t_ns)]
        for vehicle in sorted(may_stack, key=self._height_m, reverse=True):
            other = _other(encounter, vehicle)
            route = self._stacked.plan_hold(vehicle, flights)
            if route is None or (other in self._agents and self._crosses(vehicle, other, self._end_m(route))):
                continue
            return self._send(route, other, flights)
        return self.make_way(encounter, flights)

    def make_way(self, encounter: Encounter, flights: PredictedFlights) -> list[Effect]:
        """Send a vehicle at its target out of the way of one in RTL, a failsafe or a pilot's hands."""
        for vehicle in encounter.vehicles if self._is_enabled else ():
            other = _other(encounter, vehicle)
            is_pair = vehicle in self._agents and other in self._agents
            if is_pair and self._should_give_way(vehicle, other, flights.t_ns):
                route = self._clear_circle(vehicle, other, flights)
                if route is not None:
                    return self._send(route, other, flights)
        return []

    def _send(self, route: Route, other: int, flights: PredictedFlights) -> list[Effect]:
        """Send a vehicle to a circle that is clear of another one."""
        parameters: dict[str, Parameter] = {
            "other": self._air_traffic.name(other),
            "height_m": self._end_m(route) - self._order_check.intents.ground_m(route.vehicle),
        }
        notice = Notice(flights.t_ns, NoticeCode.CHANGES_LAYER, route.vehicle, parameters)
        sent = self._stacked.send(route, flights.t_ns)
        flights.renew()
        return [notice, *sent]

    def _end_m(self, route: Route) -> float:
        """Return the height above sea level at which a route ends."""
        home_m = self._order_check.intents.ground_m(route.vehicle)
        return float(route_heights_msl_m(route, home_m, self._mission)[-1])

    def _clear_circle(self, vehicle: int, other: int, flights: PredictedFlights) -> Route | None:
        """Search for a circle that is clear of another vehicle, and note the search."""
        separation = self._agents[vehicle].separation
        goes_on = flights.t_ns - separation.circle_searched_t_ns <= _MAX_SEARCH_GAP_NS
        separation.circle_search = separation.circle_search + 1 if goes_on else 0
        separation.circle_searched_t_ns = flights.t_ns
        return self._stacked.plan_clear_circle(vehicle, other, separation.circle_search, flights)

    def _height_m(self, vehicle: int) -> float:
        """Return the height of a vehicle above sea level."""
        state = self._fleet.state(vehicle)
        return -math.inf if state is None else state.alt_msl_m

    def _crosses(self, vehicle: int, other: int, to_msl_m: float) -> bool:
        """Return True if a vehicle would climb or descend through the height of another one."""
        above_m = self._height_m(vehicle) - self._height_m(other)
        return abs(above_m) > _LEVEL_M and above_m * (to_msl_m - self._height_m(other)) < 0.0

    def hold(self, encounter: Encounter, flights: PredictedFlights) -> list[Effect]:
        """Let one vehicle of an encounter hold, if that helps; nothing while one of them holds for the other.

        While one holds for a third vehicle, or before a zone, the other one may hold, too.
        """
        t_ns = flights.t_ns
        pair = [vehicle for vehicle in encounter.vehicles if vehicle in self._agents]
        if not self._is_enabled or self._holds_for_other(encounter):
            return []
        is_late = encounter.after_s <= _LATEST_S
        may_hold = [vehicle for vehicle in pair if self._may_hold(vehicle, is_late=is_late)]
        gains = {vehicle: self._order_check.hold_gain(vehicle, flights) for vehicle in may_hold}
        gains = {v: round(gain, 1) for v, gain in gains.items() if gain >= _MIN_GAIN}
        inside = self._inside(gains, is_late, encounter, flights)
        if not inside:
            return []
        apart_m = {
            v: round(self._order_check.held_apart_m(v, encounter.vehicles, flights), -1) for v in inside
        }
        vehicle = max(inside, key=lambda v: (gains[v], apart_m[v], self._left_m(v), v))
        other = self._air_traffic.name(_other(encounter, vehicle))
        avoidance = self._agents[vehicle].separation.avoidance = Avoidance(other, t_ns)
        parameters: dict[str, Parameter] = {"other": other, "after_s": encounter.after_s}
        notice = Notice(t_ns, NoticeCode.AVOIDS, vehicle, parameters)
        return [notice, *self._command(vehicle, avoidance, LOITER, t_ns)]

    def _inside(
        self, vehicles: Iterable[int], is_late: bool, encounter: Encounter, flights: PredictedFlights
    ) -> list[int]:
        """Return the vehicles that may hold as far as the flight band goes."""
        in_band = self._order_check.circles_in_band
        if is_late:
            is_loss = is_aircraft(encounter.vehicles[1]) or encounter.height_m < self._lost_height_m
            off_band_m = LATE_OFF_BAND_M if is_loss else LAST_OFF_BAND_M
            return [v for v in vehicles if in_band(v, flights, off_band_m)]
        inside = [v for v in vehicles if in_band(v, flights)]
        later_s = encounter.after_s - _LATEST_S
        return inside or [
            v
            for v in vehicles
            if in_band(v, flights, LAST_OFF_BAND_M) and not in_band(v, flights, LATE_OFF_BAND_M, later_s)
        ]

    def _holds_for_other(self, encounter: Encounter) -> bool:
        """Return True if one of two vehicles holds for the other one."""
        for vehicle, other in permutations(encounter.vehicles):
            avoidance = self._agents[vehicle].separation.avoidance if vehicle in self._agents else None
            if avoidance is not None and avoidance.other == self._air_traffic.name(other):
                return True
        return False

    def hold_before_zone(self, incursion: Incursion, t_ns: int) -> list[Effect]:
        """Let a vehicle hold that would soon fly into a no-fly zone; nothing if its circle is not clear.

        While a new mission is on its way it holds later. One whose mission was planned round it flies on.
        """
        vehicle = incursion.vehicle
        agent = self._agents[vehicle]
        separation = agent.separation
        tasking = self._tasking.state
        is_late = incursion.after_s <= _LATEST_BEFORE_ZONE_S and not tasking.is_uploading(vehicle)
        is_due = incursion.after_s > 0.0 and (is_late or not tasking.stage(vehicle))
        comes_home = self._comes_home(vehicle)
        is_underway = self._is_interruptible(vehicle) or (comes_home and self._is_free(vehicle))
        may_hold = self._is_enabled and separation.avoidance is None and is_underway
        leads_round = _flies_wanted(agent) and not agent.routes.is_blocked and not comes_home
        if leads_round or not (is_due and may_hold):
            return []
        if not self._order_check.should_hold_before_zone(vehicle, self._order_check.predict(t_ns)):
            return []
        other = f"no-fly zone {incursion.zone}"
        avoidance = separation.avoidance = Avoidance(other, t_ns, is_before_zone=True)
        is_return = comes_home or returns_by_mission(agent)
        remedy = "" if is_return else ", confirm a plan that leads round it, or return it"
        about: dict[str, Parameter] = {"other": other, "remedy": f"open the zone{remedy}"}
        notice = Notice(t_ns, NoticeCode.HOLDS_BEFORE_ZONE, vehicle, about)
        return [notice, *self._command(vehicle, avoidance, LOITER, t_ns)]

    def is_last_chance(self, encounter: Encounter, flights: PredictedFlights) -> bool:
        """Return True if one of an encounter can hold clear of all others now, and none a little later."""
        ours = [vehicle for vehicle in encounter.vehicles if vehicle in self._agents]
        may_hold = [vehicle for vehicle in ours if self._may_hold(vehicle)]
        clear = self._order_check.holds_clear
        return any(clear(v, flights) for v in may_hold) and not any(
            clear(v, flights, _SOON_S) for v in may_hold
        )

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        avoidance = self._agents[vehicle].separation.avoidance
        if avoidance is None or avoidance.sender is None:
            return []
        avoidance.sender.receive(message)
        return self._progress(vehicle, avoidance.sender, t_ns)

    def poll(self, t_ns: int) -> list[Effect]:
        """Repeat commands; let vehicles fly on that are clear."""
        effects: list[Effect] = []
        flights = self._order_check.predict(t_ns)
        for vehicle, agent in self._agents.items():
            avoidance = agent.separation.avoidance
            if avoidance is None:
                continue
            state = self._fleet.state(vehicle)
            is_held = avoidance.is_before_zone or _wanted(agent) is not None or self._is_done(vehicle)
            if (
                state is None
                or not (is_held and self._is_controlled(vehicle))
                or state.mode not in (AUTO, LOITER)
            ):
                effects += self._end(vehicle, agent.control.reason or "it has no route any more", t_ns)
            elif self._tasking.state.is_uploading(vehicle):
                effects += self._end(vehicle, "it gets a new mission", t_ns)
            elif avoidance.sender is not None and avoidance.sender.outcome is None:
                effects += self._progress(vehicle, avoidance.sender, t_ns)
            elif state.mode == AUTO:
                flies_on = avoidance.is_ending
                effects += self._end(vehicle, "" if flies_on else "it does not obey", t_ns)
            elif t_ns >= avoidance.next_check_t_ns:
                avoidance.next_check_t_ns = t_ns + _PERIOD_NS
                effects += self._check(vehicle, avoidance, flights)
        return effects

    def _may_hold(self, vehicle: int, *, is_late: bool = False) -> bool:
        """Return True if this service may interrupt the mission that a vehicle flies.

        With `is_late` it may also while a new mission waits for its upload, which then comes in LOITER.
        """
        tasking = self._tasking.state
        if self._is_done(vehicle):
            return not tasking.stage(vehicle) and self._is_free(vehicle)
        is_settled = _flies_wanted(self._agents[vehicle]) and not tasking.stage(vehicle)
        waits = is_late and vehicle in tasking.queue
        return (is_settled or waits) and self._is_interruptible(vehicle)

    def _is_interruptible(self, vehicle: int) -> bool:
        """Return True if a vehicle flies a mission of this service, and not in a take-off or a landing."""
        is_in_cruise = self._agents[vehicle].flight.phase in _PHASES
        has_points = bool(self._tasking.onboard_missions.points_ahead(vehicle))
        return is_in_cruise and has_points and self._is_free(vehicle)

    def _is_free(self, vehicle: int) -> bool:
        """Return True if a vehicle in AUTO follows this service alone, and carries out no order."""
        agent = self._agents[vehicle]
        state = self._fleet.state(vehicle)
        is_obeyed = state is not None and state.mode == AUTO and agent.link.liveness == "alive"
        is_free = agent.orders.command is None and agent.orders.waiting is None
        return is_obeyed and is_free and self._is_controlled(vehicle)

    def _is_done(self, vehicle: int) -> bool:
        """Return True if a vehicle has no route to fly on: it stays at its target, or comes home to land."""
        return self._stays_at_target(vehicle) or self._comes_home(vehicle)

    def _comes_home(self, vehicle: int) -> bool:
        """Return True if a vehicle flies its return route, up to the top of its descent, or holds on it.

        It has arrived, or returns by order. A command to hold may take effect behind the top of the descent.
        """
        agent = self._agents[vehicle]
        state = self._fleet.state(vehicle)
        onboard = agent.tasking.onboard if agent.tasking.is_selected else None
        if onboard is None or state is None or agent.flight.phase not in _PHASES:
            return False
        seq = state.mission_seq
        is_behind_route = seq >= onboard.first_point + len(onboard.route.points_m)
        is_sent_home = agent.routes.flown is None and _flies_wanted(agent) and is_behind_route
        has_arrived = agent.perception.status.status == "arrived" and _wanted(agent) is None
        if not (is_sent_home or has_arrived) or onboard.items[-1].command != MAV_CMD_NAV_LAND:
            return False
        is_on_leg = 0 <= seq < len(onboard.items) - 2 and onboard.items[seq].command == MAV_CMD_NAV_WAYPOINT
        may_begin = is_on_leg and not self._climbs_first(vehicle, onboard.route)
        return may_begin or agent.separation.avoidance is not None

    def _stays_at_target(self, vehicle: int) -> bool:
        """Return True if a vehicle has arrived, and flies to the circle at its target or round it.

        Or to that to which it made way. Not if it would climb in a circle before it flies on there.
        """
        agent = self._agents[vehicle]
        onboard = agent.tasking.onboard
        wanted = _wanted(agent)
        stays = onboard is not None and (wanted is None or (is_hold(wanted) and _flies_wanted(agent)))
        if agent.perception.status.status != "arrived" or onboard is None or not stays:
            return False
        is_at_circle = agent.flight.phase is FlightPhase.AT_TARGET
        is_underway = agent.flight.phase is FlightPhase.EN_ROUTE
        ends_so = onboard.items[-1].command == MAV_CMD_NAV_LOITER_UNLIM
        return (is_at_circle or is_underway) and ends_so and not self._climbs_first(vehicle, onboard.route)

    def _may_stack(self, vehicle: int, t_ns: int) -> bool:
        """Return True if a vehicle waits in LOITER, by order or for a mission, and may be moved."""
        agent = self._agents[vehicle]
        state = self._fleet.state(vehicle)
        if state is None or state.mode != LOITER or agent.link.liveness != "alive":
            return False
        is_held = agent.control.authority in (Authority.OURS, Authority.HELD) and not _is_taken(agent)
        is_waiting = is_held and _wanted(agent) is None
        is_free = agent.orders.command is None and agent.orders.waiting is None
        is_settled = not self._tasking.state.stage(vehicle) and not agent.tasking.is_inconsistent
        is_due = is_free and t_ns >= agent.tasking.retry.paused_until_t_ns
        return is_waiting and is_due and is_settled and agent.flight.phase in _HOLDING

    def _should_give_way(self, vehicle: int, other: int, t_ns: int) -> bool:
        """Return True if a vehicle circles at its target, and another one flies what we could not change."""
        is_circling = self._agents[vehicle].flight.phase is FlightPhase.AT_TARGET
        is_at_target = is_circling and self._stays_at_target(vehicle) and self._may_hold(vehicle)
        is_due = t_ns - self._agents[vehicle].separation.circle_searched_t_ns >= _GIVE_WAY_AGAIN_NS
        return is_at_target and is_due and not self._is_steered(other)

    def _is_steered(self, vehicle: int) -> bool:
        """Return True if a vehicle flies, or holds, as this service ordered, and not in RTL."""
        agent = self._agents[vehicle]
        state = self._fleet.state(vehicle)
        flies_ours = agent.control.authority in _STEERED and not _is_taken(agent)
        return flies_ours and state is not None and state.mode in (AUTO, LOITER)

    def _is_controlled(self, vehicle: int) -> bool:
        """Return True if this service alone decides what a vehicle flies."""
        agent = self._agents[vehicle]
        return agent.control.authority in _CONTROLS and not _is_taken(agent)

    def _left_m(self, vehicle: int) -> float:
        """Return the distance that a vehicle has left to fly on its route."""
        agent = self._agents[vehicle]
        route = _wanted(agent)
        state = self._fleet.state(vehicle)
        if route is None or state is None:
            return 0.0
        passed = flown_points(agent, route, state)
        return remaining_length_m(route.points_m, (state.east_m, state.north_m), passed)

    def _check(self, vehicle: int, avoidance: Avoidance, flights: PredictedFlights) -> list[Effect]:
        """Let a vehicle in LOITER fly on, if that leads near no other vehicle, and into no zone."""
        t_ns = flights.t_ns
        held_ns = t_ns - avoidance.since_t_ns
        is_clear = not self._order_check.release_problem(vehicle, flights)
        if avoidance.is_before_zone and not is_clear:
            return []
        is_done = self._is_done(vehicle)
        has_route = is_done or (
            _wanted(self._agents[vehicle]) is not None and not self._needs_new_route(vehicle)
        )
        may_end = held_ns >= _MIN_HOLD_NS and is_clear and has_route
        if may_end and self._landing_order.claim(vehicle, t_ns):
            avoidance.is_ending = True
            return self._command(vehicle, avoidance, AUTO, t_ns)
        routes = self._agents[vehicle].routes
        if is_done or (held_ns < _MAX_HOLD_NS and not (is_clear and held_ns >= _MIN_HOLD_NS)):
            return []
        if self._tasking.state.has_pending(vehicle):  # it waits as long as its vehicle holds
            return self._end(vehicle, "it gets a new mission", t_ns)
        if routes.stacked is not None:
            return []
        routes.drop_flown()
        return self._end(vehicle, "it waits for a new mission", t_ns)

    def _needs_new_route(self, vehicle: int) -> bool:
        """Return True if a vehicle over terrain would climb in a circle to the next point of its route."""
        route = self._agents[vehicle].routes.flown
        return route is not None and self._climbs_first(vehicle, route)

    def _climbs_first(self, vehicle: int, route: Route) -> bool:
        profile = self._fleet.profile(vehicle)
        return route.heights_msl_m is not None and profile is not None and profile.climbs_first

    def _command(self, vehicle: int, avoidance: Avoidance, mode: str, t_ns: int) -> list[Effect]:
        self._tasking.overrides.of(vehicle).note_command(mode)
        before = LOITER if mode == AUTO else ""
        command = set_mode(vehicle, self._fleet.health_of(vehicle).autopilot, mode)
        avoidance.sender = CommandSender.begin(command, t_ns, mode=mode, before=before)
        return self._progress(vehicle, avoidance.sender, t_ns)

    def _progress(self, vehicle: int, sender: CommandSender, t_ns: int) -> list[Effect]:
        self._fleet.forward_next_heartbeat(vehicle)
        return [*self._fleet.address_frames(vehicle, sender.poll(t_ns, self._fleet.encoder(vehicle)))]

    def _end(self, vehicle: int, reason: str, t_ns: int) -> list[Effect]:
        separation = self._agents[vehicle].separation
        avoidance = separation.avoidance
        separation.avoidance = None
        other = "" if avoidance is None else avoidance.other
        return [Notice(t_ns, NoticeCode.AVOIDS_NO_LONGER, vehicle, {"other": other, "reason": reason})]


def _other(encounter: Encounter, vehicle: int) -> int:
    first, second = encounter.vehicles
    return second if vehicle == first else first


def _is_taken(agent: Agent) -> bool:
    """Return True if a pilot or another station has chosen, or commanded, what a vehicle does."""
    return any(claim in agent.control.claims for claim in _TAKEN)


def _wanted(agent: Agent) -> Route | None:
    return agent.routes.flown or agent.routes.stacked


def _flies_wanted(agent: Agent) -> bool:
    """Return True if the onboard mission of a vehicle is that of its newest route."""
    onboard = agent.tasking.onboard
    wanted = _wanted(agent)
    return onboard is not None and wanted is not None and onboard.route.is_same(wanted)
