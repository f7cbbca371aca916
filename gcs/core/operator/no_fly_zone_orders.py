"""Orders that close or open a no-fly zone."""

from __future__ import annotations

from collections.abc import Callable, Collection

from gcs.core.airspace.incursion_warning import IncursionWarnings
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.operator.replies import OrderInProgress, named
from gcs.core.perception.agent_status import AgentStatusMonitor
from gcs.core.replanning.replanner import Replanner
from gcs.core.replanning.return_routes import ReturnRoutes
from gcs.core.takeoff.climbs import Climbs
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import Effect, Notice, Order


class NoFlyZoneOrders:
    """Carries out orders that close or open a no-fly zone.

    Parameters
    ----------
    zones : NoFlyZones
        The closed zones, and the map with them.
    fleet : Fleet
        Positions of vehicles.
    replanner, return_routes, climbs
        Users of the map.
    agent_status : AgentStatusMonitor
        Agents that have arrived.
    incursions : IncursionWarnings
        Predicts incursions of onboard missions.
    needs_approval : bool
        True if plans wait for an operator's approval.
    """

    def __init__(
        self,
        zones: NoFlyZones,
        fleet: Fleet,
        replanner: Replanner,
        return_routes: ReturnRoutes,
        climbs: Climbs,
        agent_status: AgentStatusMonitor,
        incursions: IncursionWarnings,
        *,
        needs_approval: bool,
    ) -> None:
        self._zones, self._fleet, self._replanner = zones, fleet, replanner
        self._return_routes, self._climbs = return_routes, climbs
        self._agent_status, self._incursions = agent_status, incursions
        self._remedy = "confirm a plan, or hold or return it" if needs_approval else "hold or return it"

    def use_map(self) -> None:
        """Plan on the map with the closed zones."""
        self._return_routes.grid = self._climbs.grid = self._zones.grid
        self._replanner.use_map(self._zones.grid)

    def carry_out(self, order: Order, replan: Callable[[Collection[int]], list[Effect]]) -> list[Effect]:
        """Close or open a zone, and plan again at once.

        Parameters
        ----------
        order : Order
            The order, with its zone.
        replan : callable
            Plans on the new map; vehicles given to it, whose routes lead through the zone, are urgent.
        """
        zone, ongoing = order.no_fly_zone, OrderInProgress(order)
        assert zone is not None
        refusal = self._zones.refusal(zone)
        if refusal:
            return [ongoing.answer(order.t_ns, "refused", refusal)]
        closed = self._zones.change(zone)
        self.use_map()
        verb = "closed" if zone.name in self._zones.areas else "opened"
        states = self._fleet.states()
        positions = {state.system_id: (state.east_m, state.north_m) for state in states}
        routes = self._replanner.routes
        without_return = self._return_routes.crossed(
            closed, {v: position for v, position in positions.items() if v not in routes}
        )
        affected = self._replanner.change_map(
            order.t_ns, self._zones.grid, closed, positions, f"no-fly zone {zone.name} {verb}", without_return
        )
        arrived = self._agent_status.arrived() & without_return
        effects = replan(affected)
        remaining = set(affected) - set(self._replanner.routes) | set(self._replanner.blocked)
        rerouted = set(affected) - remaining
        text = f"{zone.name} {verb}" + (f"; {named(rerouted)} led around it" if rerouted else "")
        remaining_states = [state for state in self._fleet.states() if state.system_id in remaining]
        entries = self._incursions.entries(remaining_states, self._zones.closed)
        alarms = {entry.vehicle: f"{entry.text}: {self._remedy}" for entry in entries}
        alarms |= dict.fromkeys(remaining - alarms.keys(), f"has no way around {zone.name}: {self._remedy}")
        alarms |= {
            state.system_id: f"flies home through {zone.name}: hold or return it"
            for state in states
            if state.armed and state.system_id in arrived
        }
        detail = "; ".join([text, *(f"{named([v])} {words}" for v, words in alarms.items())])
        effects.append(ongoing.answer(order.t_ns, "done", detail))
        return effects + [Notice(order.t_ns, "alarm", words, v) for v, words in alarms.items()]
