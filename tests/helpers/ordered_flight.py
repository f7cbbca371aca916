"""Virtual flights under an operator's orders, or with a restart of the service."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from gcs.config import read_text
from gcs.config.key_overrides import override_keys
from gcs.mavlink.frames.codec import decode as decode_frames
from gcs.model import Effect, Event, Order, OrderAnswer, Send
from helpers.staging import S
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import Scenario, load, parse_scenario

SEED = 1


def order(at_s: float, action: Any, *vehicles: int, **fields: Any) -> Order:
    return Order(START_T_NS + round(at_s * S), f"{action}-{at_s}", action, tuple(vehicles) or None, **fields)


@dataclass
class Flight:
    """A virtual flight under orders, and everything that went in and came out."""

    run: VirtualRun
    events: list[Event]
    effects: list[tuple[int, Effect]]

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


def fly(
    orders: Sequence[Order], duration_s: float, *, loss: float = 0.0, scenario: str = "prescribed"
) -> Flight:
    events: list[Event] = []
    effects: list[tuple[int, Effect]] = []
    run = VirtualRun(
        load(scenario), SEED, events.append, lambda t, e: effects.append((t, e)), loss=loss, orders=orders
    )
    run.run(duration_s)
    return Flight(run, events, effects)


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
    events: list[Event] = []
    effects: list[tuple[int, Effect]] = []
    run = VirtualRun(
        scenario or load("prescribed"), SEED, events.append, lambda t, e: effects.append((t, e)),
        loss=loss, orders=orders,
    )  # fmt: skip
    run.run(at_s)
    snapshot = run.snapshot()
    meanwhile(run)
    run.restart(outage_s, snapshot)
    run.run(end_s)
    return Flight(run, events, effects)


def standing() -> Scenario:
    """Targets that stand still, and routes that are not bettered in flight."""
    text, source = read_text("deterministic")
    return parse_scenario(override_keys(text, ["planning.shape=pulled"], source), source)
