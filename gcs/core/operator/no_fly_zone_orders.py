"""Orders that close or open a no-fly zone."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Final

from gcs.core.airspace.incursion_warning import IncursionWarnings
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.airspace.obstacle_map import ObstacleMap, closed_area
from gcs.core.operator.arrived_agents import leave_zones
from gcs.core.operator.operator_state import OrderInProgress
from gcs.core.replanning.replanner import Replanner
from gcs.core.replanning.return_routes import ReturnRoutes
from gcs.core.replanning.stacked_missions import StackedMissions
from gcs.core.state import State, with_status
from gcs.core.tasking.mission_builder import returns_by_mission
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import Effect, NoFlyZone, Notice, NoticeCode, Order, Parameter, limits_text, named
from gcs.planning.map.limited_area import LimitedArea

_MAX_ZONES: Final = 100


@dataclass(frozen=True, slots=True)
class NoFlyZoneOrders:
    """Carries out orders that close or open a no-fly zone."""

    zones: NoFlyZones
    state: State
    fleet: Fleet
    replanner: Replanner
    return_routes: ReturnRoutes
    incursions: IncursionWarnings
    stacked_missions: StackedMissions
    needs_approval: bool

    def carry_out(self, order: Order, replan: Callable[[Collection[int]], list[Effect]]) -> list[Effect]:
        """Close or open a zone, and plan again at once.

        Parameters
        ----------
        order : Order
            The order, with its zone.
        replan : callable
            Plans on the new map; vehicles given to it, whose routes lead through the zone, are urgent.
        """
        zone = order.no_fly_zone
        ongoing = OrderInProgress(order)
        agents = self.state.agents
        assert zone is not None
        refusal = self._refusal(zone)
        if refusal:
            return [ongoing.answer(order.t_ns, "refused", refusal)]
        closed = self.zones.change(zone)
        verb = "closed" if zone.name in self.zones.closed else "opened"
        limits = limits_text(zone.limits)
        verb += f" ({limits})" if limits else ""
        states = self.fleet.states()
        had_ended = self.state.has_ended
        left = leave_zones(self.state, closed, states, order.t_ns)
        heard = {state.system_id: state for state in states}
        returning = {v: (s.east_m, s.north_m) for v, s in heard.items() if agents[v].routes.flown is None}
        without_return = self.return_routes.crossed(closed, returning)
        affected = self.replanner.change_map(
            order.t_ns, closed, heard, f"no-fly zone {zone.name} {verb}", without_return
        )
        arrived = without_return.intersection(with_status(agents, "arrived"))
        effects = [*left, *replan(affected)]
        stacked = self.stacked_missions.avoid(closed, heard, order.t_ns)
        led_around = {vehicle for vehicle, sent in stacked.items() if sent}
        effects += [effect for sent in stacked.values() for effect in sent]
        routes = {vehicle: agent.routes for vehicle, agent in agents.items()}
        remaining = {v for v in affected if routes[v].flown is None}
        remaining |= {v for v, route in routes.items() if route.is_blocked}
        remaining |= stacked.keys() - led_around
        rerouted = (set(affected) - remaining) | led_around
        done = "planned again" if closed.zone is None else "led around it"
        text = f"{zone.name} {verb}" + (f"; {named(rerouted)} {done}" if rerouted else "")
        text += "; the mission continues" if had_ended and not self.state.has_ended else ""
        remaining_states = [state for state in self.fleet.states() if state.system_id in remaining]
        entries = self.incursions.entries(remaining_states, self.zones.closed)
        t_ns = order.t_ns
        alarms = {entry.vehicle: entry.notice(t_ns, self._remedy(entry.vehicle)) for entry in entries}
        for vehicle in sorted(remaining - alarms.keys()) if closed.zone is not None else ():
            about: dict[str, Parameter] = {"zone": zone.name, "remedy": self._remedy(vehicle)}
            alarms[vehicle] = Notice(t_ns, NoticeCode.ZONE_UNAVOIDABLE, vehicle, about)
        for state in states:
            vehicle = state.system_id
            if state.armed and vehicle in arrived:
                alarms[vehicle] = Notice(t_ns, NoticeCode.ZONE_ON_RETURN, vehicle, {"zone": zone.name})
        detail = "; ".join([text, *(f"{named([v])} {alarm.text}" for v, alarm in alarms.items())])
        effects.append(ongoing.answer(t_ns, "done", detail))
        return [*effects, *alarms.values()]

    def _remedy(self, vehicle: int) -> str:
        """Return what helps a vehicle that has no way round a zone: not to return, if it returns already."""
        if returns_by_mission(self.state.agents[vehicle]):
            return "open the zone, or hold it"
        return "confirm a plan, or hold or return it" if self.needs_approval else "hold or return it"

    def _refusal(self, zone: NoFlyZone) -> str:
        """Return why a zone cannot be closed or opened; empty if it can."""
        closed = self.zones.closed
        if zone.disc_m is None and not zone.polygon_m:
            if zone.name in closed:
                return ""
            return f"no no-fly zone is called {zone.name}; there are: {', '.join(closed) or 'none'}"
        if zone.name not in closed and len(closed) >= _MAX_ZONES:
            return f"there are {_MAX_ZONES} no-fly zones already; open some first"
        area = closed_area(self.zones.grid, zone)
        if not len(area.cells):
            return "it lies outside the map"
        return _height_problem(area, self.zones.obstacles)


def _height_problem(area: LimitedArea, obstacles: ObstacleMap) -> str:
    """Return why an area keeps nothing clear: it ends below the ground; empty if it does not."""
    ceiling_m = area.limits.ceiling_m
    if ceiling_m is None:
        return ""
    places_m = area.centres_m(obstacles.full)
    ground_m = obstacles.ground_msl_m(places_m)
    if (obstacles.zero_msl_m(area.limits.reference, places_m) + ceiling_m > ground_m).any():
        return ""
    return (
        f"it ends below the ground, which is at {ground_m.min():.0f} m MSL there: it is closed "
        f"{limits_text(area.limits)}; check the reference of its heights"
    )
