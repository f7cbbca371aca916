"""Result of a plan: its routes, what is left out, and which of the new routes are flown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gcs.model import FloatArray, Label, Route
from gcs.planning.layer_assignment import Conflict, PlannedFlight
from gcs.planning.plan_notes import PlanNote


@dataclass(frozen=True, slots=True)
class PlanResult:
    """Routes of a plan, and what is left out.

    Attributes
    ----------
    routes : tuple of Route
        Ordered by vehicle. A route ends at the exact target position, unless that is over an obstacle, or
        outside the map. No waypoint lies outside the map.
    unassigned_vehicles, unassigned_targets : tuple
        In order; all that have no route.
    notes : tuple of PlanNote
        For the operator.
    grid_lengths_m : mapping of int to float
        Length of each vehicle's grid path, before shaping.
    stops_short : frozenset of int
        Vehicles whose routes end before the target, because no clear path passes it.
    endless : frozenset of int
        Vehicles that fly to their targets now, and get no route there: no loiter circle at its end is clear.
    settled : frozenset of int
        Vehicles that keep the routes they have to their targets: none were shaped.
    captured : mapping of int to Route
        Shorter routes without an explicit first turn: the simulated vehicle captures them clear of obstacles.
    paths_m : mapping of int to ndarray, shape (k, 2)
        East and north of each new route, from the position of its vehicle; of `plan_mission` only.
    conflicts : tuple of Conflict
        Vehicles that come near each other because no layer is left; of `plan_mission` only.
    """

    routes: tuple[Route, ...]
    unassigned_vehicles: tuple[int, ...]
    unassigned_targets: tuple[Label, ...]
    notes: tuple[PlanNote, ...]
    grid_lengths_m: Mapping[int, float] = field(default_factory=dict)
    stops_short: frozenset[int] = frozenset()
    captured: Mapping[int, Route] = field(default_factory=dict)
    endless: frozenset[int] = frozenset()
    settled: frozenset[int] = frozenset()
    paths_m: Mapping[int, FloatArray] = field(default_factory=dict)
    conflicts: tuple[Conflict, ...] = ()

    @property
    def total_length_m(self) -> float:
        """Total length of all routes."""
        return math.fsum(route.length_m for route in self.routes)


@dataclass(frozen=True, slots=True)
class Choice:
    """New routes of a plan, and those that are kept.

    Attributes
    ----------
    new, kept : sequence of Route
    flights : sequence of PlannedFlight
        Those on kept routes, and of vehicles without a route; new routes keep clear of them.
    """

    new: Sequence[Route]
    kept: Sequence[Route] = ()
    flights: Sequence[PlannedFlight] = ()


def choose_new(result: PlanResult) -> Choice:
    """Choose all new routes, without an explicit first turn where the vehicle needs none."""
    return Choice([result.captured.get(route.vehicle, route) for route in result.routes])
