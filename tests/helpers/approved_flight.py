"""Virtual flights whose plans an operator confirms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec

from gcs.mavlink.frames.codec import decode as decode_frames
from gcs.model import Effect, Event, Order, Proposal, Send
from helpers.staging import S
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import Scenario, load

SEED = 1


def scenario(retask: str = "confirm", name: str = "prescribed") -> Scenario:
    loaded = load(name)
    planning = msgspec.structs.replace(loaded.config.planning, retask=retask, when="period", aim="position")
    return replace(loaded, config=msgspec.structs.replace(loaded.config, planning=planning))


class Flight:
    """A flight with an operator: called with each effect, he may answer with an order."""

    def __init__(self, operator: Callable[[int, Effect], Order | None], retask: str = "confirm") -> None:
        self.events: list[Event] = []
        self.effects: list[tuple[int, Effect]] = []
        self._operator = operator
        self.run = VirtualRun(scenario(retask), SEED, self.events.append, self._effect)

    def _effect(self, t_ns: int, effect: Effect) -> None:
        self.effects.append((t_ns, effect))
        order = self._operator(t_ns, effect)
        if order is not None:
            self.run.order(order)

    def fly(self, duration_s: float) -> Flight:
        self.run.run(duration_s)
        return self

    def all(self, kind: type) -> list[Any]:
        return [effect for _, effect in self.effects if isinstance(effect, kind)]

    def counted(self) -> list[tuple[int, int]]:
        """(time, vehicle) of every upload that was begun or repeated."""
        found = []
        for t_ns, effect in self.effects:
            if isinstance(effect, Send):
                messages = decode_frames(effect.data)[0]
                found += [(t_ns, m.target_system) for m in messages if m.get_type() == "MISSION_COUNT"]
        return found


def word(t_ns: int, action: Any, plan_id: int, *vehicles: int) -> Order:
    name = f"{action}-{plan_id}-{t_ns}-{vehicles}"
    return Order(t_ns, name, action, tuple(vehicles) or None, plan_id)


def after(delay_s: float, action: str = "confirm") -> Callable[[int, Effect], Order | None]:
    """An operator who gives every plan the same word, once, after a while."""

    def operator(t_ns: int, effect: Effect) -> Order | None:
        if isinstance(effect, Proposal) and effect.routes and effect.t_ns == effect.shown_t_ns:
            return word(t_ns + round(delay_s * S), action, effect.plan_id)
        return None

    return operator


def silent(_t_ns: int, _effect: Effect) -> None:
    return None
