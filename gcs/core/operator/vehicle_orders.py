"""Orders of an operator to vehicles: hold, resume, return, arm, disarm.

An order suspends its vehicle at once: it is not tasked, whatever the result of the command. An upload in
progress is ended safely first. An order is done when the vehicle's heartbeat shows it
(`gcs.mavlink.services.command_sender`). An order that changes nothing is refused.

A resumed vehicle continues its verified mission if its target and the time of its landing are still free;
otherwise it waits in LOITER for the next plan. It gets no upload until it is in LOITER, which would undo the
start of the mission. A vehicle that returns or lands is not turned back near the ground.

No order leads a vehicle into another one (`gcs.core.separation.order_check`). An order to resume is refused
then. A vehicle that RTL would lead near others returns by a mission, in an altitude layer of its own
(`gcs.core.replanning.stacked_missions`). Where that is not possible, and for an order to hold, the order
waits until the vehicle is clear, with an alarm at once; given again, it is carried out at once.

Vehicles are armed by an order only. Arming is refused in a mode in which the vehicle would take off at once,
except with a verified mission that is to be flown now: PX4 and ArduPlane start the stored mission when they
are armed in AUTO. It is also refused while another vehicle blocks the take-off (`gcs.core.takeoff.sequence`).
Disarming is refused unless the vehicle reports that it is on the ground, and never forced.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Container, Sequence
from dataclasses import replace
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.operator.records import Command, OrderInProgress, WaitingOrder
from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.replanning.stacked_missions import StackedMissions
from gcs.core.separation.landing_order import LandingOrder
from gcs.core.separation.order_check import OrderCheck
from gcs.core.state import State, flown_routes
from gcs.core.takeoff.sequence import SELF_LAUNCHING, TakeoffSequence
from gcs.core.tasking.mission_builder import is_hold
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.command_sender import CommandSender, command_long, set_mode
from gcs.model import (
    NS_PER_S,
    AnswerState,
    Authority,
    ControlEvent,
    Effect,
    Label,
    Notice,
    NoticeCode,
    Order,
    Parameter,
    Route,
    VehicleState,
    named,
    vehicle_name,
)

_ARM_DISARM: Final[int] = dialect.MAV_CMD_COMPONENT_ARM_DISARM
_MODES: Final[dict[str | None, str]] = {"hold": LOITER, "return": RTL}
_REPLACED: Final = "replaced by an order to {}"
PILOTED: Final = frozenset(
    {"MANUAL", "STABILIZE", "STABILIZED", "TRAINING", "ACRO", "FBWA", "FBWB", "CRUISE", "AUTOTUNE"}
    | {"ALTCTL", "POSCTL", "RATTITUDE", "QSTABILIZE", "QHOVER", "QACRO"}
)
"""Modes of manual flight: the pilot keeps control."""
_WAIT_PERIOD_NS: Final = NS_PER_S
"""Time between two checks of an order that waits."""
_MAX_UPLOAD_NS: Final = 15 * NS_PER_S
"""Time for which a return by a mission is tried again, and after which one that is still uploaded is told."""
_MAX_GROUND_SPEED_M_S = 2.0
_MAX_GROUND_HEIGHT_M = 5.0
_MAX_TAKEOFF_SHIFT_M: Final = 30.0
"""Distance from the place of a verified take-off within which it still holds."""
MIN_RESUME_HEIGHT_M: Final = 40.0
"""Minimum height above home at which a vehicle that returns or lands is turned back; landing approaches begin
at 30 m."""
_LEVEL_HEIGHT_M: Final = 20.0
"""The same for a PX4 in RTL that does not descend: its return may end in a low circle, at RTL_DESCEND_ALT."""
_LEVEL_M_S: Final = 0.5


class Orders:
    """Orders to vehicles in progress, and suspended vehicles."""

    def __init__(
        self,
        state: State,
        fleet: Fleet,
        tasking: UploadManager,
        layers: AltitudeLayers,
        takeoff_sequence: TakeoffSequence,
        order_check: OrderCheck,
        landing_order: LandingOrder,
        stacked_missions: StackedMissions,
    ) -> None:
        self._stacked = stacked_missions
        self._order_check = order_check
        self._landing_order = landing_order
        self._state = state
        self._agents = state.agents
        self._operator = state.operator
        self._fleet = fleet
        self._tasking = tasking
        self._layers = layers
        self._takeoff_sequence = takeoff_sequence

    def has_ordered(self, vehicle: int, mode: str) -> bool:
        """Return True if an order put a vehicle into a mode, or a command is in progress."""
        agent = self._agents[vehicle]
        return agent.orders.command is not None or _MODES.get(agent.control.suspension) == mode

    def carry_out(
        self,
        order: Order,
        targets: Container[Label],
        release: Callable[[int, int], None] = lambda _vehicle, _t_ns: None,
    ) -> list[Effect]:
        """Start to carry out an order to vehicles.

        Parameters
        ----------
        order
            One of hold, resume, return, arm, disarm.
        targets
            Confirmed targets.
        release
            Called with each resumed vehicle and the time, before anything is sent to it.
        """
        known = {health.system_id: health for health in self._fleet.health()}
        vehicles = tuple(known if order.vehicles is None else dict.fromkeys(order.vehicles))
        ongoing = OrderInProgress(order, vehicles)
        effects: list[Effect] = []
        begun: list[int] = []
        unchanged: dict[int, str] = {}
        insisted = {v for v in vehicles if v in self._agents and self._waits_for(v) == order.action}
        for vehicle in vehicles:
            if order.action in ("hold", "return", "resume") and vehicle in self._agents:
                effects += self._end_waiting(vehicle, order.t_ns, _REPLACED.format(order.action))
            is_heard = vehicle in known and known[vehicle].liveness == "alive"
            if vehicle not in known:
                refusal = f"no vehicle of this mission; it has {', '.join(map(vehicle_name, known))}"
            elif known[vehicle].address is None:
                refusal = "never heard"
            elif unchanged_state := self._unchanged(order, vehicle, is_heard=is_heard):
                unchanged[vehicle] = f"{unchanged_state}: nothing was changed"
                continue
            else:
                refusal = self._refusal(order, vehicle, begun, is_heard=is_heard)
            if refusal:
                effects.append(ongoing.answer(order.t_ns, "refused", refusal, vehicle))
            else:
                begun.append(vehicle)
        state: AnswerState = "done" if begun and order.vehicles is None else "refused"
        for vehicle, text in unchanged.items():
            effects.append(ongoing.answer(order.t_ns, state, text, vehicle))
        if not ongoing.waiting:
            return effects
        number = self._operator.begin(ongoing)
        waits = self._problems(order, [v for v in begun if v not in insisted])
        clear = [v for v in begun if v not in waits]
        home = self._planned_returns(order, [v for v in clear if v not in insisted], waits)
        for route in home.values():
            effects += self._return_by_mission(number, order, route)
        for vehicle in waits.keys() - home.keys():
            effects += self._wait(number, order, vehicle, waits[vehicle])
        for vehicle in (v for v in clear if v not in home):
            if order.action == "resume":
                release(vehicle, order.t_ns)
            effects += self._begin(number, order, vehicle, known[vehicle].autopilot, targets)
        held_up = waits.keys() - home.keys()
        detail = named(ongoing.waiting) + (f"; {named(held_up)} when clear of others" if held_up else "")
        detail += f"; {named(home)} in altitude layers" if home else ""
        if order.action == "return":
            returning = {
                v
                for v, agent in self._agents.items()
                if agent.control.suspension == "return" and agent.routes.stacked is None
            }
            warning = self._order_check.return_warning(returning)
            detail += f"; {warning}" if warning else ""
            if warning:
                effects.append(Notice(order.t_ns, NoticeCode.RETURN_ORDER_NEAR, None, {"warning": warning}))
        return [ongoing.answer(order.t_ns, "accepted", detail), *effects]

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        command = self._agents[vehicle].orders.command
        if command is None:
            return []
        command.sender.receive(message)
        return self._progress(vehicle, command, t_ns)

    def poll(self, t_ns: int) -> list[Effect]:
        """Run the timers."""
        effects: list[Effect] = []
        for vehicle, agent in self._agents.items():
            effects += self._check_waiting(vehicle, t_ns)
            if agent.orders.command is not None:
                effects += self._progress(vehicle, agent.orders.command, t_ns)
        return effects

    # ------------------------------------------------------------ one vehicle

    def _unchanged(self, order: Order, vehicle: int, *, is_heard: bool) -> str:
        """Return why an order would change nothing; empty if it would, or that is unknown."""
        state = self._fleet.state(vehicle)
        control = self._agents[vehicle].control
        if self._agents[vehicle].orders.command is not None or state is None or not is_heard:
            return ""
        match order.action:
            case "resume" if Authority.REJECTING in control.claims:
                return ""  # resume ends the pause after rejected missions
            case "resume" if state.mode == LOITER and self._agents[vehicle].tasking.retry.failures:
                return ""  # resume ends the pause after failed uploads
            case "resume" if control.is_ours:
                return f"is not suspended, and is in {state.mode or 'an unknown mode'}"
            case "hold" | "return" as action if control.suspension == action and (
                state.mode == _MODES[action] or self._flies_stacked(vehicle, state)
            ):
                return control.reason
            case "arm" | "disarm" if self._agents[vehicle].link.high_latency is not None:
                return ""  # PX4 does not say there whether it is armed
            case "arm" if state.armed:
                return "is armed"
            case "disarm" if not state.armed:
                return "is disarmed"
        return ""

    def _refusal(self, order: Order, vehicle: int, begun: Collection[int], *, is_heard: bool) -> str:
        state = self._fleet.state(vehicle)
        claims = self._agents[vehicle].control.claims
        match order.action:
            case "hold" | "return" | "resume" | "arm" if Authority.DOWN in claims:
                return Authority.DOWN.reason
            case "arm" if Authority.LANDED in claims:
                return Authority.LANDED.reason
            case "hold" | "return" | "resume" if self._fleet.profile(vehicle) is None:
                return Authority.UNSUPPORTED.reason  # its modes are not known
            case "resume":
                refusal = self._cannot_resume(state) or self._blocked(order, vehicle, begun)
                return refusal or self._leads_near(vehicle, begun, order.t_ns)
            case "arm" if not is_heard:
                return "is not heard: its mode is not known"
            case "arm":
                return self._cannot_arm(vehicle, state) or self._blocked(order, vehicle, begun)
            case "disarm":
                return self._cannot_disarm(vehicle, state)
        return ""

    def _cannot_resume(self, state: VehicleState | None) -> str:
        """Return why a vehicle must stay in its mode; empty if it need not."""
        if state is None:
            return ""
        if state.mode in PILOTED:
            return f"is in {state.mode}: its pilot has to give it back"
        height_m = self._fleet.height_m(state)
        profile = self._fleet.profile(state.system_id)
        circles = profile is not None and profile.return_circle_parameters and state.mode == RTL
        is_level = state.climb_m_s > -_LEVEL_M_S and not self._stacked.lands(state.system_id)
        least_m = _LEVEL_HEIGHT_M if circles and is_level else MIN_RESUME_HEIGHT_M
        low = height_m < min(least_m, 0.5 * self._tasking.altitude_rel_m)
        if state.mode == LOITER or _stands(state) or not low:
            return ""
        return (
            f"is in {state.mode}, {height_m:.0f} m above home: too low to turn back; let it land, or order "
            "it to resume when it is higher"
        )

    def _cannot_arm(self, vehicle: int, state: VehicleState | None) -> str:
        """Return why arming would start an unwanted mission; empty if it would not."""
        if state is None or not state.mode:
            return "has not reported its mode and position yet"
        tasking = self._agents[vehicle].tasking
        if tasking.rejections.count and tasking.onboard is None:
            cause = f"its navigator rejects it ({tasking.rejections.cause})"
            return f"has no mission: {cause}; correct its parameters first (`gcs preflight`)"
        if state.mode not in SELF_LAUNCHING or (state.mode == AUTO and self.may_take_off(vehicle)):
            return ""
        return (
            f"is in {state.mode}: armed, it would take off at once, and not with a mission that was read "
            "back from it and is wanted now; order it to hold first, then arm it"
        )

    def _leads_near(self, vehicle: int, resumed: Collection[int], t_ns: int) -> str:
        """Return which vehicle a resumed one would come near to; empty if none."""
        state = self._fleet.state(vehicle)
        mode = self._resumed_mode(vehicle, t_ns)
        is_in_air = state is not None and not is_on_ground(state, self._fleet.home(vehicle))
        if state is None or not is_in_air or state.mode == mode:
            return ""
        modes = {other: self._resumed_mode(other, t_ns) for other in (*resumed, vehicle)}
        problem = self._order_check.problem(vehicle, self._ordered_modes() | modes, t_ns)
        return f"{problem}: resume it when they are apart" if problem else ""

    def _resumed_mode(self, vehicle: int, t_ns: int) -> str:
        """Return AUTO for a vehicle that can fly on with its mission, else LOITER, where it waits for one.

        A mission over terrain keeps above the ground along its route, which the vehicle may have left.
        """
        agent = self._agents[vehicle]
        onboard = agent.tasking.onboard
        suspended = agent.routes.suspended
        if suspended is not None and suspended.heights_msl_m is not None:
            return LOITER
        is_stored = onboard is not None and onboard.route.is_same(suspended or agent.routes.flown)
        return AUTO if is_stored and not self._order_check.leads_near_ground(vehicle, AUTO, t_ns) else LOITER

    # ------------------------------------------------------------ orders that wait

    def _ordered_modes(self) -> dict[int, str]:
        """Return the modes that commands in progress set, by vehicle."""
        commands = {vehicle: agent.orders.command for vehicle, agent in self._agents.items()}
        actions = {v: command.action for v, command in commands.items() if command is not None}
        return {v: _MODES[action] for v, action in actions.items() if action in _MODES}

    def _problems(self, order: Order, vehicles: Sequence[int]) -> dict[int, str]:
        """Return the vehicles that an order to hold or return must not reach yet, with the reasons.

        Those that are clear when all obey are not among them; of the others, as many as possible.
        """
        if order.action not in _MODES:
            return {}
        mode = _MODES[order.action]
        before = self._ordered_modes()
        together = before | dict.fromkeys(vehicles, mode)
        unclear = [v for v in vehicles if self._order_check.problem(v, together, order.t_ns)]
        modes = before | {v: mode for v in vehicles if v not in unclear}
        problems: dict[int, str] = {}
        for vehicle in unclear:
            problem = self._order_check.problem(vehicle, modes | {vehicle: mode}, order.t_ns)
            if problem:
                problems[vehicle] = problem
            else:
                modes[vehicle] = mode
        return problems

    def _planned_returns(
        self, order: Order, clear: Sequence[int], unclear: Collection[int]
    ) -> dict[int, Route]:
        """Return the routes home of vehicles that RTL would lead near others.

        Then all land in order where missions land: in RTL one would circle where others descend.
        """
        if order.action != "return" or not unclear:
            return {}
        landing = [vehicle for vehicle in clear if self._stacked.lands(vehicle)]
        modes = self._ordered_modes() | {v: RTL for v in clear if v not in landing}
        return self._stacked.plan_returns([*landing, *unclear], modes, order.t_ns)

    def _return_by_mission(
        self, number: int, order: Order, route: Route, since_t_ns: int | None = None
    ) -> list[Effect]:
        """Begin a return by a mission, or try it again; an older command to the vehicle ends."""
        vehicle = route.vehicle
        effects = self._end_command(vehicle, order.t_ns, _REPLACED.format(order.action))
        self._agents[vehicle].claims.apply(ControlEvent.RETURN, order.t_ns)
        self._agents[vehicle].routes.suspend(is_uploaded=vehicle not in self._state.tasking.stages)
        self._defer(number, order, vehicle, uploads_since_t_ns=since_t_ns or order.t_ns)
        return effects + self._stacked.send(route, order.t_ns)

    def _return_again(
        self, number: int, order: Order, vehicle: int, problem: str, since_t_ns: int
    ) -> list[Effect]:
        """Try a return by a mission again whose upload has failed; tell of an upload that takes long."""
        if not self._state.tasking.has_pending(vehicle):
            if order.t_ns - since_t_ns <= _MAX_UPLOAD_NS:
                route = self._stacked.plan_returns([vehicle], self._ordered_modes(), order.t_ns).get(vehicle)
                if route is not None:
                    return self._return_by_mission(number, order, route, since_t_ns)
            self._agents[vehicle].routes.unstack()
        return self._wait(number, order, vehicle, problem)

    def _flies_stacked(self, vehicle: int, state: VehicleState) -> bool:
        """Return True if a vehicle flies the mission that returns it, or holds it in a layer."""
        agent = self._agents[vehicle]
        onboard = agent.tasking.onboard
        is_stored = onboard is not None and onboard.route.is_same(agent.routes.stacked)
        return is_stored and state.mode == AUTO and not self._state.tasking.has_pending(vehicle)

    def _waits_for(self, vehicle: int) -> str:
        """Return the action of the order that waits for a vehicle; empty if there is none."""
        waiting = self._agents[vehicle].orders.waiting
        return "" if waiting is None else self._operator.orders[waiting.order].order.action

    def _wait(self, number: int, order: Order, vehicle: int, problem: str) -> list[Effect]:
        """Let an order wait, with an alarm; an older command to the vehicle goes on."""
        self._defer(number, order, vehicle)
        parameters: dict[str, Parameter] = {"action": order.action, "reason": problem}
        return [Notice(order.t_ns, NoticeCode.ORDER_WAITS, vehicle, parameters)]

    def _defer(self, number: int, order: Order, vehicle: int, uploads_since_t_ns: int | None = None) -> None:
        state = self._fleet.state(vehicle)
        mode = "" if state is None else state.mode
        due_t_ns = order.t_ns + _WAIT_PERIOD_NS
        self._agents[vehicle].orders.waiting = WaitingOrder(number, mode, due_t_ns, uploads_since_t_ns)

    def _check_waiting(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Carry out an order that waits once its vehicle is clear; end it if somebody else takes over."""
        waiting = self._agents[vehicle].orders.waiting
        state = self._fleet.state(vehicle)
        if waiting is None or t_ns < waiting.next_check_t_ns:
            return []
        waiting.next_check_t_ns = t_ns + _WAIT_PERIOD_NS
        order = self._operator.orders[waiting.order].order
        health = next(one for one in self._fleet.health() if one.system_id == vehicle)
        if state is None or health.liveness != "alive":  # whether it is clear is not known
            if waiting.uploads_since_t_ns is not None:
                waiting.uploads_since_t_ns = t_ns  # an upload goes on when it is heard again
            return []
        ended = self._refusal(order, vehicle, (), is_heard=True)
        if is_on_ground(state, self._fleet.home(vehicle)):
            ended = "it has landed meanwhile"
        elif state.mode not in (waiting.mode, AUTO, LOITER) or self._is_taken(vehicle, order.t_ns):
            ended = f"its mode was changed to {state.mode} meanwhile"
        if ended:
            return self._end_waiting(vehicle, t_ns, ended)
        order = replace(order, t_ns=t_ns)
        stacked = self._agents[vehicle].routes.stacked
        is_sent_home = stacked is not None and not is_hold(stacked)
        if order.action == "return" and is_sent_home and self._flies_stacked(vehicle, state):
            self._agents[vehicle].orders.waiting = None
            height_m = self._fleet.height_m(state)
            done = f"AUTO, armed: flies home in its altitude layer, now at {height_m:.0f} m"
            return [self._operator.finish(waiting.order, t_ns, "done", done, vehicle)]
        if waiting.uploads_since_t_ns is not None:
            is_late = t_ns - waiting.uploads_since_t_ns > _MAX_UPLOAD_NS
            if self._state.tasking.has_pending(vehicle) and not is_late:
                return []
        modes = self._ordered_modes() | {vehicle: _MODES[order.action]}
        problem = self._order_check.problem(vehicle, modes, t_ns)
        if problem and waiting.uploads_since_t_ns is None:
            return []
        self._agents[vehicle].orders.waiting = None
        if problem and waiting.uploads_since_t_ns is not None:
            return self._return_again(waiting.order, order, vehicle, problem, waiting.uploads_since_t_ns)
        return [
            Notice(t_ns, NoticeCode.ORDER_BEGINS, vehicle, {"action": order.action}),
            *self._begin(waiting.order, order, vehicle, health.autopilot, ()),
        ]

    def _is_taken(self, vehicle: int, since_t_ns: int) -> bool:
        """Return True if somebody else chose, or commanded, a mode of a vehicle after a time."""
        claims = self._agents[vehicle].claims
        chosen_t_ns = (claims.since_t_ns(one) for one in (Authority.OVERRIDDEN, Authority.COMMANDED))
        return any(t_ns is not None and t_ns > since_t_ns for t_ns in chosen_t_ns)

    def _end_waiting(self, vehicle: int, t_ns: int, reason: str) -> list[Effect]:
        """End an order that waits."""
        orders = self._agents[vehicle].orders
        waiting = orders.waiting
        orders.waiting = None
        if waiting is None:
            return []
        self._agents[vehicle].routes.unstack()
        return [self._operator.finish(waiting.order, t_ns, "failed", reason, vehicle)]

    # ------------------------------------------------------------ take-offs and missions

    def _blocked(self, order: Order, vehicle: int, begun: Collection[int]) -> str:
        """Return which vehicle blocks the take-off that an order starts; empty if none does."""
        if not self._takeoff_sequence.launches(vehicle, order.action):
            return ""
        starting = self._takeoff_sequence.launching() | {
            other for other in begun if self._takeoff_sequence.launches(other, order.action)
        }
        reason = self._takeoff_sequence.blocked_by(vehicle, starting, order.t_ns)
        return f"would take off at once, and {reason}, then order it again" if reason else ""

    def may_fly(self, vehicle: int) -> bool:
        """Return True if the verified onboard mission is the one to fly now."""
        agent = self._agents[vehicle]
        onboard = agent.tasking.onboard
        is_stored = onboard is not None and onboard.route.is_same(agent.routes.flown)
        is_suspended = agent.control.suspension is not None
        return is_stored and not is_suspended and vehicle not in self._state.tasking.stages

    def may_take_off(self, vehicle: int) -> bool:
        """Return True if that mission was also verified for a take-off from where the vehicle stands."""
        state = self._fleet.state(vehicle)
        onboard = self._agents[vehicle].tasking.onboard
        if state is None or onboard is None or onboard.takeoff_m is None or not self.may_fly(vehicle):
            return False
        return math.dist(onboard.takeoff_m, (state.east_m, state.north_m)) <= _MAX_TAKEOFF_SHIFT_M

    def _cannot_disarm(self, vehicle: int, state: VehicleState | None) -> str:
        """Return why a vehicle may be in the air; empty if it reports that it is on the ground."""
        home = self._fleet.home(vehicle)
        if state is None or home is None:
            return "its position and home are not known: it may be in the air"
        height_m = state.alt_msl_m - home.alt_msl_m
        is_low = abs(height_m) <= _MAX_GROUND_HEIGHT_M or state.grounded is True
        if state.ground_speed_m_s > _MAX_GROUND_SPEED_M_S or not is_low:
            return f"is in the air: {height_m:.0f} m above home, {state.ground_speed_m_s:.0f} m/s"
        return ""

    def _begin(
        self, number: int, order: Order, vehicle: int, autopilot: int, targets: Container[Label]
    ) -> list[Effect]:
        effects: list[Effect] = self._end_command(vehicle, order.t_ns, _REPLACED.format(order.action))
        if order.action in ("arm", "disarm"):
            arm = order.action == "arm"
            command = command_long(vehicle, _ARM_DISARM, 1.0 if arm else 0.0)
            sender = CommandSender.begin(command, order.t_ns, armed=arm)
            return effects + self._send(number, vehicle, sender, order.t_ns)
        if order.action == "resume":
            mode = self._resume(vehicle, targets, order.t_ns)
        else:
            mode = _MODES[order.action]
            event = ControlEvent.HOLD if order.action == "hold" else ControlEvent.RETURN
            self._agents[vehicle].claims.apply(event, order.t_ns)
            effects += self._suspend(vehicle, order.action, order.t_ns)
        authority = self._tasking.overrides.of(vehicle)
        before = authority.mode if order.action == "resume" else ""
        authority.note_command(mode)  # LOITER by an order is ours
        command = set_mode(vehicle, autopilot, mode)
        sender = CommandSender.begin(command, order.t_ns, mode=mode, before=before)
        return effects + self._send(number, vehicle, sender, order.t_ns)

    def _suspend(self, vehicle: int, action: str, t_ns: int) -> list[Effect]:
        self._agents[vehicle].routes.suspend(is_uploaded=vehicle not in self._state.tasking.stages)
        return self._tasking.abandon(vehicle, f"given up for an order to {action}", t_ns, _MODES[action])

    def _resume(self, vehicle: int, targets: Container[Label], t_ns: int) -> str:
        """End a suspension; return the mode to command."""
        self._tasking.release_override(vehicle, t_ns)
        routes = self._agents[vehicle].routes
        route = routes.pop_suspended()
        if routes.flown is None:
            flown = flown_routes(self._agents).values()
            if route is None or route.target not in targets or route.target in {r.target for r in flown}:
                return LOITER
            if route.heights_msl_m is not None:
                return LOITER  # the next plan begins where it is, and at its height
            positions = {state.system_id: (state.east_m, state.north_m) for state in self._fleet.states()}
            if not self._layers.is_clear(route, list(flown), positions):
                return LOITER  # the next plan has a layer for it
            routes.adopt(route)
        is_clear = not self._order_check.leads_near_ground(vehicle, AUTO, t_ns)
        if self.may_fly(vehicle) and is_clear and self._landing_order.claim(vehicle, t_ns):
            return AUTO
        if vehicle not in self._state.tasking.stages:
            routes.drop_flown()  # the next plan has another
        return LOITER

    # ------------------------------------------------------------ commands

    def _send(self, number: int, vehicle: int, sender: CommandSender, t_ns: int) -> list[Effect]:
        command = self._agents[vehicle].orders.command = Command(
            sender, number, self._operator.orders[number].order.action
        )
        return self._progress(vehicle, command, t_ns)

    def _progress(self, vehicle: int, command: Command, t_ns: int) -> list[Effect]:
        frames = command.sender.poll(t_ns, self._fleet.encoder(vehicle))
        effects: list[Effect] = [*self._fleet.address_frames(vehicle, frames)]
        self._fleet.forward_next_heartbeat(vehicle)
        if command.sender.outcome is not None:
            self._agents[vehicle].orders.command = None
            done, detail = command.sender.outcome
            action = command.action
            if action == "resume" and done:
                detail += "" if self.may_fly(vehicle) else f": {self._outlook(vehicle)}"
            elif action == "resume" and vehicle not in self._state.tasking.stages:
                self._agents[vehicle].routes.drop_flown()  # the next plan has another
                detail += "; it gets a new mission with the next plan"
            result: AnswerState = "done" if done else "failed"
            effects.append(self._operator.finish(command.order, t_ns, result, detail, vehicle))
        return effects

    def _outlook(self, vehicle: int) -> str:
        """Return what a released vehicle in LOITER can expect, in words."""
        if Authority.LANDED in self._agents[vehicle].claims:
            return Authority.LANDED.reason
        match self._state.agents[vehicle].perception.status.status:
            case "arrived":
                return "has reached its target and gets no other"
            case "down":
                return "is down"
            case "lost":
                return "is lost; it gets a mission when it is tracked again"
        if self._state.has_ended:
            return "gets no mission, since the mission has ended"
        return "waits for its next mission"

    def _end_command(self, vehicle: int, t_ns: int, reason: str) -> list[Effect]:
        """End a command in progress, for a newer order."""
        orders = self._agents[vehicle].orders
        command = orders.command
        orders.command = None
        if command is None:
            return []
        return [self._operator.finish(command.order, t_ns, "failed", reason, vehicle)]


def _stands(state: VehicleState) -> bool:
    """Return True if a vehicle is disarmed and reports no ground speed."""
    return not state.armed and state.ground_speed_m_s <= _MAX_GROUND_SPEED_M_S
