"""Queue of mission uploads: which vehicle gets its mission when, and what a mission waits for.

A newer route for a vehicle supersedes its upload in progress. Other routes wait, the newest of each vehicle,
first come, first served,

* until the upload window of their link admits another (`gcs.core.tasking.upload_window`);
* for an item that their vehicle is about to reach, for `_MAX_ITEM_WAIT_NS` at most;
* for the end of a pause after repeated failures (`gcs.core.tasking.upload_pauses`);
* for the end of their vehicle's climb, or for its turn to take off.

Meanwhile a vehicle flies on. A route that waited longer than planned is planned again when its upload begins.

Uploads in progress are in `gcs.core.tasking.active_uploads`.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from dataclasses import replace
from itertools import islice
from typing import Final

from gcs.config import Config
from gcs.core.airspace.mission_bounds import MissionBoundsCheck
from gcs.core.authority.mode_commands import obeys_other_station
from gcs.core.authority.overrides import Overrides
from gcs.core.separation.mission_traffic import MissionTraffic
from gcs.core.state import Agent
from gcs.core.takeoff.climbs import Climbs
from gcs.core.takeoff.sequence import TakeoffSequence
from gcs.core.tasking.active_uploads import ActiveUploads
from gcs.core.tasking.first_legs import FirstLegs
from gcs.core.tasking.mission_builder import MissionBuilder, points_passed
from gcs.core.tasking.onboard_missions import OnboardMissions
from gcs.core.tasking.rejections import Rejections
from gcs.core.tasking.tasking_state import OnboardMission, QueuedRoute, TaskingState
from gcs.core.tasking.upload_latency import DELIVERY_S, late_s
from gcs.core.tasking.upload_pauses import ClearingRetry, RejectionRetry, UploadRetry
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.mavlink.mission.upload_state import UploadState
from gcs.model import (
    NS_PER_S,
    Authority,
    Effect,
    Notice,
    NoticeCode,
    Route,
    UploadReport,
    VehicleState,
)
from gcs.planning.forward_simulation import Motion, RemainingMission
from gcs.planning.manoeuvres.climb import Climb
from gcs.planning.manoeuvres.landing import ReturnRoute

_MAX_ITEM_WAIT_NS: Final = 5 * NS_PER_S
_MAX_DELAY_NS: Final = NS_PER_S
"""Delay of an upload after which its route is planned again."""
_MAX_TAKEOFF_SHIFT_M: Final = 30.0
"""Distance from the place of a verified take-off within which it still holds."""
_MAX_HOME_SHIFT_M: Final = 20.0
"""Drift of a reported home that does not matter to its return route."""


class UploadManager:
    """Mission uploads to all vehicles.

    Parameters
    ----------
    climbs : Climbs
        Gives the climbs of vehicles on the ground, and checks them.
    bounds : MissionBoundsCheck
        Refuses missions with an item outside the map or the fence.
    takeoffs : TakeoffSequence
        Says why an armed vehicle on the ground must not start yet.
    traffic : MissionTraffic
        Says which vehicle a new mission would lead a vehicle in the air near to.

    Attributes
    ----------
    onboard_missions : OnboardMissions
        Verified missions of vehicles.
    overrides : Overrides
        Overriding modes of vehicles.
    """

    def __init__(
        self,
        config: Config,
        fleet: Fleet,
        agents: Mapping[int, Agent],
        state: TaskingState,
        climbs: Climbs,
        bounds: MissionBoundsCheck,
        takeoffs: TakeoffSequence,
        traffic: MissionTraffic,
    ) -> None:
        self.state = state
        self._table = config.mission
        self._frame = config.local_frame
        self._climbs = climbs
        self._bounds = bounds
        self._takeoffs = takeoffs
        self._traffic = traffic
        self._fleet = fleet
        self._agents = agents
        self._missions = MissionBuilder(config)
        self._default_home = Home(config.frame.lat_deg, config.frame.lon_deg, config.frame.alt_msl_m)
        self.onboard_missions = OnboardMissions(fleet, agents)
        self.overrides = Overrides(self.onboard_missions, agents)
        self._first_legs = FirstLegs(fleet, state.first_legs)
        self._rejections = Rejections(agents)
        self._active = ActiveUploads(
            fleet,
            agents,
            state,
            self.onboard_missions,
            self.overrides,
            self._first_legs,
            self._rejections,
            config.links.max_parallel_uploads,
        )

    # ------------------------------------------------------------ queries

    def may_be_inconsistent(self, vehicle: int) -> bool:
        """Return True if the onboard mission may be inconsistent; never where uploads are atomic."""
        agent = self._agents[vehicle]
        is_unsure = vehicle in self.state.uploads or agent.tasking.is_inconsistent
        return is_unsure and not agent.link.is_atomic

    def may_fly(self, vehicle: int) -> bool:
        """Return True if the verified onboard mission is the one to fly now."""
        agent = self._agents[vehicle]
        onboard = agent.tasking.onboard
        is_stored = onboard is not None and onboard.route.is_same(agent.routes.flown)
        is_suspended = agent.control.suspension is not None
        return is_stored and not is_suspended and not self.state.stage(vehicle)

    def may_take_off(self, vehicle: int) -> bool:
        """Return True if that mission was also verified for a take-off from where the vehicle stands."""
        state = self._fleet.state(vehicle)
        onboard = self._agents[vehicle].tasking.onboard
        if state is None or onboard is None or onboard.takeoff_m is None or not self.may_fly(vehicle):
            return False
        return math.dist(onboard.takeoff_m, (state.east_m, state.north_m)) <= _MAX_TAKEOFF_SHIFT_M

    def forward_simulation(self, vehicle: int, t_ns: int) -> RemainingMission:
        """Return what a vehicle flies until it gets another mission, and when that upload may begin."""
        wait_s = 0.0 if vehicle in self.state.uploads else self._item_wait_s(vehicle, t_ns)
        return self.onboard_missions.forward_simulation(vehicle, wait_s, t_ns)

    def climb(self, vehicle: int, layer: int) -> Climb | None:
        """Return the climb before a vehicle's route; None in flight."""
        return self._climbs.climb(vehicle, layer, in_takeoff=self.onboard_missions.is_in_takeoff(vehicle))

    @property
    def altitude_rel_m(self) -> float:
        """Height of the lowest altitude layer above home."""
        return self._table.altitude_rel_m

    # ------------------------------------------------------------ onboard missions and authority

    def forget_onboard(self, vehicle: int) -> None:
        """Note that the onboard mission of a vehicle is unknown."""
        self._first_legs.end(vehicle)
        tasking = self._agents[vehicle].tasking
        tasking.onboard = None
        tasking.is_inconsistent = False

    def mark_inconsistent(self, vehicle: int) -> None:
        """Mark an onboard mission as inconsistent: the vehicle is held and cleared when it is heard."""
        self._active.mark_inconsistent(vehicle)

    def release_override(self, vehicle: int, t_ns: int) -> None:
        """Take control of a vehicle back, on an operator's order."""
        self.overrides.of(vehicle).release(t_ns)
        tasking = self._agents[vehicle].tasking
        tasking.retry = UploadRetry()
        tasking.clearing = ClearingRetry()
        tasking.rejections = RejectionRetry()

    # ------------------------------------------------------------ uploads

    def enqueue_upload(
        self, route: Route, t_ns: int, return_route: ReturnRoute | None = None, *, at_once: bool = False
    ) -> list[Effect]:
        """Upload a route as a mission, in place of an older one that is queued or in progress.

        Unless `at_once`, it may wait: for the next item, after failures, or for an upload in progress that
        was superseded too often.
        """
        vehicle = route.vehicle
        if (
            self.state.is_uploading(vehicle)
            and self._agents[vehicle].link.high_latency is None
            and not self._is_climbing(vehicle)
            and self._is_clear(route, t_ns, at_once=at_once)
            and (at_once or self._agents[vehicle].tasking.retry.may_supersede(t_ns))
        ):
            self.state.queue.pop(vehicle, None)
            return self._active.supersede(vehicle, t_ns) + self._start(route, t_ns, return_route, t_ns)
        before = self.state.queue.get(vehicle)
        until_t_ns = t_ns if at_once else t_ns + _MAX_ITEM_WAIT_NS
        if before is not None:
            until_t_ns = min(before.until_t_ns, until_t_ns)
            at_once = at_once or before.at_once
        begins_t_ns = t_ns + round(min(self._item_wait_s(vehicle, t_ns) * NS_PER_S, until_t_ns - t_ns))
        self.state.queue[vehicle] = QueuedRoute(route, t_ns, until_t_ns, at_once, return_route, begins_t_ns)
        return self._start_due(t_ns, renewed=False)

    def withdraw_except(self, wanted: Container[int]) -> list[int]:
        """Remove the queued routes of all other vehicles; return these vehicles."""
        unwanted = [vehicle for vehicle in self.state.queue if vehicle not in wanted]
        for vehicle in unwanted:
            self.withdraw(vehicle)
        return unwanted

    def withdraw(self, vehicle: int) -> None:
        """Remove the queued route of a vehicle."""
        del self.state.queue[vehicle]

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        effects = self._rejections.receive(vehicle, message, t_ns)
        effects += self._observe(vehicle, message, t_ns)
        if self.overrides.of(vehicle).taken_by:
            self._first_legs.end(vehicle)
        effects += self._first_legs.receive(vehicle, message, t_ns)
        return effects + self._active.receive(vehicle, message, t_ns)

    def poll(self, t_ns: int, *, renewed: bool = True) -> list[Effect]:
        """Run the timers. Without `renewed`, routes that are `outdated` wait until they are planned again."""
        for vehicle, agent in self._agents.items():
            if Authority.COMMANDED in agent.claims:
                self._fleet.forward_next_heartbeat(vehicle)  # it shows whether it obeyed
        self._rejections.poll(t_ns)
        return self._active.poll(t_ns) + self._first_legs.poll(t_ns) + self._start_due(t_ns, renewed=renewed)

    def resume(self, t_ns: int) -> list[Effect]:
        """Continue the uploads in progress after an outage of the service: read back first."""
        return self._active.resume(t_ns)

    def cancel(self, vehicle: int, t_ns: int) -> None:
        """Send nothing more to a lost vehicle; if it is heard again, an inconsistent mission is cleared."""
        self.state.queue.pop(vehicle, None)
        self._active.supersede(vehicle, t_ns)
        self._agents[vehicle].tasking.retry = UploadRetry()

    def abandon(self, vehicle: int, reason: str, t_ns: int, mode: str) -> list[Effect]:
        """End an upload for an order to a mode; an inconsistent mission is cleared when that is safe."""
        queued = self.state.queue.pop(vehicle, None)
        if vehicle in self.state.uploads:
            return self._active.abandon(vehicle, reason, t_ns, mode)
        return [] if queued is None else self._not_begun(vehicle, reason, t_ns)

    def yield_up(self, vehicle: int, reason: str, t_ns: int) -> list[Effect]:
        """Send no mission any more to a vehicle that another service with our ids commands.

        Its onboard mission is unknown from then on. An upload in progress leaves none that must not be flown.
        """
        queued = self.state.queue.pop(vehicle, None)
        effects = [] if queued is None else self._not_begun(vehicle, reason, t_ns)
        if vehicle in self.state.uploads:
            effects += self._active.yield_up(vehicle, reason, t_ns)
        self._first_legs.end(vehicle)
        self._agents[vehicle].tasking.onboard = None
        return effects

    def _observe(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process reboots, mode changes and mission states of a vehicle."""
        tasking = self._agents[vehicle].tasking
        if self._agents[vehicle].link.boots != tasking.boots:
            return self._rebooted(vehicle, t_ns)
        profile = self._fleet.profile(vehicle)
        is_uploading = vehicle in self.state.uploads
        if profile is None:
            return []
        if message.get_type() == "MISSION_CURRENT":
            is_changing = is_uploading or tasking.is_inconsistent
            self.overrides.observe_completion(vehicle, profile, message, t_ns, is_changing=is_changing)
            if self.overrides.observe_rejection(vehicle, profile, message, t_ns, is_uploading=is_uploading):
                tasking.onboard = None
                notices = self._rejections.begin(vehicle, t_ns)
                text = f"the vehicle's navigator rejects its onboard mission: {tasking.rejections.cause}"
                return [*notices, self._failure(vehicle, text, t_ns)]
        if obeys_other_station(message):
            station = f"system {message.target_system}/{message.target_component}"
            self.overrides.of(vehicle).note_foreign_command(station, t_ns)
        if message.get_type() != "HEARTBEAT":
            return []
        if not is_uploading:  # an upload knows better which mission has come to its end
            self.overrides.observe_mode(vehicle, profile, message, t_ns)
        if profile.atomic:
            tasking.is_inconsistent = False
        if not tasking.is_inconsistent or is_uploading:
            return []
        if not self._may_clear(vehicle, t_ns):
            self._fleet.forward_next_heartbeat(vehicle)
            return []
        empty = self._missions.empty(vehicle)
        items = build_items(profile, empty, self._default_home)
        return self._active.clear(UploadState.of_mission(empty, items, profile, inconsistent=True), t_ns)

    def _may_clear(self, vehicle: int, t_ns: int) -> bool:
        """Return True if an inconsistent mission may be cleared: no other station commands the vehicle.

        One that another service with our ids commands is left alone until it would fly that mission, in AUTO.
        """
        agent = self._agents[vehicle]
        if Authority.SECOND_COMMANDER in agent.claims and agent.link.mode != AUTO:
            return False
        is_returning = agent.control.suspension == "return" and agent.orders.waiting is None
        is_taken = bool(self.overrides.of(vehicle).taken_by) or is_returning
        return not is_taken and agent.orders.command is None and agent.tasking.clearing.is_due(t_ns)

    def _rebooted(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Forget the onboard mission, and restart an upload in progress."""
        agent = self._agents[vehicle]
        is_uploading = vehicle in self.state.uploads
        tasking = agent.tasking
        agent.tasking.boots = agent.link.boots
        tasking.rejections.note_change(t_ns)
        self.overrides.of(vehicle).note_reboot(t_ns)
        self._first_legs.end(vehicle)
        if tasking.onboard is not None and not is_uploading:
            tasking.before_boot = tasking.onboard
        tasking.onboard = None
        tasking.is_selected = True
        return self._active.restart(vehicle, t_ns) if is_uploading else []

    def _item_wait_s(self, vehicle: int, t_ns: int) -> float:
        """Return how long to wait until a vehicle has passed an item; 0 with an inconsistent mission."""
        is_inconsistent = self._agents[vehicle].tasking.is_inconsistent
        return 0.0 if is_inconsistent else self.onboard_missions.item_wait_s(vehicle, t_ns)

    def _is_climbing(self, vehicle: int) -> bool:
        """Return True if a vehicle is in the air in its take-off: a new mission would turn it at once."""
        state = self._fleet.state(vehicle)
        in_air = not is_on_ground(state, self._fleet.home(vehicle))
        return in_air and self.onboard_missions.is_in_takeoff(vehicle)

    def _is_due(self, vehicle: int, t_ns: int) -> bool:
        """Return True if a queued route waits for its link only."""
        queued = self.state.queue[vehicle]
        if not queued.at_once and t_ns < self._agents[vehicle].tasking.retry.paused_until_t_ns:
            return False
        return t_ns >= queued.until_t_ns or not self._item_wait_s(vehicle, t_ns)

    def _start_due(self, t_ns: int, *, renewed: bool) -> list[Effect]:
        """Start the uploads that need not wait any longer; outdated ones only if they are planned again."""
        effects: list[Effect] = []
        for vehicle in self._in_turn():
            queued = self.state.queue[vehicle]
            if (renewed or not _is_outdated(queued, t_ns)) and self._may_start(vehicle, t_ns):
                del self.state.queue[vehicle]
                effects += self._active.supersede(vehicle, t_ns)
                effects += self._start(queued.route, queued.planned_t_ns, queued.return_route, t_ns)
        return effects

    def outdated(self, t_ns: int, count: int) -> list[int]:
        """Return the first vehicles whose queued routes may start now, planned for an earlier begin."""
        queue = self.state.queue
        found = (v for v in self._in_turn() if _is_outdated(queue[v], t_ns) and self._may_start(v, t_ns))
        return list(islice(found, count))

    def _in_turn(self) -> list[int]:
        """Return the vehicles with queued routes: those that wait for traffic last, by their last check."""
        return sorted(self.state.queue, key=self._traffic.last_checked_t_ns)

    def renew_queued(self, vehicle: int, route: Route, return_route: ReturnRoute | None, t_ns: int) -> None:
        """Replace an outdated route by one from where its vehicle is now, or by itself without another."""
        queued = self.state.queue[vehicle]
        planned_t_ns = queued.planned_t_ns if route is queued.route else t_ns
        self.state.queue[vehicle] = replace(
            queued, route=route, planned_t_ns=planned_t_ns, begins_t_ns=t_ns, return_route=return_route
        )

    def _may_start(self, vehicle: int, t_ns: int) -> bool:
        """Return True if a queued route need not wait any longer."""
        queued = self.state.queue[vehicle]
        if not queued.at_once and self._traffic.is_known_to_wait(vehicle, t_ns):
            return False
        agent = self._agents[vehicle]
        is_heard = agent.link.high_latency is None
        is_free = is_heard and self._active.has_capacity(vehicle) and agent.authority.audit is None
        is_due = is_free and not self._is_climbing(vehicle) and self._is_due(vehicle, t_ns)
        return is_due and self._is_clear(queued.route, t_ns, at_once=queued.at_once)

    def _is_clear(self, route: Route, t_ns: int, *, at_once: bool) -> bool:
        """Return True if no other vehicle is in the way of a mission."""
        if self._takeoffs.holds_back(route.vehicle, t_ns):
            return False
        return at_once or not self._traffic.holds_back(route, t_ns)

    def _start(
        self, route: Route, planned_t_ns: int, return_route: ReturnRoute | None, t_ns: int
    ) -> list[Effect]:
        """Make a mission of a route, check it, and start its upload."""
        vehicle = route.vehicle
        fleet = self._fleet
        profile = fleet.profile(vehicle)
        state = fleet.state(vehicle)
        authority = self.overrides.of(vehicle)
        if profile is None:
            return self._not_begun(vehicle, "its firmware is not known here, or it was never heard", t_ns)
        if authority.taken_by:
            return self._not_begun(vehicle, f"not begun: {authority.takeover}", t_ns)
        climb = self.climb(vehicle, route.layer)
        if climb is not None:
            obstruction = self._climbs.obstruction(vehicle, climb, route.points_m)
            if obstruction is not None:
                return self._refused(
                    vehicle, obstruction.code.value, f"the take-off is not clear: {obstruction}", t_ns
                )
        home = fleet.home(vehicle) or self._default_home
        if return_route is not None and self._has_moved(home, return_route):
            return self._not_begun(
                vehicle, "not begun: its home moved after its return route was planned", t_ns
            )
        self.state.mission_count += 1
        mission = self._missions.of(route, self.state.mission_count, state, return_route, climb)
        from_ground = is_on_ground(state, fleet.home(vehicle))
        items = build_items(profile, mission, home, from_ground=from_ground)
        tasking = self._agents[vehicle].tasking
        link = fleet.link(vehicle)
        upload = UploadState.of_mission(
            mission,
            items,
            profile,
            old=None if tasking.onboard is None else tasking.onboard.items,
            inconsistent=tasking.is_inconsistent,
            current=state.mission_seq if state is not None and state.mission_seq >= 0 else None,
            round_trip_s=self._active.round_trip_s(link) or self._agents[vehicle].link.requests.round_trip_s,
        )
        problem = self._bounds.problem(items[profile.home_items :], state)
        if problem is None and state is not None:
            passed = 0 if from_ground else points_passed(route, planned_t_ns, state)
            flown = items[profile.home_items + passed :]
            upload_s = DELIVERY_S + late_s(tasking)
            motion = self.motion(state, t_ns)
            heights_msl_m = state.alt_msl_m, home.alt_msl_m
            wind_m_s = None if from_ground else self._agents[vehicle].link.wind_m_s
            problem = self._bounds.flight_problem(flown, vehicle, motion, upload_s, *heights_msl_m, wind_m_s)
        if problem is not None:
            reason = f"{problem.text}; the vehicle keeps its onboard mission"
            return self._refused(vehicle, problem.kind, reason, t_ns)
        tasking.refusal = ""
        first_point = profile.home_items + int(from_ground)
        takeoff_m = (state.east_m, state.north_m) if from_ground and state is not None else None
        onboard = OnboardMission(route, items, first_point, mission.mission_id, takeoff_m)
        return self._active.start(upload, onboard, planned_t_ns, t_ns)

    def motion(self, state: VehicleState, t_ns: int) -> Motion:
        """Return the motion of a vehicle, and what it flies until it gets another mission."""
        vehicle = state.system_id
        return Motion(
            state.east_m,
            state.north_m,
            state.ground_speed_m_s,
            state.course_rad,
            self._agents[vehicle].perception.motion.turn_rate_rad_s,
            (t_ns - state.t_ns) / NS_PER_S,
            self.forward_simulation(vehicle, t_ns),
        )

    def _has_moved(self, home: Home, return_route: ReturnRoute) -> bool:
        """Return True if a return route leads to another landing point than home."""
        return math.dist(self._frame.to_local(*home[:2]), return_route.points_m[-1]) > _MAX_HOME_SHIFT_M

    def _not_begun(self, vehicle: int, reason: str, t_ns: int) -> list[Effect]:
        """Report an upload that was not begun as failed."""
        pause = self._agents[vehicle].tasking.retry.note_failure(vehicle, t_ns)
        return [self._failure(vehicle, reason, t_ns), *pause]

    def _refused(self, vehicle: int, kind: str, reason: str, t_ns: int) -> list[Effect]:
        """Report a mission that is not uploaded, with an alarm once for each kind of reason."""
        effects: list[Effect] = []
        tasking = self._agents[vehicle].tasking
        if tasking.refusal != kind:
            effects.append(Notice(t_ns, NoticeCode.MISSION_HELD_BACK, vehicle, {"reason": reason}))
        tasking.refusal = kind
        tasking.retry.note_failure(vehicle, t_ns)
        return [*effects, self._failure(vehicle, reason, t_ns)]

    def _failure(self, vehicle: int, reason: str, t_ns: int) -> UploadReport:
        self.state.mission_count += 1
        return UploadReport(t_ns, vehicle, self.state.mission_count, 0, False, reason, 0.0, 0)


def _is_outdated(queued: QueuedRoute, t_ns: int) -> bool:
    return t_ns - queued.begins_t_ns > _MAX_DELAY_NS
