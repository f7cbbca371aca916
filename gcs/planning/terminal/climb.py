"""The climb after take-off: straight along the runway, until the take-off altitude is reached.

ArduPlane's NAV_TAKEOFF holds the heading of the runway up to its altitude, wherever its place is; PX4 flies
towards its place. Both turn to the first waypoint when they are that high, wherever that is. So a route from
the ground begins at the end of the climb, and the climb itself must be clear. How far it leads is known
roughly: `MARGIN` says how roughly, and wind carries the vehicle off besides.

Places in metres, headings clockwise from north.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight, to_cells
from gcs.planning.path.initial_turn import START_SHARE, start_is_safe, start_room
from gcs.planning.vehicle_model import Motion

MARGIN = 0.1
"""Share of the climb in the air by which its end may lie nearer or farther than expected."""
_FIRST_TURN_RADII = 2.0
"""A waypoint nearer than so many turn radii is part of the first turn."""
_BLOCKED = "an obstacle, a no-fly zone or the fence"
_HALVINGS = 12


@dataclass(frozen=True, slots=True)
class Climb:
    """A straight climb, or what is left of it."""

    start_m: Point
    """East and north of where the vehicle is."""
    heading_rad: float
    ground_run_m: float
    """Part of the length that is rolled on the ground."""
    length_m: float
    """Distance over ground to where the altitude is reached."""
    altitude_rel_m: float
    """Take-off altitude above home."""
    speed_m_s: float
    wind_m_s: float = 0.0
    """Greatest wind: it carries the vehicle off."""

    def at(self, along_m: float, aside_m: float = 0.0) -> Point:
        """Return the place so far along the climb, and so far to its right."""
        east, north = math.sin(self.heading_rad), math.cos(self.heading_rad)
        return (
            self.start_m[0] + along_m * east + aside_m * north,
            self.start_m[1] + along_m * north - aside_m * east,
        )

    @property
    def in_air_m(self) -> float:
        """Length of the part that is flown."""
        return max(self.length_m - self.ground_run_m, 0.0)

    @property
    def end_m(self) -> Point:
        """Where the altitude is reached, as far as is known."""
        return self.at(self.length_m)

    @property
    def latest_end_m(self) -> Point:
        """Farthest place along the runway where the altitude may be reached: where routes begin."""
        return self.at(self.length_m + MARGIN * self.in_air_m)

    @property
    def duration_s(self) -> float:
        """Time that the climb takes."""
        return self.length_m / self.speed_m_s

    @property
    def motion(self) -> Motion:
        """How the vehicle moves where routes begin."""
        return Motion(*self.latest_end_m, self.speed_m_s, self.heading_rad)

    def ends_m(self) -> tuple[Point, ...]:
        """Return the places where the altitude may be reached, the farthest first."""
        late_m, drift_m = MARGIN * self.in_air_m, self.wind_m_s / self.speed_m_s * self.in_air_m
        ends = [self.latest_end_m, self.end_m, self.at(self.length_m - min(late_m + drift_m, self.in_air_m))]
        if drift_m > 0.0:
            ends += [self.at(self.length_m, -drift_m), self.at(self.length_m, drift_m)]
        return tuple(ends)


def climb_problem(grid: Grid, climb: Climb, clearance_m: float) -> str:
    """Say where a climb comes too near to what is blocked, or leaves the map; empty when it is clear.

    The part in the air keeps the clearance. On the ground the vehicle keeps what it has where it stands.
    """
    room = start_room(grid.blocked, clearance_m / grid.spacing_m, *to_cells(grid, climb.start_m))
    lift_off_m = climb.at(min(climb.ground_run_m, climb.length_m))
    legs = [(climb.start_m, lift_off_m, float(room) * grid.spacing_m)]
    legs += [(lift_off_m, end, clearance_m) for end in climb.ends_m()]
    for start, end, least_m in legs:
        if not line_of_sight(grid, start, end, least_m):
            place = _last_clear(grid, start, end, least_m)
            return f"the climb comes within {least_m:.0f} m of {_BLOCKED}{_where(climb, place)}"
        if not grid.contains(end):
            return f"the climb leaves the map{_where(climb, end)}"
    return ""


def turn_problem(
    grid: Grid, climb: Climb, points_m: Sequence[Point], radius_m: float, clearance_m: float
) -> str:
    """Say where the turn from the end of a climb on to a route is not clear; empty when it is.

    It must be from each place where the climb may end, as wide as planned and half as wide, and keep the
    share of the clearance that is asked of every first turn (`gcs.planning.path.initial_turn`).

    Parameters
    ----------
    points_m : sequence of (float, float)
        Of the route, which begins at `Climb.latest_end_m`.
    radius_m : float
        Of the turns that the route was planned with.
    """
    least_m, far_m = START_SHARE * clearance_m, _FIRST_TURN_RADII * radius_m
    far = [k for k, point in enumerate(points_m) if math.dist(climb.end_m, point) > far_m]
    first = far[0] if far else len(points_m) - 1
    for start, end in pairwise((climb.latest_end_m, *points_m[: first + 1])):
        if not line_of_sight(grid, start, end, least_m):
            place = _last_clear(grid, start, end, least_m)
            return f"the first turn comes within {least_m:.0f} m of {_BLOCKED}{_where(climb, place)}"
    angle, radius = 0.5 * math.pi - climb.heading_rad, radius_m / grid.spacing_m
    reach = least_m / grid.spacing_m
    for end in climb.ends_m():
        # Flown past is a waypoint that the vehicle cannot turn to any more.
        ahead = [point for point in points_m[:first] if not _is_inside_turn(climb, end, point, radius_m)]
        to_cell = to_cells(grid, ahead[0] if ahead else points_m[first])
        if not start_is_safe(grid.blocked, reach, *to_cells(grid, end), angle, *to_cell, radius, -1):
            return f"the first turn may come within {least_m:.0f} m of {_BLOCKED}{_where(climb, end)}"
    return ""


def _is_inside_turn(climb: Climb, end: Point, point: Point, radius_m: float) -> bool:
    """Tell whether a place lies inside the turn that begins at the end of a climb, to its own side."""
    east_m, north_m = point[0] - end[0], point[1] - end[1]
    sin, cos = math.sin(climb.heading_rad), math.cos(climb.heading_rad)
    ahead_m, aside_m = east_m * sin + north_m * cos, abs(east_m * cos - north_m * sin)
    return math.hypot(ahead_m, aside_m - radius_m) < radius_m


def _last_clear(grid: Grid, start: Point, end: Point, least_m: float) -> Point:
    """Return the place on a leg up to which it is clear."""
    low, high, place = 0.0, 1.0, start
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        there = (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))
        if line_of_sight(grid, start, there, least_m):
            low, place = share, there
        else:
            high = share
    return place


def _where(climb: Climb, place: Point) -> str:
    far_m = math.dist(climb.start_m, place)
    return f", {far_m:.0f} m from where it stands, at ({place[0]:.0f}, {place[1]:.0f}) m"
