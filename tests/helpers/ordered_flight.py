"""Virtual flights under an operator's orders, or with a restart of the service."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from gcs.config import read_text
from gcs.config.key_overrides import override_keys
from gcs.mavlink.frames.codec import decode as decode_frames
from gcs.model import Effect, Event, Order, OrderAnswer, Send
from helpers.flight_copies import copy_of
from helpers.staging import S
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS, STEP_NS, VirtualRun
from sim_vehicles.world import scenario as scenarios
from sim_vehicles.world.scenario import Scenario, parse_scenario

SEED = 1
load = lru_cache(scenarios.load)
"""A shipped scenario: always the same object, whose flights are shared."""


def order(at_s: float, action: Any, *vehicles: int, **fields: Any) -> Order:
    return Order(START_T_NS + round(at_s * S), f"{action}-{at_s}", action, tuple(vehicles) or None, **fields)


@dataclass
class Flight:
    """A virtual flight under orders, and everything that went in and came out."""

    run: VirtualRun
    events: list[Event] = field(default_factory=list)
    effects: list[tuple[int, Effect]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.run.on_event = self.events.append
        self.run.on_effect = lambda t_ns, effect: self.effects.append((t_ns, effect))

    def copy(self) -> Flight:
        return Flight(copy_of(self.run), self.events.copy(), self.effects.copy())

    def all(self, kind: type) -> list[Any]:
        return [effect for _, effect in self.effects if isinstance(effect, kind)]

    def answers(self, order_id: str) -> list[tuple[str, int | None]]:
        return [(a.state, a.vehicle) for a in self.all(OrderAnswer) if a.order_id == order_id]

    def messages_to(self, vehicle: int, from_s: float, to_s: float) -> list[Any]:
        """Messages to a vehicle within a time."""
        found = []
        for t_ns, effect in self.effects:
            if isinstance(effect, Send) and from_s <= (t_ns - START_T_NS) / S < to_s:
                found += [
                    m for m in decode_frames(effect.data)[0] if getattr(m, "target_system", 0) == vehicle
                ]
        return found

    def mode(self, vehicle: int) -> Mode:
        return self.run.vehicles[f"vehicle:{vehicle}"].autopilot.mode


_FLOWN: dict[tuple[int, float], dict[float, Flight]] = {}
"""Flights without orders by scenario and loss, at the times at which tests began."""


def flown(scenario: Scenario, until_s: float, *, loss: float = 0.0) -> Flight:
    """Return a flight without orders at a time. What another test has flown is not flown again."""
    start = {0.0: Flight(VirtualRun(scenario, SEED, loss=loss))}
    kept = _FLOWN.setdefault((id(scenario), loss), start)
    if until_s not in kept:
        kept[until_s] = kept[max(at_s for at_s in kept if at_s < until_s)].copy()
        kept[until_s].run.run(until_s)
    return kept[until_s].copy()


def ordered(scenario: Scenario, orders: Sequence[Order], until_s: float, *, loss: float = 0.0) -> Flight:
    """Return a flight with orders at a time."""
    before_s = [(one.t_ns - STEP_NS - START_T_NS) / S for one in orders]
    flight = flown(scenario, min([*before_s, until_s]), loss=loss)
    for one in orders:
        flight.run.order(one)
    flight.run.run(until_s)
    return flight


def fly(
    orders: Sequence[Order], duration_s: float, *, loss: float = 0.0, scenario: str = "prescribed"
) -> Flight:
    return ordered(load(scenario), orders, duration_s, loss=loss)


def flight_with_a_restart(
    at_s: float,
    outage_s: float,
    end_s: float,
    *,
    scenario: Scenario | None = None,
    orders: tuple[Order, ...] = (),
    loss: float = 0.0,
    meanwhile: Callable[[VirtualRun], None] = lambda run: None,
) -> Flight:
    flight = ordered(scenario or load("prescribed"), orders, at_s, loss=loss)
    snapshot = flight.run.snapshot()
    meanwhile(flight.run)
    flight.run.restart(outage_s, snapshot)
    flight.run.run(end_s)
    return flight


@lru_cache
def standing() -> Scenario:
    """Targets that stand still, and routes that are not bettered in flight."""
    text, source = read_text("deterministic")
    return parse_scenario(override_keys(text, ["planning.shape=pulled"], source), source)
