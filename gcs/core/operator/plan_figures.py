"""Figures of proposed routes, and the changes that make a plan a different one.

A number identifies an assignment, with routes of about the length and separation first shown. Routes are
planned again while vehicles fly on. A larger change makes it another plan, with another number.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from itertools import pairwise

import numpy as np

from gcs.config import Config
from gcs.model import Route, RouteFigures, target_name, vehicle_name
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight

LONGER_FRACTION = 0.25
"""Maximum increase of a route's length, as a fraction; a full turn is allowed, too."""
NEARER_M = 5.0
"""Maximum decrease of a distance."""
_HALVINGS = 6


class PlanFigures:
    """Lengths, times, separations and clearances of proposed routes."""

    def __init__(self, config: Config) -> None:
        self._speeds_m_s = config.speeds_m_s
        self._clearance_m = config.planning.clearance_m
        self._separation_m = config.planning.separation_m
        self._radii_m = {v: one.planned_radius_m for v, one in config.airframes_of_agents.items()}

    def of(
        self,
        routes: Sequence[Route],
        shown: Mapping[int, RouteFigures],
        grid: Grid,
        positions: Mapping[int, Point],
        separation_m: Mapping[int, float],
        short: Container[int],
    ) -> tuple[RouteFigures, ...]:
        """Return the figures of routes.

        Parameters
        ----------
        shown
            Figures of each vehicle when the number was first shown; none for a new number.
        positions
            Positions of vehicles, east and north in metres.
        separation_m
            Minimum distance of each vehicle to another of its altitude layer.
        short
            Vehicles whose routes end before their targets.
        """
        found = []
        for route in routes:
            vehicle, apart_m = route.vehicle, separation_m.get(route.vehicle, math.inf)
            before = shown.get(vehicle)
            found.append(
                RouteFigures(
                    vehicle,
                    route.length_m,
                    before.shown_length_m if before is not None else route.length_m,
                    route.length_m / self._speeds_m_s[vehicle],
                    apart_m if math.isfinite(apart_m) else None,
                    self._clear_m(grid, route, positions.get(vehicle)),
                    vehicle in short,
                )
            )
        return tuple(found)

    def _clear_m(self, grid: Grid, route: Route, position: Point | None) -> float | None:
        """Return the clearance of a route from obstacles, at most the required one."""
        if self._clearance_m <= 0.0:
            return None
        points = [(float(east_m), float(north_m)) for east_m, north_m in route.flown_m]
        points = [position or points[0], *points]

        def is_clear(metres: float) -> bool:
            return all(line_of_sight(grid, a, b, metres) for a, b in pairwise(points))

        low_m, high_m = 0.0, self._clearance_m
        if is_clear(high_m):
            return high_m
        for _ in range(_HALVINGS):
            middle_m = 0.5 * (low_m + high_m)
            low_m, high_m = (middle_m, high_m) if is_clear(middle_m) else (low_m, middle_m)
        return float(np.round(low_m))

    def change(self, route: Route, now: RouteFigures, shown: RouteFigures) -> str:
        """Return how a route differs from the one shown; empty if it is about the same."""
        agent = f"agent {vehicle_name(now.vehicle)}"
        if now.is_short and not shown.is_short:
            return f"no clear path leads {agent} past target {target_name(route.target)} any more"
        longer_m = now.length_m - shown.length_m
        if longer_m > max(LONGER_FRACTION * shown.length_m, 2.0 * math.pi * self._radii_m[now.vehicle]):
            return f"the route of {agent} is {longer_m:.0f} m longer than shown ({shown.length_m:.0f} m)"
        if _is_nearer(now.separation_m, shown.separation_m, self._separation_m):
            return f"{agent} would come within {now.separation_m:.0f} m of another at its altitude"
        if _is_nearer(now.clearance_m, shown.clearance_m, self._clearance_m):
            return f"{agent} would come within {now.clearance_m:.0f} m of an obstacle"
        return ""


def _is_nearer(now_m: float | None, shown_m: float | None, required_m: float) -> bool:
    if now_m is None or now_m >= required_m:
        return False
    return shown_m is None or now_m < shown_m - NEARER_M
