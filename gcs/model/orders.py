"""Operator commands, proposed plans and replies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs.model.basics import NS_PER_S, Label
from gcs.model.plans import Route
from gcs.model.vertical_limits import UNLIMITED, VerticalLimits
from gcs.safe_text import printable

Action: TypeAlias = Literal[
    "hold",
    "resume",
    "return",
    "arm",
    "disarm",
    "ready",
    "plan",
    "confirm",
    "reject",
    "no-fly-zone",
    "ignore",
    "attend",
    "priority",
    "pin",
    "unpin",
    "continue",
    "status",
]


@dataclass(frozen=True, slots=True)
class NoFlyZone:
    """A no-fly zone: a disc or a polygon in the mission's local frame.

    A zone replaces another one of its name. Without disc and polygon it opens the zone of its name.
    """

    name: str
    disc_m: tuple[float, float, float] | None = None
    """East, north, radius."""
    polygon_m: tuple[tuple[float, float], ...] = ()
    """East and north of at least three corners, in order."""
    limits: VerticalLimits = UNLIMITED


@dataclass(frozen=True, slots=True)
class Order:
    """Operator command; `OrderAnswer` with the same `order_id` replies to it."""

    t_ns: int
    order_id: str
    action: Action
    vehicles: tuple[int, ...] | None
    """Vehicles in order; None: all of the mission."""
    plan_id: int | None = None
    """Number of the proposal that is confirmed or rejected."""
    no_fly_zone: NoFlyZone | None = None
    origin: str = ""
    """Name of the sender, for operators."""
    target: Label | None = None
    """Target that is ignored, attended to, ranked, or to which vehicles are pinned."""
    priority: int | None = None
    """Priority of the target; a higher one is served first."""

    def __post_init__(self) -> None:
        """Make what came from outside safe to show."""
        object.__setattr__(self, "origin", printable(self.origin))


@dataclass(frozen=True, slots=True)
class RouteFigures:
    """Figures of a proposed route, flown from the current position of its vehicle."""

    vehicle: int
    length_m: float
    """Length of the route, with the climb of a vehicle on the ground."""
    shown_length_m: float
    """Length when the plan was first shown under its number."""
    arrival_s: float
    """Time to the target from now, or from the start of the take-off."""
    separation_m: float | None = None
    """Minimum planned distance to vehicles of its altitude layer; None: there are none."""
    clearance_m: float | None = None
    """Minimum distance to obstacles in the air, with the loiter circle, at most the required clearance;
    None: none is required.
    """
    is_short: bool = False
    """True if the route stops short of the target."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A plan that waits for approval; without routes: no plan waits.

    It is repeated when its routes are planned again from the current positions. Its number identifies the
    assignment and routes of about the same length and separation.
    """

    t_ns: int
    plan_id: int
    """Number of the plan; a higher one replaces this proposal."""
    routes: tuple[Route, ...]
    """Routes that wait for approval, ordered by vehicle."""
    reason: str
    shown_t_ns: int = 0
    """Time at which the number was first shown."""
    figures: tuple[RouteFigures, ...] = ()
    """Figures of `routes`, in the same order."""

    @property
    def age_s(self) -> float:
        """Time since the number was first shown."""
        return (self.t_ns - self.shown_t_ns) / NS_PER_S if self.shown_t_ns else 0.0


AnswerState: TypeAlias = Literal["accepted", "done", "refused", "failed"]


@dataclass(frozen=True, slots=True)
class OrderAnswer:
    """Reply to a command: first whether it is accepted, then the result for each vehicle."""

    t_ns: int
    order_id: str
    action: Action
    state: AnswerState
    """"accepted": in progress; "done": the vehicle confirms it; "refused": nothing was sent; "failed"."""
    detail: str
    vehicle: int | None = None
    """None: the reply is about the whole command."""
    waiting: tuple[int, ...] = ()
    """Vehicles whose result is outstanding."""
    proposal: Proposal | None = None
    """The plan that waits, for the command `plan`."""

    def __post_init__(self) -> None:
        """Make what came from outside safe to show."""
        object.__setattr__(self, "order_id", printable(self.order_id))
        object.__setattr__(self, "detail", printable(self.detail))
