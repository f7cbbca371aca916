"""Orders to hold or return that wait: at once they would lead their vehicle near another one.

Each begins when its vehicle is clear. A return begins also when a mission home is found. An alarm tells of it
at once; given again, the order is carried out at once. It ends if somebody else takes over. Returns by
missions wait here for their uploads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from gcs.core.operator.operator_state import WAIT_PERIOD_NS, WaitingOrder
from gcs.core.operator.order_commands import MODES, OrderCommands, ordered_modes
from gcs.core.operator.order_refusals import OrderRefusals
from gcs.core.operator.return_missions import MAX_UPLOAD_NS, ReturnMissions
from gcs.core.replanning.stacked_missions import StackedMissions
from gcs.core.separation.order_check import OrderCheck
from gcs.core.separation.predicted_flights import PredictedFlights
from gcs.core.state import State
from gcs.core.tasking.mission_builder import is_hold
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.model import Authority, Effect, Notice, NoticeCode, Order, Parameter

MAX_CHECKS: Final = 4
"""Orders that are checked at a tick; others at the next ones. Each takes some 10 ms in a fleet of 400."""
_MIN_TURNS: Final = 5
"""Least number of checks between two plans of one vehicle's return."""


class WaitingOrders:
    """Orders that wait until their vehicles are clear of others."""

    def __init__(
        self,
        state: State,
        fleet: Fleet,
        order_check: OrderCheck,
        refusals: OrderRefusals,
        commands: OrderCommands,
        returns: ReturnMissions,
        stacked_missions: StackedMissions,
    ) -> None:
        self._agents = state.agents
        self._operator = state.operator
        self._tasking = state.tasking
        self._fleet = fleet
        self._order_check = order_check
        self._refusals = refusals
        self._commands = commands
        self._returns = returns
        self._stacked = stacked_missions

    def problems(self, order: Order, vehicles: Sequence[int], flights: PredictedFlights) -> dict[int, str]:
        """Return the vehicles that an order to hold or return must not reach yet, with the reasons.

        Those that are clear when all obey are not among them; of the others, as many as possible.
        """
        if order.action not in MODES:
            return {}
        mode = MODES[order.action]
        before = ordered_modes(self._agents)
        together = before | dict.fromkeys(vehicles, mode)
        unclear = [v for v in vehicles if self._order_check.problem(v, together, flights)]
        modes = before | {v: mode for v in vehicles if v not in unclear}
        problems: dict[int, str] = {}
        for vehicle in unclear:
            problem = self._order_check.problem(vehicle, modes | {vehicle: mode}, flights)
            if problem:
                problems[vehicle] = problem
            else:
                modes[vehicle] = mode
        return problems

    def action(self, vehicle: int) -> str:
        """Return the action of the order that waits for a vehicle; empty if there is none."""
        waiting = self._agents[vehicle].orders.waiting
        return "" if waiting is None else self._operator.orders[waiting.order].order.action

    def wait(self, number: int, order: Order, vehicle: int, problem: str) -> list[Effect]:
        """Let an order wait, with one alarm; an older command to the vehicle goes on."""
        state = self._fleet.state(vehicle)
        orders = self._agents[vehicle].orders
        orders.wait(number, "" if state is None else state.mode, order.t_ns)
        if orders.waiting is None or orders.waiting.is_told:
            return []
        orders.waiting.is_told = True
        parameters: dict[str, Parameter] = {"action": order.action, "reason": problem}
        return [Notice(order.t_ns, NoticeCode.ORDER_WAITS, vehicle, parameters)]

    def due(self, t_ns: int) -> list[int]:
        """Return the vehicles whose orders are checked at this tick, those first that wait longest for it."""
        waiting = {v: agent.orders.waiting for v, agent in self._agents.items()}
        checks_t_ns = {v: one.next_check_t_ns for v, one in waiting.items() if one is not None}
        found = [vehicle for vehicle, check_t_ns in checks_t_ns.items() if check_t_ns <= t_ns]
        return sorted(found, key=checks_t_ns.__getitem__)[:MAX_CHECKS]

    def poll(self, vehicle: int, flights: PredictedFlights) -> list[Effect]:
        """Carry out an order that is `due` once its vehicle is clear; end it if somebody else takes over.

        The flights are predicted anew after a change of one.
        """
        waiting = self._agents[vehicle].orders.waiting
        t_ns = flights.t_ns
        if waiting is None:
            return []
        waiting.next_check_t_ns = t_ns + WAIT_PERIOD_NS
        order = self._operator.orders[waiting.order].order
        state = self._fleet.state(vehicle)
        health = self._fleet.health_of(vehicle)
        if state is None or health.liveness != "alive":
            return self._keep_waiting(waiting, t_ns)
        ended = self._refusals.refusal(order, vehicle, (), flights, is_heard=True)
        if is_on_ground(state, self._fleet.home(vehicle)):
            ended = "it has landed meanwhile"
        elif state.mode not in (waiting.mode, AUTO, LOITER) or self._is_taken(vehicle, order.t_ns):
            ended = f"its mode was changed to {state.mode} meanwhile"
        if ended:
            return self.end(vehicle, t_ns, ended)
        if vehicle not in flights.states:  # its positions are too old
            return self._keep_waiting(waiting, t_ns)
        order = replace(order, t_ns=t_ns)
        stacked = self._agents[vehicle].routes.stacked
        is_sent_home = stacked is not None and not is_hold(stacked)
        if order.action == "return" and is_sent_home and self._stacked.is_flown(vehicle):
            self._agents[vehicle].orders.waiting = None
            height_m = self._fleet.height_m(state)
            done = f"AUTO, armed: flies home in its altitude layer, now at {height_m:.0f} m"
            return [self._operator.finish(waiting.order, t_ns, "done", done, vehicle)]
        if waiting.uploads_since_t_ns is not None:
            is_late = t_ns - waiting.uploads_since_t_ns > MAX_UPLOAD_NS
            if self._tasking.has_pending(vehicle) and not is_late:
                return []
        modes = ordered_modes(self._agents) | {vehicle: MODES[order.action]}
        problem = self._order_check.problem(vehicle, modes, flights)
        if problem and waiting.uploads_since_t_ns is None:
            if order.action != "return" or not self._is_due(vehicle, t_ns):
                return []
            flights.renew()
            return self._returns.begin_again(waiting.order, order, vehicle, t_ns) or []
        flights.renew()
        if problem and waiting.uploads_since_t_ns is not None:
            since_t_ns = waiting.uploads_since_t_ns
            begun = self._returns.begin_again(waiting.order, order, vehicle, since_t_ns)
            if begun is None and not self._tasking.has_pending(vehicle):
                self._agents[vehicle].routes.unstack()
            return self.wait(waiting.order, order, vehicle, problem) if begun is None else begun
        self._agents[vehicle].orders.waiting = None
        return [
            Notice(t_ns, NoticeCode.ORDER_BEGINS, vehicle, {"action": order.action}),
            *self._commands.begin(waiting.order, order, vehicle, health.autopilot, ()),
        ]

    def _keep_waiting(self, waiting: WaitingOrder, t_ns: int) -> list[Effect]:
        """Let an order wait on: whether its vehicle is clear is not known. An upload goes on later."""
        if waiting.uploads_since_t_ns is not None:
            waiting.uploads_since_t_ns = t_ns
        return []

    def _is_due(self, vehicle: int, t_ns: int) -> bool:
        """Return True if the return of a vehicle is planned again now: of one vehicle in each second."""
        if t_ns < self._agents[vehicle].tasking.retry.paused_until_t_ns:
            return False
        waiting = [one for one in self._agents if self.action(one) == "return"]
        turns = max(len(waiting), _MIN_TURNS)
        return t_ns // WAIT_PERIOD_NS % turns == waiting.index(vehicle)

    def _is_taken(self, vehicle: int, since_t_ns: int) -> bool:
        """Return True if somebody else chose, or commanded, a mode of a vehicle after a time."""
        claims = self._agents[vehicle].claims
        chosen_t_ns = (claims.since_t_ns(one) for one in (Authority.OVERRIDDEN, Authority.COMMANDED))
        return any(t_ns is not None and t_ns > since_t_ns for t_ns in chosen_t_ns)

    def end(self, vehicle: int, t_ns: int, reason: str) -> list[Effect]:
        """End an order that waits."""
        orders = self._agents[vehicle].orders
        waiting = orders.waiting
        orders.waiting = None
        if waiting is None:
            return []
        self._agents[vehicle].routes.unstack()
        return [self._operator.finish(waiting.order, t_ns, "failed", reason, vehicle)]
