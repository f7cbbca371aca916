"""The fold: one event in, effects out. The one place where tracking, planning and the vehicle links meet.

``Engine.step`` is synchronous and reads no clock, no socket and no random source: the same events give the
same effects, byte for byte. A recording is the list of events, and replaying it is calling `step` on them.

- A datagram goes to the fleet (what vehicles say of themselves) and to the mission transfer of its vehicle;
  one that another ground station sent to a vehicle, to those who watch what others do with our vehicles.
- An order is carried out and answered; a held vehicle is not tasked.
- A scan goes to both trackers; ties and statuses follow; when a plan is due, so does the plan.
- A tick drives every timer.
"""

from __future__ import annotations

from collections.abc import Container, Iterable

from pymavlink.dialects.v20.ardupilotmega import MAVLINK_MSG_ID_PARAM_VALUE

from gcs.config import Config
from gcs.core.airspace.incursion_warning import IncursionWarnings
from gcs.core.airspace.mission_bounds import MissionBoundsCheck
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.core.authority.external_uploads import ExternalUploads
from gcs.core.authority.grounded_vehicles import GroundedVehicles
from gcs.core.authority.onboard_audit import OnboardAudit
from gcs.core.authority.override_notices import OverrideNotices, Unattended, overridden_text
from gcs.core.operator.plan_approval import PlanApproval
from gcs.core.operator.replies import OrderInProgress, named
from gcs.core.operator.vehicle_orders import Orders
from gcs.core.perception.agent_status import AgentStatusMonitor
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.perception.input_errors import InputErrors
from gcs.core.perception.oosm_buffer import OutOfSequenceBuffer
from gcs.core.perception.position_integrity import PositionIntegrityMonitor
from gcs.core.perception.report_history import ReportHistory
from gcs.core.perception.scan_timing import ScanTiming
from gcs.core.perception.sensor_watchdog import SensorWatchdog
from gcs.core.perception.track_to_vehicle import TrackVehicleAssociation
from gcs.core.perception.vehicle_kinematics import VehicleKinematics
from gcs.core.perception.vehicle_watchdog import VehicleWatchdog
from gcs.core.replanning.inputs import OtherVehicle, PlanningInputs
from gcs.core.replanning.replanner import Replanner
from gcs.core.replanning.return_heights import Returns
from gcs.core.replanning.return_routes import ReturnRoutes
from gcs.core.replanning.takeoffs import Takeoffs
from gcs.core.restart import Restart
from gcs.core.tasking.dispatch import Dispatch
from gcs.core.tasking.mission_ends import MissionEnds
from gcs.core.tasking.takeoff_sequence import Departures
from gcs.core.tasking.upload_latency import UploadLatency
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.base import is_on_ground
from gcs.mavlink.autopilots.modes import RTL
from gcs.mavlink.fleet.fleet import Fleet, FleetSettings
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    BadInput,
    ClockStep,
    Datagram,
    Effect,
    Event,
    Label,
    LinkNews,
    MissionEnded,
    Notice,
    Order,
    PersistedState,
    Resumed,
    Scan,
    Tick,
    Track,
    UploadAnswer,
)
from gcs.planning.terminal.climb import Climb

_TASKABLE_MODES = ("", "AUTO", "LOITER")
"""Before the first heartbeat, on a mission, and waiting for one."""


class Engine:
    """Central command's whole state.

    Parameters
    ----------
    config : Config
        The mission.
    seed : int
        Makes the random obstacles of the map.
    """

    def __init__(self, config: Config, seed: int) -> None:
        vehicles = [agent.vehicle for agent in config.agents]
        tracking, telemetry = config.tracking, config.telemetry
        self.grid = mission_grid(config, seed)
        self.no_fly_zones = NoFlyZones(self.grid)
        links = config.mavlink_links
        self.fleet = Fleet(
            vehicles,
            config.local_frame,
            FleetSettings(
                position_rate_hz=telemetry.rate_hz,
                max_speed_m_s=config.airframe.max_ground_speed_m_s,
                checks_signatures=bool(config.links.keys),
            ),
            links=[link for link in links if link.role == "vehicles"],
            extra_ids=[MAVLINK_MSG_ID_PARAM_VALUE],
        )
        self.external_uploads = ExternalUploads(links, vehicles, self.fleet.is_atomic)
        self.trackers = MultiSensorTracker(config)
        self.oosm_buffer = OutOfSequenceBuffer(tracking.reorder_window_s)
        self.association = TrackVehicleAssociation(
            tracking.gate_chi2, telemetry.noise_std_m, telemetry.max_age_s
        )
        self.position_integrity = PositionIntegrityMonitor(telemetry)
        self.kinematics = VehicleKinematics(telemetry.max_age_s)
        self.upload_latency = UploadLatency()
        self.agent_status = AgentStatusMonitor(vehicles, config.planning.capture_radius_m)
        self.replanner, self.return_routes = Replanner(config, self.grid), ReturnRoutes(config, self.grid)
        self.takeoffs = Takeoffs(config, self.grid, self.fleet)
        self.tasking = UploadManager(
            config.mission,
            config.airframe,
            config.local_frame,
            self.fleet,
            config.links.max_parallel_uploads,
            self.return_routes,
            self.takeoffs,
            MissionBoundsCheck(config, self.grid),
            lambda vehicle: self.takeoff_sequence.holds_back(vehicle, self.orders.launching()),
        )
        self.return_heights = Returns(config, self.fleet)
        self.takeoff_sequence = Departures(config, self.fleet, self.tasking)
        self.incursions = IncursionWarnings(self.tasking)
        self.mission_ends = MissionEnds(self.tasking, config.planning.capture_radius_m)
        self.approval = PlanApproval(config, self.replanner)
        self.dispatch = Dispatch(
            self.replanner, self.approval, self.tasking, self.upload_latency, self.external_uploads
        )
        self.scan_timing, self.report_history = ScanTiming(), ReportHistory()
        self.sensor_watchdog = SensorWatchdog()
        self.vehicle_watchdog = VehicleWatchdog(vehicles, lambda vehicle: bool(self.fleet.link(vehicle)))
        self.input_errors = InputErrors()
        self.orders = Orders(
            self.fleet,
            self.tasking,
            self.replanner,
            self.takeoff_sequence,
            self.return_heights,
            self._outlook,
        )
        self.grounded = GroundedVehicles(self.fleet, self.tasking, self.orders)
        self.override_notices, self.unattended_targets = OverrideNotices(), Unattended()
        self.onboard_audit = OnboardAudit(self.fleet, self.tasking, self.replanner, self.orders)
        self.restart = Restart(
            self.fleet,
            self.tasking,
            self.replanner,
            self.orders,
            self.agent_status,
            self.trackers,
            self.external_uploads,
            self.onboard_audit,
        )
        self._expected_targets = len(config.births)
        self._report_age_ns = int(telemetry.max_age_s * NS_PER_S)
        self._needs_word = config.planning.retask == "confirm"
        self._ended, self._frame = False, config.local_frame
        self._measured_t_ns = 0

    def step(self, event: Event) -> list[Effect]:
        """Work one event; return what is to be done and shown because of it."""
        match event:
            case Datagram():
                return self._datagram(event)
            case Scan():
                return self._scan(event)
            case Tick():
                return self._tick(event)
            case BadInput():
                return self._bad_input(event)
            case LinkNews():
                return [Notice(event.t_ns, event.level, f"{event.link}: {event.text}")]
            case ClockStep():
                self.scan_timing.step(event)
                return [self._clock_notice(event)]
            case Order():
                return self._order(event)
            case UploadAnswer():
                return self.dispatch.settle(self.tasking.add_upload_answer(event))
            case Resumed():
                return self._resume(event)

    def _clock_notice(self, event: ClockStep) -> Notice:
        step_s = event.step_ns / NS_PER_S
        text = (
            f"the wall clock of this machine was set by {step_s:+.1f} s, or the machine was suspended; "
            "timers are not affected. Check that the sensors' clocks agree with it"
        )
        return Notice(event.t_ns, "warning", text)

    def memory(self, t_ns: int) -> PersistedState:
        """What another service must know to take up from here (`Resumed`)."""
        return PersistedState(
            t_ns=t_ns,
            mission_count=self.tasking.mission_count,
            plan_count=self.approval.count,
            ended=self._ended,
            vehicles=self.restart.vehicles(),
            targets=self.restart.targets(t_ns, self.trackers.targets.confirmation.tracks),
            no_fly_zones=tuple(self.no_fly_zones.areas.values()),
        )

    def _resume(self, event: Resumed) -> list[Effect]:
        memory = event.state
        self.approval.count, self._ended = memory.plan_count, memory.ended
        for area in memory.no_fly_zones:
            if not self.no_fly_zones.refusal(area):
                self.no_fly_zones.take(area)
        self.grid = self.return_routes.grid = self.takeoffs.grid = self.no_fly_zones.grid
        self.replanner.use_map(self.grid)
        return self.restart.begin(event)

    def _datagram(self, event: Datagram) -> list[Effect]:
        if self.external_uploads.hosts(event.link):
            return self._guest(event)
        effects: list[Effect] = []
        for vehicle, message in self.fleet.receive(event):
            self.return_heights.receive(vehicle, message)
            effects += self.dispatch.settle(self.tasking.receive(vehicle, message, event.t_ns))
            effects += self.orders.receive(vehicle, message, event.t_ns)
            effects += self.grounded.receive(vehicle, message, event.t_ns)
            effects += self.onboard_audit.receive(vehicle, message, event.t_ns)
            effects += self.external_uploads.answered(vehicle, message, event.t_ns)
        return effects

    def _guest(self, event: Datagram) -> list[Effect]:
        """Note what another ground station sent; who got a mission from it is no longer ours to task."""
        effects, taken = self.external_uploads.receive(event)
        for vehicle in taken:
            self.replanner.drop(vehicle)
            self.tasking.forget_onboard(vehicle)
        return effects

    def _order(self, event: Order) -> list[Effect]:
        effects: list[Effect]
        match event.action:
            case "confirm" | "reject":
                inputs = self._planning_inputs(event.t_ns, self._measured_t_ns)
                effects, routes = self.approval.take(event, inputs)
                effects += self.dispatch.send(routes, event.t_ns)
            case "plan":
                effects = [*self._answer_overridden(event), *self.approval.tell(event)]
            case "no-fly-zone":
                effects = self._close(event)
            case _:
                targets = self.trackers.targets.confirmation.tracks
                effects = self.dispatch.settle(
                    self.orders.take(event, targets, self.untaskable(), self._release)
                )
        return effects + self.approval.refresh(event.t_ns, self._untaskable_now())

    def overridden(self) -> dict[int, str]:
        """Return the modes that somebody else chose, by vehicle; not those that orders here asked for."""
        taken = self.tasking.override_modes()
        return {v: mode for v, mode in taken.items() if not self.orders.has_ordered(v, mode)}

    def _answer_overridden(self, event: Order) -> list[Effect]:
        """Answer an order about plans with the vehicles that no plan is made for, before its own answer."""
        taken = self.overridden()
        text = overridden_text(taken)
        return [OrderInProgress(event, taken).answer(event.t_ns, "accepted", text)] if text else []

    def _outlook(self, vehicle: int) -> str:
        """What a vehicle that is ours again and waits in LOITER can expect, in words."""
        match self.agent_status.by_vehicle[vehicle].status:
            case "arrived":
                return "has reached its target and gets no other"
            case "lost":
                return "is taken for lost, and gets a mission when it is seen again"
        return "gets no mission, since the mission has ended" if self._ended else "waits for its next mission"

    def _release(self, vehicle: int) -> None:
        """Take a vehicle back, whoever gave it a mission, on an operator's order."""
        self.external_uploads.release([vehicle])
        self.onboard_audit.release([vehicle])

    def _close(self, event: Order) -> list[Effect]:
        """Close or open an area, and plan again at once."""
        area, ongoing = event.no_fly_zone, OrderInProgress(event)
        assert area is not None
        refusal = self.no_fly_zones.refusal(area)
        if refusal:
            return [ongoing.answer(event.t_ns, "refused", refusal)]
        closed = self.no_fly_zones.take(area)
        self.grid = self.return_routes.grid = self.takeoffs.grid = self.no_fly_zones.grid
        verb = "closed" if area.name in self.no_fly_zones.areas else "opened"
        news = f"no-fly zone {area.name} {verb}"
        places = {state.system_id: (state.east_m, state.north_m) for state in self.fleet.states()}
        bound = self.replanner.routes
        without_return = self.return_routes.crossed(
            closed, {v: p for v, p in places.items() if v not in bound}
        )
        through = self.replanner.change_map(event.t_ns, self.grid, closed, places, news, without_return)
        arrived = self.agent_status.arrived() & without_return
        returning = [s.system_id for s in self.fleet.states() if s.armed and s.system_id in arrived]
        effects: list[Effect] = [*self._watch_takeoffs(event.t_ns)]
        if self.sensor_watchdog.scan_t_ns is not None:
            effects += self._plan(event.t_ns, self._measured_t_ns, through)
        still = set(through) - set(self.replanner.routes) | set(self.replanner.blocked)
        led = set(through) - still
        text = f"{area.name} {verb}" + (f"; {named(led)} led around it" if led else "")
        states = [state for state in self.fleet.states() if state.system_id in still]
        entries = self.incursions.entries(states, self.no_fly_zones.closed)
        remedy = "confirm a plan, or hold or return it" if self._needs_word else "hold or return it"
        said = {entry.vehicle: f"{entry.text}: {remedy}" for entry in entries}
        said |= dict.fromkeys(still - said.keys(), f"has no way around {area.name}: {remedy}")
        said |= dict.fromkeys(returning, f"flies home through {area.name}: hold or return it")
        effects.append(
            ongoing.answer(
                event.t_ns, "done", "; ".join([text, *(f"{named([v])} {word}" for v, word in said.items())])
            )
        )
        return [*effects, *(Notice(event.t_ns, "alarm", word, v) for v, word in said.items())]

    def _tick(self, event: Tick) -> list[Effect]:
        effects: list[Effect] = [*self.fleet.poll(event.t_ns), *self.fleet.notices()]
        effects += self.sensor_watchdog.poll(event.t_ns) + self.vehicle_watchdog.poll(event.t_ns)
        effects += self.input_errors.poll(event.t_ns)
        if self.report_history.is_due(event.t_ns):
            self.report_history.take(event.t_ns, self.fleet.states())
        effects += self._due_scans(event.t_ns)
        effects += self.dispatch.withdraw(event.t_ns)
        effects += self.dispatch.settle(self.tasking.poll(event.t_ns))
        effects += self.external_uploads.poll(event.t_ns)
        effects += self.orders.poll(event.t_ns) + self.onboard_audit.poll(event.t_ns)
        effects += self.takeoff_sequence.watch(event.t_ns, self.orders.launching())
        taken = self.tasking.override_modes()
        not_told = taken.keys() - self.overridden().keys() | self.tasking.recently_in_rtl(event.t_ns)
        effects += self.override_notices.poll(event.t_ns, taken, not_told)
        if not self.restart.is_under_way:
            effects += self.grounded.poll(event.t_ns, self.untaskable)
        return effects

    def _scan(self, event: Scan) -> list[Effect]:
        scan, refusal, effects = self.scan_timing.corrected(event)
        refusal = refusal or self.trackers.refusal(scan)
        if refusal:
            return [*effects, *self._refuse(scan, refusal)]
        self.oosm_buffer.hold(scan)
        return [*effects, *self._due_scans(event.t_ns)]

    def _refuse(self, scan: Scan, refusal: str) -> list[Effect]:
        name = scan.sensor.name
        self.sensor_watchdog.refused(name, scan.t_ns, refusal)
        return self.input_errors.take(BadInput(scan.t_ns, name, f"scan of {name} {refusal}"))

    def _due_scans(self, t_ns: int) -> list[Effect]:
        """Work the scans that have waited long enough for those measured before them."""
        return [effect for scan in self.oosm_buffer.due(t_ns) for effect in self._work(scan)]

    def _work(self, event: Scan) -> list[Effect]:
        refusal = self.trackers.refusal(event)  # again: one like it may have come while it was held
        if refusal:
            return self._refuse(event, refusal)
        self._measured_t_ns = event.measured_t_ns
        newest = self.fleet.states()
        self.report_history.take(event.t_ns, newest)
        states = self.report_history.at(event.measured_t_ns, newest)
        effects: list[Effect] = [*self.sensor_watchdog.processed(event.sensor.name, event.t_ns)]
        effects += self.trackers.scan(event, states)
        agents, targets = self.trackers.agents.confirmation, self.trackers.targets.confirmation
        self.association.update(agents, event.measured_t_ns, states)
        self.kinematics.take(newest)
        effects += self.position_integrity.take(
            event, states, self.association.labels, agents.tracks, targets.tracks.values()
        )
        reporting = {s.system_id for s in newest if abs(event.t_ns - s.t_ns) <= self._report_age_ns}
        ties, assigned = self.association.labels, self.replanner.assigned
        effects += self.sensor_watchdog.associated(event.t_ns, reporting, ties)
        moment = event.t_ns, event.measured_t_ns
        for status in self.agent_status.update(*moment, agents, targets, ties, assigned, reporting):
            effects.append(status)
            effects += self._follow(status)
        effects += self._watch_takeoffs(event.t_ns)
        effects += self.mission_ends.look(event.t_ns, self.agent_status.active())
        effects += self.approval.refresh(event.t_ns, self._untaskable_now())
        effects += self._plan(event.t_ns, event.measured_t_ns)
        if self.no_fly_zones.closed:
            effects += self.incursions.look(event.t_ns, newest, self.no_fly_zones.closed)
        effects += self.unattended_targets.look(event.t_ns, self._open_targets(), ended=self._ended)
        effects += self._end(event.t_ns)
        for is_contradiction, text in self.trackers.findings:
            effects.append(Notice(event.t_ns, "warning" if is_contradiction else "info", text))
        effects += self.trackers.untracked.notices(event.t_ns)
        return effects

    def _follow(self, status: AgentStatus) -> list[Effect]:
        if status.status != "active":
            self.replanner.drop(status.vehicle)
        if status.status == "lost":
            self.association.forget(status.vehicle)
            self.tasking.cancel(status.vehicle, status.t_ns)
            self.approval.hurry()
            return [*self.approval.end(status.vehicle, status.t_ns, "the agent is lost")]
        return []

    def _plan(self, t_ns: int, picture_t_ns: int, hurried: Container[int] = ()) -> list[Effect]:
        targets = self.trackers.targets.confirmation.tracks
        if self._ended or self.restart.is_waiting(t_ns, self.association.labels, targets):
            return []
        if not self.replanner.is_due(t_ns):
            return []
        inputs = self._planning_inputs(t_ns, picture_t_ns)
        if self._needs_word:
            proposed = self.approval.look(inputs)
            return [*self._notes(t_ns), *proposed]
        plan, notes = self.replanner.check(inputs), self._notes(t_ns)
        if plan is None:
            return notes
        routes = [route for route in plan.routes if route.vehicle in plan.changed]
        return [plan, *notes, *self.dispatch.send(routes, plan.t_ns, hurried)]

    def _notes(self, t_ns: int) -> list[Effect]:
        """What the last look has to say besides a plan."""
        return [Notice(t_ns, "warning", note) for note in self.replanner.notes]

    def _planning_inputs(self, t_ns: int, picture_t_ns: int) -> PlanningInputs:
        agents, labels = self.trackers.agents.confirmation.tracks, self.association.labels
        untaskable = self._untaskable_now()
        tracks = {v: agents[label] for v, label in labels.items() if label in agents}
        tracks |= {v: track for v, track in self.association.beside.items() if v in self.replanner.planned}
        flying = {v: tracks[v] for v in self.agent_status.active() if v not in untaskable and v in tracks}
        return PlanningInputs(
            t_ns=t_ns,
            picture_t_ns=picture_t_ns,
            agents=flying,
            motions=self.kinematics.now(
                flying, t_ns, picture_t_ns, lambda v: self.tasking.forward_simulation(v, t_ns)
            ),
            late_s={vehicle: self.upload_latency.late_s(vehicle) for vehicle in flying},
            left_s=self._left_s(flying, t_ns),
            climbs=self._climbs(flying),
            other_vehicles=self._other_vehicles(flying),
            passed=frozenset(filter(self.mission_ends.has_missed, flying)),
            targets=self._open_targets(),
            at_targets=self.agent_status.at_targets(),
            arrived=self.agent_status.arrived(),
            lost=self.agent_status.lost(),
            untaskable=untaskable,
        )

    def _other_vehicles(self, planned: Container[int]) -> tuple[OtherVehicle, ...]:
        """Vehicles in the air that are not planned for now."""
        untaskable, found = self.untaskable(), []
        for state in self.fleet.states():
            vehicle, home = state.system_id, self.fleet.home(state.system_id)
            is_there = vehicle in untaskable and self.agent_status.by_vehicle[vehicle].status != "lost"
            if vehicle in planned or not is_there or is_on_ground(state, home):
                continue
            place_m = (state.east_m, state.north_m)
            to_m = place_m
            if state.mode == RTL and home is not None:
                to_m = self._frame.to_local(home.lat_deg, home.lon_deg)
            found.append(OtherVehicle(vehicle, place_m, to_m, self.tasking.height_m(state)))
        return tuple(found)

    def _left_s(self, vehicles: Iterable[int], t_ns: int) -> dict[int, float]:
        """Until vehicles fly the missions that are under way to them."""
        under_way = {vehicle: self.tasking.elapsed_s(vehicle, t_ns) for vehicle in vehicles}
        return {
            v: self.upload_latency.left_s(v, for_s) for v, for_s in under_way.items() if for_s is not None
        }

    def _climbs(self, vehicles: Iterable[int]) -> dict[int, Climb]:
        """Return the climbs that vehicles have before their routes."""
        climbs = {vehicle: self.tasking.climb(vehicle, self.replanner.layer(vehicle)) for vehicle in vehicles}
        return {vehicle: climb for vehicle, climb in climbs.items() if climb is not None}

    def _open_targets(self) -> dict[Label, Track]:
        """Believed targets that need somebody."""
        at_targets, needed = self.agent_status.at_targets(), self.replanner.plan_targets.needed
        return {
            label: track
            for label, track in self.trackers.targets.confirmation.tracks.items()
            if at_targets.get(label, 0) < needed(label) and not self.restart.is_reached(label)
        }

    def untaskable(self) -> dict[int, str]:
        """Vehicles that are not ours to task: by an order, or by a mode that somebody else chose."""
        modes = {
            state.system_id: f"is in {state.mode} and left alone"
            for state in self.fleet.states()
            if state.mode not in _TASKABLE_MODES and not self._missed_in_rtl(state.system_id)
        }
        others = self.external_uploads.untaskable() | self.onboard_audit.untaskable()
        return modes | self.tasking.untaskable() | others | self.orders.untaskable()

    def _missed_in_rtl(self, vehicle: int) -> bool:
        """Return True if a vehicle has flown its mission to the end, and into RTL, without its target."""
        return self.tasking.has_completed(vehicle) and self.mission_ends.has_missed(vehicle)

    def _untaskable_now(self) -> dict[int, str]:
        """Vehicles that get no mission now: those that are away, and those that cannot take off."""
        grounded = dict.fromkeys(self.takeoffs.blocked, "stands where its take-off is not clear")
        return grounded | self.untaskable()

    def _watch_takeoffs(self, t_ns: int) -> list[Notice]:
        """Judge the climbs of vehicles on the ground that might get a mission, or have one."""
        untaskable = self.untaskable()
        notices = self.takeoffs.watch(
            self._climbs(v for v in self.agent_status.active() if v not in untaskable), t_ns
        )
        for vehicle in self.takeoffs.blocked:
            self.replanner.drop(vehicle)
        return notices

    def _end(self, t_ns: int) -> list[Effect]:
        spare = self.agent_status.active()
        if self._ended or (spare and not self._is_all_done()):
            return []
        self._ended = True
        statuses = self.agent_status.by_vehicle.values()
        arrived = tuple(f.vehicle for f in statuses if f.status == "arrived")
        dead = tuple(f.vehicle for f in statuses if f.status == "lost")
        return [MissionEnded(t_ns, arrived, dead, tuple(spare))]

    def _is_all_done(self) -> bool:
        """Whether those who still fly have nothing left to do: every target that is expected was reached."""
        reached = len(self.agent_status.at_targets())
        return reached >= max(1, self._expected_targets) and not self._open_targets()

    def _bad_input(self, event: BadInput) -> list[Effect]:
        if event.sensor:
            self.sensor_watchdog.refused(event.sensor, event.t_ns, event.problem)
        return self.input_errors.take(event)
