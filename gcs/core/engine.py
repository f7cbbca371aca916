"""The engine: one event in, effects out.

`Engine.step` is synchronous and reads no clock, socket or random source. The same events give the same
effects, byte for byte. A recording is the list of events; a replay calls `step` on them.

- A datagram updates vehicle states, uploads, orders and audits; a datagram of another ground station is
  monitored.
- A scan updates both trackers, then associations, agent statuses and, if due, the plan.
- An order is carried out and answered.
- A tick runs all timers.
"""

from __future__ import annotations

from collections.abc import Container

from gcs.core.authority.override_notices import overridden_text, unattended_targets
from gcs.core.operator.arrived_agents import continue_mission
from gcs.core.operator.records import OrderInProgress
from gcs.core.perception.never_heard import check_never_heard
from gcs.core.restart import bridge_gap, is_settled
from gcs.core.stages import Stages
from gcs.core.state import State, at_targets, with_status, without_missions
from gcs.core.state_check import check_state
from gcs.core.tasking.missed_targets import check_missed_targets
from gcs.mavlink.frames.codec import FrameTable, scan
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Authority,
    BadInput,
    ClockStep,
    ControlEvent,
    Datagram,
    Effect,
    Event,
    FlightPhase,
    LinkNews,
    MissionEnded,
    Notice,
    Order,
    Resumed,
    Scan,
    Tick,
)

_CONTROL_PERIOD_NS = NS_PER_S // 2
_STANDING = {Authority.GROUNDED, Authority.REJECTING, Authority.LANDED, Authority.DOWN}
"""Claims of vehicles on the ground that nobody else controls."""


class Engine(Stages):
    """Central command of one mission, made from its file, the seed of its map, and a state."""

    def restore(self, state: State) -> None:
        """Continue from another state.

        Raises
        ------
        ValueError
            If the state is damaged, or of another mission; the engine is then not to be used.
        """
        check_state(state)
        try:
            super().__init__(self.config, self.seed, state)
        except (LookupError, TypeError, ArithmeticError, AssertionError, AttributeError) as error:
            raise ValueError(f"the state makes no sense ({error!r})") from None

    def step(self, event: Event, frames: FrameTable | None = None) -> list[Effect]:
        """Process one event; return its effects.

        `frames` are those of a datagram, if they are known already. The effects are the same without.
        """
        effects = self._without_repeats(self._step(event, frames), event)
        self.second_commander.note_sent(effects, event.t_ns)
        return effects

    def _without_repeats(self, effects: list[Effect], event: Event) -> list[Effect]:
        """Leave out notices that come all the time; add their summaries."""
        repeats = self.state.repeats
        kept = [
            effect
            for effect in effects
            if not isinstance(effect, Notice) or repeats.admit(effect, with_figures=True)
        ]
        return [*kept, *repeats.summaries(event.t_ns)] if isinstance(event, Tick) else kept

    def _step(self, event: Event, frames: FrameTable | None) -> list[Effect]:
        match event:
            case Datagram():
                return self._datagram(event, frames)
            case Scan():
                return self._scan(event)
            case Tick():
                return self._tick(event)
            case BadInput():
                return self._bad_input(event)
            case LinkNews():
                return [Notice(event.t_ns, event.level, f"{event.link}: {event.text}")]
            case ClockStep():
                return self.scan_timing.step(event)
            case Order():
                return self._order(event)
            case Resumed():
                return self._resume(event)

    def untaskable(self) -> dict[int, str]:
        """Return the vehicles that are not ours to task, with the reason in words."""
        controls = {vehicle: agent.control for vehicle, agent in self.state.agents.items()}
        return {v: control.reason for v, control in controls.items() if not control.is_ours}

    def overridden(self) -> dict[int, str]:
        """Return the overriding modes by vehicle, except modes that orders here asked for."""
        modes = self.tasking.overrides.modes()
        return {v: mode for v, mode in modes.items() if not self.orders.has_ordered(v, mode)}

    def _resume(self, event: Resumed) -> list[Effect]:
        """Continue after an outage of the service: read the onboard missions of active agents back."""
        effects = bridge_gap(self.state, event)
        self.restore(self.state)
        self.second_commander.begin_again()
        for vehicle in with_status(self.state.agents, "active"):
            agent, audit = self.state.agents[vehicle], self.state.agents[vehicle].authority.audit
            mission = agent.tasking.onboard if audit is None else audit.mission
            known_t_ns = event.saved_t_ns if audit is None else audit.known_t_ns
            is_uploading = vehicle in self.state.tasking.uploads  # its read-back decides
            if mission is not None and not (is_uploading or self.tasking.may_be_inconsistent(vehicle)):
                self.onboard_audit.begin(mission, event.t_ns, known_t_ns=known_t_ns)
        return effects + self.tasking.resume(event.t_ns)

    # ------------------------------------------------------------ datagrams and orders

    def _datagram(self, event: Datagram, frames: FrameTable | None) -> list[Effect]:
        effects: list[Effect] = []
        if self.external_uploads.hosts(event.link):
            frames = scan(event.data) if frames is None else frames
            effects, overridden = self.external_uploads.receive(event, frames)
            self.parameter_changes.receive_forwarded(event, frames)
            for vehicle in overridden:
                self.state.agents[vehicle].routes.drop()
                self.tasking.forget_onboard(vehicle)
            return effects
        for vehicle, message in self.fleet.receive(event, frames):
            self.return_heights.receive(vehicle, message)
            effects += self.dispatch.settle(self.tasking.receive(vehicle, message, event.t_ns))
            self.failsafes.receive(vehicle, message, event.t_ns)
            effects += self.orders.receive(vehicle, message, event.t_ns)
            effects += self.disarmed_in_auto.receive(vehicle, message, event.t_ns)
            effects += self.onboard_audit.receive(vehicle, message, event.t_ns)
            effects += self.external_uploads.receive_reply(vehicle, message, event.t_ns)
            effects += self.second_commander.receive(vehicle, message, event.t_ns)
            effects += self.parameter_changes.receive(vehicle, message, event.t_ns)
        return effects

    def _order(self, event: Order) -> list[Effect]:
        effects: list[Effect]
        self.control.update(event.t_ns)
        match event.action:
            case "status":
                return [self.status_report.build(event.t_ns, event.order_id)]
            case "confirm" | "reject":
                inputs = self.planning_inputs.build(event.t_ns, self.state.measured_t_ns)
                effects, routes = self.approval.decide(event, inputs)
                effects += self.dispatch.send(routes, event.t_ns)
            case "plan":
                overridden = self.overridden()
                text = overridden_text(overridden)
                ongoing = OrderInProgress(event, tuple(overridden))
                effects = [ongoing.answer(event.t_ns, "accepted", text)] if text else []
                effects += self.approval.answer(event)
            case "no-fly-zone":
                effects = self.no_fly_zone_orders.carry_out(
                    event, lambda urgent: self._replan(event.t_ns, urgent)
                )
            case "ready":
                effects = self._take_over(self.ready_orders.carry_out(event))
            case "ignore" | "attend" | "priority" | "pin" | "unpin":
                effects = self.target_orders.carry_out(event, lambda: self._replan(event.t_ns, ()))
            case "continue":
                open_targets = self.planning_inputs.open_targets()
                effects = continue_mission(event, self.state, self.replanner, open_targets)
                effects += self._replan(event.t_ns, ())
            case _:
                targets = self.trackers.targets.confirmation.tracks
                effects = self.dispatch.settle(self.orders.carry_out(event, targets, self._release))
        self.control.update(event.t_ns)
        effects += self.approval.refresh(event.t_ns, without_missions(self.state.agents))
        return effects + (self._replan(event.t_ns, ()) if self.approval.changed_control() else [])

    def _replan(self, t_ns: int, urgent: Container[int]) -> list[Effect]:
        """Plan by an order, or on a changed map."""
        effects: list[Effect] = [*self._check_climbs(t_ns)]
        if self.sensor_watchdog.scan_t_ns is not None:
            effects += self._plan(t_ns, self.state.measured_t_ns, urgent)
        return effects

    def _release(self, vehicle: int, t_ns: int) -> None:
        """Take control of a vehicle back on an operator's order, whatever mission it stores."""
        self.external_uploads.release(vehicle, ControlEvent.RESUME, t_ns)
        self.onboard_audit.release(vehicle, t_ns)
        self.second_commander.release(vehicle, t_ns)

    # ------------------------------------------------------------ ticks and scans

    def _tick(self, event: Tick) -> list[Effect]:
        t_ns = event.t_ns
        effects: list[Effect] = [*self.fleet.poll(t_ns), *self.fleet.notices()]
        effects += self._check_flight(t_ns)
        effects += self.sensor_watchdog.poll(t_ns)
        effects += check_never_heard(self.state.agents, self.state.perception, t_ns)
        effects += self.input_errors.poll(t_ns)
        if self.report_history.is_due(t_ns):
            self.report_history.add(t_ns, self.fleet.states())
        effects += self._process_due_scans(t_ns)
        effects += self._process_reports(t_ns)
        effects += self.dispatch.withdraw(t_ns)
        effects += self.dispatch.settle(self.tasking.poll(t_ns))
        effects += self.external_uploads.poll(t_ns) + self.second_commander.poll(t_ns)
        effects += self.parameter_changes.poll(t_ns)
        effects += self.orders.poll(t_ns) + self.onboard_audit.poll(t_ns)
        effects += self.takeoff_sequence.check(t_ns, self.orders.launching())
        effects += self.mission_traffic.check(t_ns)
        effects += self.separation.check(t_ns)
        # For displays and the journal; decisions update it themselves.
        if t_ns >= self.state.control_due_t_ns:
            self.state.control_due_t_ns = t_ns + _CONTROL_PERIOD_NS
            self.control.update(t_ns)
        effects += self.override_notices.poll(t_ns)
        if not self.onboard_audit.awaited:
            effects += self.disarmed_in_auto.poll(
                t_ns, lambda vehicle: self.control.updated(vehicle, t_ns).claims.keys() <= _STANDING
            )
        return effects

    def _scan(self, event: Scan) -> list[Effect]:
        scan, refusal, effects = self.scan_timing.corrected(event)
        refusal = refusal or self.trackers.refusal(scan)
        if refusal:
            return [*effects, *self._refuse(scan, refusal)]
        self.oosm_buffer.add(scan)
        return [*effects, *self._process_due_scans(event.t_ns)]

    def _refuse(self, scan: Scan, refusal: str) -> list[Effect]:
        name = scan.sensor.name
        return self._bad_input(BadInput(scan.t_ns, name, f"scan of {name} {refusal}", name), refusal)

    def _bad_input(self, event: BadInput, reason: str = "") -> list[Effect]:
        if event.sensor:
            self.sensor_watchdog.refused(event.sensor, event.t_ns, reason or event.problem)
        return self.input_errors.add(event)

    def _process_due_scans(self, t_ns: int) -> list[Effect]:
        """Process the scans whose reorder window has passed."""
        due = self.oosm_buffer.due(t_ns, self._reorder_window_s)
        return [effect for scan in due for effect in self._process_scan(scan)]

    def _process_reports(self, t_ns: int) -> list[Effect]:
        """Track agents by their reports alone while no sensor publishes.

        The epoch is as old as scans are when they arrive: the first one that comes again is not refused.
        """
        if not self.sensor_watchdog.is_blind or self.oosm_buffer.held:
            return []
        measured_t_ns = t_ns - self.scan_timing.max_lag_ns()
        if not self.trackers.is_report_epoch_due(measured_t_ns):
            return []
        newest = self.fleet.states()
        self.report_history.add(t_ns, newest)
        states = self.report_history.at(measured_t_ns, newest)
        pictures = self.trackers.report_epoch(t_ns, measured_t_ns, states)
        if pictures:
            self.association.update(self.trackers.agents.confirmation, measured_t_ns, states)
            self.kinematics.update(newest)
        return [*pictures]

    def _process_scan(self, event: Scan) -> list[Effect]:
        refusal = self.trackers.refusal(event)  # again: a duplicate may have come while it waited
        if refusal:
            return self._refuse(event, refusal)
        t_ns, self.state.measured_t_ns = event.t_ns, event.measured_t_ns
        newest = self.fleet.states()
        self.report_history.add(t_ns, newest)
        states = self.report_history.at(event.measured_t_ns, newest)
        effects: list[Effect] = [*self.sensor_watchdog.processed(event.sensor.name, t_ns)]
        effects += self.trackers.scan(event, states)
        agents, targets = self.trackers.agents.confirmation, self.trackers.targets.confirmation
        self.association.update(agents, event.measured_t_ns, states)
        self.kinematics.update(newest)
        effects += self.position_integrity.update(event, states, agents.tracks, targets.tracks.values())
        reporting = {s.system_id for s in newest if abs(t_ns - s.t_ns) <= self._max_report_age_ns}
        effects += self.sensor_watchdog.associated(t_ns, reporting, self.association.labels)
        for status in self.agent_status.update(t_ns, event.measured_t_ns, agents, targets, reporting):
            effects.append(status)
            effects += self._status_changed(status)
        effects += self._check_climbs(t_ns)
        capture_m = self.config.planning.capture_radius_m
        effects += check_missed_targets(self.state.agents, self.tasking.onboard_missions, capture_m, t_ns)
        self.control.update(t_ns)
        effects += self.approval.refresh(t_ns, without_missions(self.state.agents))
        effects += self._plan(t_ns, event.measured_t_ns)
        if self.no_fly_zones.closed:
            effects += self.incursions.check(t_ns, newest, self.no_fly_zones.closed)
        authority, has_ended = self.state.authority, self.state.has_ended
        effects += unattended_targets(
            authority, self.planning_inputs.open_targets(), t_ns, has_ended=has_ended
        )
        return effects + self._end(t_ns) + self.trackers.notices(event)

    def _check_flight(self, t_ns: int) -> list[Effect]:
        """Check flight phases and health."""
        effects = self._take_over(self.flight_phases.poll(t_ns))
        for vehicle, agent in self.state.agents.items():
            if agent.flight.phase.has_flown and agent.tasking.onboard is not None:
                agent.routes.drop()
                self.tasking.cancel(vehicle, t_ns)
                self.tasking.forget_onboard(vehicle)  # it is not for a take-off from here
        fit = {vehicle for vehicle, agent in self.state.agents.items() if not agent.flight.unfit}
        effects += self.health.poll(t_ns)
        for vehicle in sorted(fit):
            if cause := self.state.agents[vehicle].flight.unfit:
                self.replanner.note_unfit(vehicle, cause, t_ns)
        return effects

    def _take_over(self, effects: list[Effect]) -> list[Effect]:
        """Apply the statuses that follow from flight phases, and plan at the next scan."""
        applied: list[Effect] = []
        for effect in effects:
            applied.append(effect)
            if isinstance(effect, AgentStatus):
                self.agent_status.apply(effect)
                self.replanner.hurry(effect.t_ns)
                applied += self._status_changed(effect)
        return applied

    def _status_changed(self, status: AgentStatus) -> list[Effect]:
        if status.status != "active":
            self.state.agents[status.vehicle].routes.drop()
        if status.status == "lost":
            self.state.agents[status.vehicle].control.apply(ControlEvent.AGENT_LOST, status.t_ns)
            self.association.forget(status.vehicle)
        if status.status in ("lost", "down"):
            self.tasking.cancel(status.vehicle, status.t_ns)
            self.approval.hurry()
            return [*self.approval.end(status.vehicle, status.t_ns, f"the agent is {status.status}")]
        return []

    def _check_climbs(self, t_ns: int) -> list[Notice]:
        """Check the climbs of vehicles on the ground that have a mission, or may get one."""
        self.control.update(t_ns)
        agents = self.state.agents
        ours = [
            vehicle
            for vehicle in with_status(agents, "active")
            if agents[vehicle].control.is_ours and not agents[vehicle].flight.phase.is_in_air
        ]
        notices = self.climbs.check(self.planning_inputs.climbs(ours), t_ns)
        for agent in agents.values():
            if agent.takeoff.blocked:
                agent.routes.drop()
        return notices

    def _plan(self, t_ns: int, picture_t_ns: int, urgent: Container[int] = ()) -> list[Effect]:
        state = self.state
        if state.has_ended or not is_settled(state, t_ns):
            return []
        effects: list[Effect] = []
        if state.resumed_t_ns is not None:
            state.resumed_t_ns = None
            effects += self.replanner.taken_up(t_ns, picture_t_ns)
        if not (self.replanner.is_due(t_ns) or self.approval.changed_control()):
            return effects
        self.control.update(t_ns)
        inputs = self.planning_inputs.build(t_ns, picture_t_ns)
        if self._needs_approval:
            proposals = self.approval.check(inputs)
            return [*effects, *self._planner_notes(t_ns), *proposals]
        plan = self.replanner.check(inputs)
        notes = self._planner_notes(t_ns)
        if plan is None:
            return effects + notes
        routes = [route for route in plan.routes if route.vehicle in plan.changed]
        return [*effects, plan, *notes, *self.dispatch.send(routes, plan.t_ns, urgent)]

    def _planner_notes(self, t_ns: int) -> list[Effect]:
        return [Notice(t_ns, "warning", note) for note in self.state.replanning.new_notes]

    def _end(self, t_ns: int) -> list[Effect]:
        """End the mission when no active agent can fly, or every expected target has its agents."""
        agents = self.state.agents
        active = with_status(agents, "active")
        flyable = [v for v in active if agents[v].flight.phase is not FlightPhase.LANDED]
        reached = len(at_targets(self.state.agents))
        is_done = reached >= max(1, self._expected_targets) and not self.planning_inputs.open_targets()
        if self.state.has_ended or (flyable and not is_done):
            return []
        self.state.has_ended = True
        arrived, lost, down = (tuple(with_status(agents, word)) for word in ("arrived", "lost", "down"))
        return [MissionEnded(t_ns, arrived, lost, tuple(active), down)]
