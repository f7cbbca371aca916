"""An operator's word, and what is said to an operator in return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs.model.basics import NS_PER_S
from gcs.model.plans import Route
from gcs.safe_text import printable

Action: TypeAlias = Literal[
    "hold", "resume", "return", "arm", "disarm", "plan", "confirm", "reject", "keep-out"
]


@dataclass(frozen=True, slots=True)
class NoFlyZone:
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
    keep_out: NoFlyZone | None = None
    origin: str = ""
    """Who gave it, in words."""

    def __post_init__(self) -> None:
        """Make what came from outside safe to show."""
        object.__setattr__(self, "origin", printable(self.origin))


@dataclass(frozen=True, slots=True)
class RouteFigures:
    """What an operator judges a proposed route by. It is planned from where the vehicle is now."""

    vehicle: int
    length_m: float
    """From where the vehicle is now."""
    shown_length_m: float
    """The same when the number of the plan was first shown."""
    arrival_s: float
    """Seconds of flight until it reaches the target, at its airspeed."""
    separation_m: float | None = None
    """Least distance to the other vehicles of its altitude layer as planned; None: it has none there."""
    clearance_m: float | None = None
    """Least distance to obstacles, at most the clearance asked for; None: none is asked for."""
    is_short: bool = False
    """True if the route ends before the target, because no clear one leads past it."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A plan that waits for an operator's word; without routes: nothing waits any more.

    It comes again whenever its routes are planned anew from where the vehicles are by then. Its number stands
    for its vehicles and their targets, and for routes about as long and as far apart as when it was new.
    """

    t_ns: int
    plan_id: int
    """Counts up: a newer proposal replaces the one before, and its id with it."""
    routes: tuple[Route, ...]
    """Those that are not flown until they are confirmed, ordered by vehicle."""
    reason: str
    shown_t_ns: int = 0
    """When its number was first shown."""
    figures: tuple[RouteFigures, ...] = ()
    """One for each of `routes`, in the same order; recordings of earlier versions have none."""

    @property
    def age_s(self) -> float:
        """How long its number has been shown."""
        return (self.t_ns - self.shown_t_ns) / NS_PER_S if self.shown_t_ns else 0.0


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
    proposal: Proposal | None = None
    """The plan that waits, for an order that asks for it."""

    def __post_init__(self) -> None:
        """Make what came from outside safe to show."""
        object.__setattr__(self, "order_id", printable(self.order_id))
        object.__setattr__(self, "detail", printable(self.detail))
