"""Commands of orders to vehicles, repeated until the heartbeat shows the result.

An order suspends its vehicle at once: it is not tasked, whatever the result of the command. An upload in
progress is ended safely first. The commands are sent by `gcs.mavlink.services.command_sender`.

A resumed vehicle continues its verified mission if its target and the time of its landing are still free;
otherwise it waits in LOITER for the next plan. It gets no upload until it is in LOITER, which would undo the
start of the mission.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.operator.operator_state import Command
from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.separation.landing_order import LandingOrder
from gcs.core.separation.order_check import OrderCheck
from gcs.core.state import Agent, State, flown_routes
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.command_sender import CommandSender, command_long, set_mode
from gcs.model import AnswerState, Authority, ControlEvent, Effect, Label, Order

MODES: Final[dict[str | None, str]] = {"hold": LOITER, "return": RTL}
"""Modes that orders to hold and return set, by action."""
REPLACED: Final = "replaced by an order to {}"
_ARM_DISARM: Final[int] = dialect.MAV_CMD_COMPONENT_ARM_DISARM


class OrderCommands:
    """Commands to vehicles in progress, and suspended vehicles."""

    def __init__(
        self,
        state: State,
        fleet: Fleet,
        tasking: UploadManager,
        layers: AltitudeLayers,
        order_check: OrderCheck,
        landing_order: LandingOrder,
    ) -> None:
        self._state = state
        self._agents = state.agents
        self._operator = state.operator
        self._fleet = fleet
        self._tasking = tasking
        self._layers = layers
        self._order_check = order_check
        self._landing_order = landing_order

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        command = self._agents[vehicle].orders.command
        if command is None:
            return []
        command.sender.receive(message)
        return self._progress(vehicle, command, t_ns)

    def poll(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Repeat the command to a vehicle that has not confirmed it."""
        command = self._agents[vehicle].orders.command
        return [] if command is None else self._progress(vehicle, command, t_ns)

    def begin(
        self, number: int, order: Order, vehicle: int, autopilot: int, targets: Container[Label]
    ) -> list[Effect]:
        """Begin to carry out an order to a vehicle; an older command to it ends."""
        effects: list[Effect] = self.end(vehicle, order.t_ns, REPLACED.format(order.action))
        if order.action in ("arm", "disarm"):
            arm = order.action == "arm"
            command = command_long(vehicle, _ARM_DISARM, 1.0 if arm else 0.0)
            sender = CommandSender.begin(command, order.t_ns, armed=arm)
            return effects + self._send(number, vehicle, sender, order.t_ns)
        if order.action == "resume":
            effects += self._give_up_stacked(vehicle, order.t_ns)
            mode = self._resume(vehicle, targets, order.t_ns)
        else:
            mode = MODES[order.action]
            event = ControlEvent.HOLD if order.action == "hold" else ControlEvent.RETURN
            self._agents[vehicle].claims.apply(event, order.t_ns)
            effects += self._suspend(vehicle, order.action, order.t_ns)
        authority = self._tasking.overrides.of(vehicle)
        before = authority.mode if order.action == "resume" else ""
        authority.note_command(mode)  # LOITER by an order is ours
        command = set_mode(vehicle, autopilot, mode)
        sender = CommandSender.begin(command, order.t_ns, mode=mode, before=before)
        return effects + self._send(number, vehicle, sender, order.t_ns)

    def end(self, vehicle: int, t_ns: int, reason: str) -> list[Effect]:
        """End a command in progress, for a newer order."""
        orders = self._agents[vehicle].orders
        command = orders.command
        orders.command = None
        if command is None:
            return []
        return [self._operator.finish(command.order, t_ns, "failed", reason, vehicle)]

    def _suspend(self, vehicle: int, action: str, t_ns: int) -> list[Effect]:
        self._agents[vehicle].routes.suspend(is_uploaded=not self._state.tasking.stage(vehicle))
        return self._tasking.abandon(vehicle, f"given up for an order to {action}", t_ns, MODES[action])

    def _give_up_stacked(self, vehicle: int, t_ns: int) -> list[Effect]:
        """End the upload of a mission that returns or holds a vehicle."""
        is_suspended = self._agents[vehicle].control.suspension is not None
        if not is_suspended or not self._state.tasking.has_pending(vehicle):
            return []
        return self._tasking.abandon(vehicle, "given up for an order to resume", t_ns, LOITER)

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
        is_clear = self._order_check.mission_is_clear(vehicle, t_ns)
        if self._tasking.may_fly(vehicle) and is_clear and self._landing_order.claim(vehicle, t_ns):
            return AUTO
        if not self._state.tasking.stage(vehicle):
            routes.drop_flown()  # the next plan has another
        return LOITER

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
                detail += "" if self._tasking.may_fly(vehicle) else f": {self._outlook(vehicle)}"
            elif action == "resume" and not self._state.tasking.stage(vehicle):
                self._agents[vehicle].routes.drop_flown()  # the next plan has another
                is_lost = self._agents[vehicle].perception.status.status in ("down", "lost")
                detail += (
                    f"; {self._outlook(vehicle) if is_lost else 'it gets a new mission with the next plan'}"
                )
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


def ordered_modes(agents: Mapping[int, Agent]) -> dict[int, str]:
    """Return the modes that commands in progress set, by vehicle."""
    commands = {vehicle: agent.orders.command for vehicle, agent in agents.items()}
    actions = {v: command.action for v, command in commands.items() if command is not None}
    return {v: MODES[action] for v, action in actions.items() if action in MODES}
