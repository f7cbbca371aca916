"""Returns by missions: orders to return of vehicles that RTL would lead near others.

Such a vehicle gets a mission home in an altitude layer of its own (`gcs.core.replanning.stacked_missions`).
The order waits for its upload, as for vehicles that are near (`gcs.core.operator.waiting_orders`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

from gcs.core.operator.order_commands import REPLACED, OrderCommands, ordered_modes
from gcs.core.replanning.stacked_missions import StackedMissions
from gcs.core.state import State
from gcs.mavlink.autopilots.modes import RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import NS_PER_S, ControlEvent, Effect, Order, Route

MAX_UPLOAD_NS: Final = 15 * NS_PER_S
"""Time for which a return by a mission is tried again, and after which one that is still uploaded is told."""


class ReturnMissions:
    """Begins returns by missions, and tries them again."""

    def __init__(
        self, state: State, fleet: Fleet, commands: OrderCommands, stacked_missions: StackedMissions
    ) -> None:
        self._agents = state.agents
        self._tasking = state.tasking
        self._fleet = fleet
        self._commands = commands
        self._stacked = stacked_missions

    def plan(self, order: Order, clear: Sequence[int], unclear: Collection[int]) -> dict[int, Route]:
        """Return the routes home of vehicles that RTL would lead near others.

        Then all land in order where missions land: in RTL one would circle where others descend.
        """
        if order.action != "return" or not unclear:
            return {}
        landing = [vehicle for vehicle in clear if self._stacked.lands(vehicle)]
        modes = ordered_modes(self._agents) | {v: RTL for v in clear if v not in landing}
        return self._stacked.plan_returns([*landing, *unclear], modes, order.t_ns)

    def begin(self, number: int, order: Order, route: Route, since_t_ns: int | None = None) -> list[Effect]:
        """Begin a return by a mission, or try it again; an older command to the vehicle ends."""
        vehicle = route.vehicle
        agent = self._agents[vehicle]
        effects = self._commands.end(vehicle, order.t_ns, REPLACED.format(order.action))
        agent.claims.apply(ControlEvent.RETURN, order.t_ns)
        agent.routes.suspend(is_uploaded=not self._tasking.stage(vehicle))
        state = self._fleet.state(vehicle)
        mode = "" if state is None else state.mode
        agent.orders.wait(number, mode, order.t_ns, uploads_since_t_ns=since_t_ns or order.t_ns)
        return effects + self._stacked.send(route, order.t_ns)

    def begin_again(self, number: int, order: Order, vehicle: int, since_t_ns: int) -> list[Effect] | None:
        """Plan a return by a mission again, and begin it; None if it takes too long, or has no route."""
        if self._tasking.has_pending(vehicle) or order.t_ns - since_t_ns > MAX_UPLOAD_NS:
            return None
        modes = ordered_modes(self._agents)
        route = self._stacked.plan_returns([vehicle], modes, order.t_ns).get(vehicle)
        return None if route is None else self.begin(number, order, route, since_t_ns)
