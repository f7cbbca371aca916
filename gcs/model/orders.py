"""An operator's word, and what is said to an operator in return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs.model.plans import Route

Action: TypeAlias = Literal["hold", "resume", "return", "arm", "disarm", "confirm", "reject", "keep-out"]


@dataclass(frozen=True, slots=True)
class KeepOut:
    """An area that routes stay out of: a disc or a polygon, in the mission's local frame.

    One of a name replaces the one before; with neither disc nor polygon the name's area is open again.
    """

    name: str
    disc_m: tuple[float, float, float] | None = None
    """East, north, radius."""
    polygon_m: tuple[tuple[float, float], ...] = ()
    """East and north of its corners, at least three, in order."""


@dataclass(frozen=True, slots=True)
class Order:
    """What an operator wants. It is answered by `OrderAnswer` with the same `order_id`."""

    t_ns: int
    order_id: str
    action: Action
    vehicles: tuple[int, ...] | None
    """System ids in order; None for all of the mission."""
    plan_id: int | None = None
    """Of the proposal that is confirmed or rejected."""
    keep_out: KeepOut | None = None
    origin: str = ""
    """Who gave it, in words."""


AnswerState: TypeAlias = Literal["accepted", "done", "refused", "failed"]


@dataclass(frozen=True, slots=True)
class OrderAnswer:
    """What became of an order: first whether it is taken, then how it went for each vehicle."""

    t_ns: int
    order_id: str
    action: Action
    state: AnswerState
    """"accepted": under way; "done": the vehicle itself shows it; "refused": nothing was done; "failed"."""
    detail: str
    vehicle: int | None = None
    """None: about the order as a whole."""
    waiting: tuple[int, ...] = ()
    """Vehicles whose answer is still to come; the order is over when nobody is left."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A plan that waits for an operator's word; without routes: nothing waits any more."""

    t_ns: int
    plan_id: int
    """Counts up: a newer proposal replaces the one before, and its id with it."""
    routes: tuple[Route, ...]
    """Those that are not flown until they are confirmed, ordered by vehicle."""
    reason: str
