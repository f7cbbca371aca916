"""Orders of an operator to vehicles: hold, resume, return, arm, disarm.

An order is refused (`gcs.core.operator.order_refusals`), commanded (`gcs.core.operator.order_commands`), or
waits until it leads its vehicle near no other one (`gcs.core.operator.waiting_orders`). A vehicle that RTL
would lead near others returns by a mission (`gcs.core.operator.return_missions`).

An order is done when the vehicle's heartbeat shows it. An order that changes nothing is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Container

from gcs.core.operator.operator_state import OrderInProgress
from gcs.core.operator.order_commands import MODES, REPLACED, OrderCommands
from gcs.core.operator.order_refusals import OrderRefusals, not_in_mission
from gcs.core.operator.return_missions import ReturnMissions
from gcs.core.operator.waiting_orders import WaitingOrders
from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.replanning.stacked_missions import StackedMissions
from gcs.core.separation.landing_order import LandingOrder
from gcs.core.separation.order_check import OrderCheck
from gcs.core.state import State
from gcs.core.takeoff.sequence import TakeoffSequence
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.model import AnswerState, Effect, Label, Notice, NoticeCode, Order, named


class Orders:
    """Orders to vehicles, from their receipt to their results."""

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
        self._agents = state.agents
        self._operator = state.operator
        self._fleet = fleet
        self._order_check = order_check
        self._commands = OrderCommands(state, fleet, tasking, layers, order_check, landing_order)
        self._refusals = OrderRefusals(state, fleet, tasking, takeoff_sequence, order_check, stacked_missions)
        self._returns = ReturnMissions(state, fleet, self._commands, stacked_missions)
        self._waiting = WaitingOrders(
            state, fleet, order_check, self._refusals, self._commands, self._returns, stacked_missions
        )

    def has_ordered(self, vehicle: int, mode: str) -> bool:
        """Return True if an order put a vehicle into a mode, or a command is in progress."""
        agent = self._agents[vehicle]
        return agent.orders.command is not None or MODES.get(agent.control.suspension) == mode

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
        flights = self._order_check.predict(order.t_ns)
        insisted = {v for v in vehicles if v in self._agents and self._waiting.action(v) == order.action}
        for vehicle in vehicles:
            is_heard = vehicle in known and known[vehicle].liveness == "alive"
            if vehicle not in known:
                refusal = not_in_mission(known)
            elif known[vehicle].address is None:
                refusal = "never heard"
            elif unchanged_state := self._refusals.unchanged(order, vehicle, is_heard=is_heard):
                unchanged[vehicle] = f"{unchanged_state}: nothing was changed"
                if vehicle not in insisted:
                    effects += self._end_waiting(order, vehicle)
                continue
            else:
                refusal = self._refusals.refusal(order, vehicle, begun, flights, is_heard=is_heard)
            if refusal:
                effects.append(ongoing.answer(order.t_ns, "refused", refusal, vehicle))
            else:
                effects += self._end_waiting(order, vehicle)
                begun.append(vehicle)
        state: AnswerState = "done" if begun and order.vehicles is None else "refused"
        for vehicle, text in unchanged.items():
            effects.append(ongoing.answer(order.t_ns, state, text, vehicle))
        if not ongoing.waiting:
            return effects
        number = self._operator.begin(ongoing)
        waits = self._waiting.problems(order, [v for v in begun if v not in insisted], flights)
        clear = [v for v in begun if v not in waits]
        home = self._returns.plan(order, [v for v in clear if v not in insisted], waits)
        for route in home.values():
            effects += self._returns.begin(number, order, route)
        for vehicle in waits.keys() - home.keys():
            effects += self._waiting.wait(number, order, vehicle, waits[vehicle])
        for vehicle in (v for v in clear if v not in home):
            if order.action == "resume":
                release(vehicle, order.t_ns)
            effects += self._commands.begin(number, order, vehicle, known[vehicle].autopilot, targets)
        held_up = waits.keys() - home.keys()
        detail = named(ongoing.waiting)
        if held_up:
            first = min(held_up)
            detail += f"; {named(held_up)} when clear ({named([first])} {waits[first]})"
            detail += "; the same order again is carried out at once"
        detail += f"; {named(home)} in altitude layers" if home else ""
        unheard = [v for v in begun if known[v].liveness != "alive"]
        detail += f"; {named(unheard)} not heard at present" if unheard else ""
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

    def _end_waiting(self, order: Order, vehicle: int) -> list[Effect]:
        """End an order that waits for a newer one that is not refused."""
        if order.action not in ("hold", "return", "resume"):
            return []
        return self._waiting.end(vehicle, order.t_ns, REPLACED.format(order.action))

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        return self._commands.receive(vehicle, message, t_ns)

    def poll(self, t_ns: int) -> list[Effect]:
        """Run the timers."""
        effects: list[Effect] = []
        flights = self._order_check.predict(t_ns)
        due = self._waiting.due(t_ns)
        for vehicle in self._agents:
            if vehicle in due:
                effects += self._waiting.poll(vehicle, flights)
            effects += self._commands.poll(vehicle, t_ns)
        return effects
