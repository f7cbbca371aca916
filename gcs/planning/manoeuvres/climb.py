"""Climb after take-off along the runway: its length, its first turn, the obstacles and ground below.

ArduPlane's NAV_TAKEOFF holds the runway heading up to its altitude, wherever its waypoint is. PX4 flies
towards its waypoint. Both turn to the first waypoint at that altitude. So a route begins at the end of the
climb, and the climb itself must be clear. The length of the climb is uncertain by
`_CLIMB_LENGTH_UNCERTAINTY`, and wind adds drift.

Positions in metres, headings clockwise from north.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from gcs.model import Parameter
from gcs.planning.forward_simulation import Motion
from gcs.planning.manoeuvres.takeoff_obstruction import Obstruction, ObstructionCode
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight, path_clearance, to_cells
from gcs.planning.path.initial_turn import START_CLEARANCE_SHARE, is_turn_safe, start_clearance
from gcs.planning.terrain.ground import needed_low_agl_m
from gcs.terrain.elevation_grid import Elevation

_CLIMB_LENGTH_UNCERTAINTY = 0.1
"""Relative uncertainty of the length of the airborne climb."""
_FIRST_TURN_RADII = 2.0
"""A waypoint within this many turn radii is part of the first turn."""
_HALVINGS = 12
_GROUND_SAMPLES = 100


@dataclass(frozen=True, slots=True)
class Climb:
    """Straight climb, or the rest of one."""

    start_m: Point
    """East and north of the vehicle."""
    heading_rad: float
    ground_run_m: float
    """Length of the ground roll."""
    length_m: float
    """Distance over ground to the take-off altitude."""
    altitude_rel_m: float
    """Take-off altitude above home."""
    speed_m_s: float
    wind_m_s: float = 0.0
    """Greatest wind speed."""

    def at(self, along_m: float, aside_m: float = 0.0) -> Point:
        """Return the position at a distance along the climb and to its right."""
        east = math.sin(self.heading_rad)
        north = math.cos(self.heading_rad)
        return (
            self.start_m[0] + along_m * east + aside_m * north,
            self.start_m[1] + along_m * north - aside_m * east,
        )

    @property
    def in_air_m(self) -> float:
        """Length of the airborne part."""
        return max(self.length_m - self.ground_run_m, 0.0)

    @property
    def end_m(self) -> Point:
        """Expected position at the take-off altitude."""
        return self.at(self.length_m)

    @property
    def latest_length_m(self) -> float:
        """Greatest distance over ground to the take-off altitude."""
        return self.length_m + _CLIMB_LENGTH_UNCERTAINTY * self.in_air_m

    @property
    def latest_end_m(self) -> Point:
        """Farthest position along the runway where the altitude is reached. Routes begin here."""
        return self.at(self.latest_length_m)

    @property
    def roll_s(self) -> float:
        """Time that the ground roll takes longer than at the vehicle's speed: it accelerates evenly."""
        return self.ground_run_m / self.speed_m_s

    @property
    def duration_s(self) -> float:
        """Time from the start to where routes begin."""
        return self.latest_length_m / self.speed_m_s + self.roll_s

    @property
    def motion(self) -> Motion:
        """Motion of the vehicle where routes begin."""
        return Motion(*self.latest_end_m, self.speed_m_s, self.heading_rad)

    def possible_ends_m(self) -> tuple[Point, ...]:
        """Return the positions where the altitude may be reached, the farthest first."""
        late_m = _CLIMB_LENGTH_UNCERTAINTY * self.in_air_m
        drift_m = self.wind_m_s / self.speed_m_s * self.in_air_m
        ends = [self.latest_end_m, self.end_m, self.at(self.length_m - min(late_m + drift_m, self.in_air_m))]
        if drift_m > 0.0:
            ends += [self.at(self.length_m, -drift_m), self.at(self.length_m, drift_m)]
        return tuple(ends)


def climb_obstruction(grid: Grid, climb: Climb, clearance_m: float) -> Obstruction | None:
    """Return where a climb comes too near to an obstacle or leaves the map; None if it is clear.

    The airborne part keeps the clearance. On the ground the vehicle keeps the clearance of its position.
    """
    margin = start_clearance(grid.blocked, clearance_m / grid.spacing_m, *to_cells(grid, climb.start_m))
    lift_off_m = climb.at(min(climb.ground_run_m, climb.length_m))
    legs = [(climb.start_m, lift_off_m, float(margin) * grid.spacing_m)]
    legs += [(lift_off_m, end, clearance_m) for end in climb.possible_ends_m()]
    for start, end, min_clearance_m in legs:
        if not line_of_sight(grid, start, end, min_clearance_m):
            place = _last_clear(grid, start, end, min_clearance_m)
            return _obstruction(ObstructionCode.CLIMB_BLOCKED, climb, place, min_clearance_m)
        if not grid.contains(end):
            return _obstruction(ObstructionCode.OUTSIDE_MAP, climb, end, min_clearance_m)
    return None


def ground_obstruction(climb: Climb, elevation: Elevation, least_agl_m: float) -> Obstruction | None:
    """Return where a climb comes too near to the ground; None if it does not.

    The airborne part keeps half of its height above the place where it begins, or the least height above
    ground if that is less, also when it is drifted by the wind.
    """
    run_m = min(climb.ground_run_m, climb.latest_length_m)
    lift_off_m = climb.at(run_m)
    lift_off_msl_m = elevation.height_msl_m(*lift_off_m)
    end_msl_m = elevation.height_msl_m(*climb.start_m) + climb.altitude_rel_m
    share = np.linspace(0.0, 1.0, _GROUND_SAMPLES)
    height_m = share * (end_msl_m - lift_off_msl_m)
    for end_m in climb.possible_ends_m():
        places_m = np.array(lift_off_m) + share[:, None] * np.subtract(end_m, lift_off_m)
        agl_m = lift_off_msl_m + height_m - elevation.heights_at(places_m)
        near = np.flatnonzero(agl_m < needed_low_agl_m(height_m, least_agl_m))
        if len(near):
            first = int(near[0])
            east_m, north_m = places_m[first].tolist()
            parameters: dict[str, Parameter] = {
                "agl_m": float(agl_m[first]),
                "distance_m": math.dist(climb.start_m, (east_m, north_m)),
                "east_m": east_m,
                "north_m": north_m,
            }
            return Obstruction(ObstructionCode.NEAR_GROUND, parameters)
    return None


def turn_obstruction(
    grid: Grid, climb: Climb, points_m: Sequence[Point], radius_m: float, clearance_m: float
) -> Obstruction | None:
    """Return where the turn from a climb on to a route is not clear; None if it is clear.

    The turn must be clear from each possible end of the climb, with the planned radius and with half of it.
    It keeps the clearance share of every initial turn (`gcs.planning.path.initial_turn`). Obstacles beyond it
    are those of the leg to the first waypoint after it: from them that share of the leg's own clearance is
    kept, as in planning.

    Parameters
    ----------
    points_m : sequence of (float, float)
        Waypoints of the route, which begins at `Climb.latest_end_m`.
    radius_m : float
        Planned turn radius.
    """
    min_clearance_m = START_CLEARANCE_SHARE * clearance_m
    far_m = _FIRST_TURN_RADII * radius_m
    far = [k for k, point in enumerate(points_m) if math.dist(climb.end_m, point) > far_m]
    first = far[0] if far else len(points_m) - 1
    ends = climb.possible_ends_m()
    path = (climb.latest_end_m, *points_m[: first + 1])
    near = _obstacles_near(grid, ends, far_m + min_clearance_m)
    for start, end in pairwise(path):
        if not line_of_sight(near, start, end, min_clearance_m):
            place = _last_clear(near, start, end, min_clearance_m)
            return _obstruction(ObstructionCode.TURN_BLOCKED, climb, place, min_clearance_m)
    angle = 0.5 * math.pi - climb.heading_rad
    radius = radius_m / grid.spacing_m
    leg_m = START_CLEARANCE_SHARE * _clearance_m(grid, path, clearance_m)
    for end, (around, min_m) in product(ends, ((near, min_clearance_m), (grid, leg_m))):
        # A waypoint inside the turn is passed without being reached.
        ahead = [point for point in points_m[:first] if not _is_inside_turn(climb, end, point, radius_m)]
        to_cell = to_cells(grid, ahead[0] if ahead else points_m[first])
        clearance = min_m / grid.spacing_m
        if not is_turn_safe(around.blocked, clearance, *to_cells(grid, end), angle, *to_cell, radius, -1):
            return _obstruction(ObstructionCode.TURN_MAY_BE_BLOCKED, climb, end, min_m)
    return None


def _obstacles_near(grid: Grid, places_m: Sequence[Point], max_m: float) -> Grid:
    """Return the map without the obstacles that are farther from all of these places."""
    rows, cols = grid.shape
    is_near = np.zeros(grid.shape, np.bool_)
    for place in places_m:
        col, row = to_cells(grid, place)
        north = abs(np.arange(rows) - row) - 0.5
        east = abs(np.arange(cols) - col) - 0.5
        is_near |= np.hypot(np.maximum(north[:, None], 0.0), np.maximum(east, 0.0)) < max_m / grid.spacing_m
    return replace(grid, blocked=grid.blocked & is_near)


def _clearance_m(grid: Grid, path: Sequence[Point], max_m: float) -> float:
    """Return the distance of a path from the nearest obstacle, at most `max_m`."""
    frame = np.array([*grid.origin_m, grid.spacing_m])
    most = max_m / grid.spacing_m
    return grid.spacing_m * float(path_clearance(grid.blocked, frame, np.array(path), most))


def _is_inside_turn(climb: Climb, end: Point, point: Point, radius_m: float) -> bool:
    """Return True if a place lies inside the turn from the end of a climb, on its side."""
    east_m = point[0] - end[0]
    north_m = point[1] - end[1]
    sin = math.sin(climb.heading_rad)
    cos = math.cos(climb.heading_rad)
    ahead_m = east_m * sin + north_m * cos
    aside_m = abs(east_m * cos - north_m * sin)
    return math.hypot(ahead_m, aside_m - radius_m) < radius_m


def _last_clear(grid: Grid, start: Point, end: Point, min_clearance_m: float) -> Point:
    """Return the position on a leg up to which it is clear."""
    low = 0.0
    high = 1.0
    place = start
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        there = (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))
        if line_of_sight(grid, start, there, min_clearance_m):
            low = share
            place = there
        else:
            high = share
    return place


def _obstruction(code: ObstructionCode, climb: Climb, place: Point, min_clearance_m: float) -> Obstruction:
    return Obstruction(
        code,
        {
            "min_clearance_m": min_clearance_m,
            "distance_m": math.dist(climb.start_m, place),
            "east_m": place[0],
            "north_m": place[1],
        },
    )
