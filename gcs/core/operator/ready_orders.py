"""Orders that vehicles on the ground are ready to fly again.

A vehicle that came down, or has landed, is not a resource: it may be a wreck, its battery may be empty. Only
a person who has seen it can say that it is ready.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gcs.core.flight.phases import FlightPhases
from gcs.core.operator.operator_state import OrderInProgress
from gcs.core.operator.order_refusals import not_in_mission
from gcs.core.state import Agent
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.model import Effect, Order, named


@dataclass(frozen=True, slots=True)
class ReadyOrders:
    """Carries out orders to take landed vehicles into service again."""

    agents: Mapping[int, Agent]
    fleet: Fleet
    flight_phases: FlightPhases

    def carry_out(self, order: Order) -> list[Effect]:
        """Carry out an order; return its answers, and the vehicles' new statuses."""
        everyone = order.vehicles is None
        vehicles = tuple(self.agents) if order.vehicles is None else order.vehicles
        effects: list[Effect] = []
        refusals = {vehicle: self._refusal(vehicle) for vehicle in vehicles}
        if everyone:  # of all vehicles, those that wait for it
            refusals = {v: refusal for v, refusal in refusals.items() if v in self.agents and self._waits(v)}
        ready = tuple(vehicle for vehicle, refusal in refusals.items() if not refusal)
        ongoing = OrderInProgress(order, ready)
        if not refusals:
            return [ongoing.answer(order.t_ns, "refused", "no vehicle has landed or is down")]
        for vehicle, refusal in refusals.items():
            if refusal:
                effects.append(ongoing.answer(order.t_ns, "refused", refusal, vehicle))
        if ready:
            effects.append(ongoing.answer(order.t_ns, "accepted", named(ready)))
        for vehicle in ready:
            effects += self.flight_phases.declare_ready(vehicle, order.t_ns)
            text = "is ready: it gets a mission with a take-off when it is needed, and flies once it is armed"
            effects.append(ongoing.answer(order.t_ns, "done", text, vehicle))
        return effects

    def _waits(self, vehicle: int) -> bool:
        return self.agents[vehicle].flight.phase.has_flown

    def _refusal(self, vehicle: int) -> str:
        """Return why a vehicle cannot be taken into service; empty if it can."""
        if vehicle not in self.agents:
            return not_in_mission(self.agents)
        state = self.fleet.state(vehicle)
        if not self._waits(vehicle):
            return "has neither landed nor come down: nothing was changed"
        if state is None or not is_on_ground(state, self.fleet.home(vehicle)):
            return "is not on the ground"
        if state.armed:
            return "is armed: disarm it first"
        return ""
