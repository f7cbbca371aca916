"""State of replanning: routes and triggers."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.core.replanning.reasons import Reason
from gcs.model import FloatArray, Label, Route
from gcs.planning.map.grid import Point
from gcs.planning.plan_notes import PlanNote


@dataclass(frozen=True, slots=True)
class OtherVehicle:
    """A vehicle in the air that is suspended or overridden."""

    vehicle: int
    position_m: Point
    to_m: Point
    """Destination: home if it returns, else its position."""
    height_m: float
    """Above home."""
    radius_m: float = 0.0
    """Radius of the circle that it flies at its destination."""


@dataclass(slots=True)
class AgentRoutes:
    """Routes of one vehicle."""

    flown: Route | None = None
    """Route that the vehicle flies, or whose mission is on its way to it."""
    proposed: Route | None = None
    """Route that was proposed to an operator, with `planning.retask = "confirm"`."""
    declined: Route | None = None
    """Proposed route that the operator rejected."""
    suspended: Route | None = None
    """Route of a suspended vehicle whose upload was complete."""
    stacked: Route | None = None
    """Route of a vehicle that returns, or holds, by a mission in an altitude layer of its own."""
    latest: Route | None = None
    """Last route that got an altitude layer; it stays when the route is dropped."""
    made_t_ns: int = 0
    """Time at which the newest route was planned."""
    layer_t_ns: int = 0
    """Time of the last search for another altitude layer."""
    is_planned: bool = False
    """True if the last plan was made for the vehicle."""
    is_short: bool = False
    """True if the newest route ends before its target."""
    is_blocked: bool = False
    """True if the flown, the return or the stacked route leads through an area that was closed since."""
    return_m: FloatArray | None = None
    """Newest return route, from the end of the route, (k, 2)."""
    return_problem: str = ""
    """Problem of the newest return route, in words."""

    @property
    def newest(self) -> Route | None:
        """Proposed route, else the flown one."""
        return self.flown if self.proposed is None else self.proposed

    def drop(self) -> None:
        """Drop the routes of a vehicle that arrived, is lost, or is not tasked."""
        self.drop_flown()
        self.proposed = None
        self.stacked = None

    def drop_flown(self) -> None:
        """Drop the route of a vehicle whose mission could not be uploaded."""
        self.flown = None
        self.is_blocked = False

    def adopt(self, route: Route) -> None:
        """Make a proposed or suspended route the one that is flown."""
        self.drop()
        self.flown = route

    def resume_latest(self) -> None:
        """Make the last route the flown one again, as one that leads through a closed area."""
        self.flown = self.latest
        self.is_blocked = True

    def suspend(self, *, is_uploaded: bool) -> None:
        """Drop the routes; keep one that the vehicle has on board for `pop_suspended`."""
        if self.flown is not None and is_uploaded:
            self.suspended = self.flown
        self.drop()

    def stack(self, route: Route) -> None:
        """Return or hold by a mission, instead of RTL or LOITER."""
        self.stacked = route
        self.latest = route
        self.is_blocked = False

    def unstack(self) -> None:
        """Give a mission in a layer up."""
        self.stacked = None

    def decline(self) -> None:
        """Note that an operator rejected the proposed route."""
        self.declined = self.proposed

    def pop_suspended(self) -> Route | None:
        """Return, once, the route of a suspended vehicle."""
        route = self.suspended
        self.suspended = None
        self.stacked = None
        return route


@dataclass(slots=True)
class ReplanningState:
    """What belongs to no single vehicle."""

    started_t_ns: int | None = None
    """Time of the first check."""
    next_check_t_ns: int | None = None
    """Time of the next regular check; None before the first plan."""
    news: list[Reason] = field(default_factory=list)
    """Triggers for the next check."""
    planned_targets: tuple[Label, ...] = ()
    """Targets of the last plan."""
    tried: tuple[Label, ...] = ()
    """Targets that moved, for which a plan was made since the last regular check."""
    noted: tuple[PlanNote, ...] = ()
    """Notes of the last plan."""
    new_notes: tuple[PlanNote, ...] = ()
    """Notes that began or ended, and that the operator was not told yet."""
    other_vehicles: tuple[OtherVehicle, ...] = ()
    """Vehicles in the air that the last check had no routes for; they stay in their layers."""
