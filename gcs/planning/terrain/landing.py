"""Return routes over terrain: inside the flight band to the begin of a descent, then to the landing.

A landing has two legs of one course: from a gate in the band down to the begin of the approach, and along
the approach to home. Autopilots fly both as straight lines in height, PX4 with the height of a waypoint
`EARLY_M` before it. On them a vehicle is below the band, as after a take-off: it keeps half of its height
above the landing point, or the least height above ground if that is less. Gates on all sides of home are
candidates.

The path leads from the loiter circle at the target to a gate and its course. It is searched backwards, from
the gate to the circle, with climb and descent changed over: searches begin at poses and end on circles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gcs.geo import bearing_rad
from gcs.model import APPROACH_M, FloatArray, IntArray, Route, read_only
from gcs.planning.flown_heights import EARLY_M, lowest_heights_m
from gcs.planning.forward_simulation import Motion, RemainingMission
from gcs.planning.manoeuvres.landing import ReturnRoute
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight
from gcs.planning.mission_flight import simulate_mission
from gcs.planning.planner_inputs import PlanOptions
from gcs.planning.terrain.flown_route import ALLOWED_M, FlightModel, worst_departure_m
from gcs.planning.terrain.goal import cost_matrix, goal_at
from gcs.planning.terrain.ground import Terrain, keeps_above_landing
from gcs.planning.terrain.route import TerrainRoute, plan_route
from gcs.planning.terrain.terrain_map import BandCircle, BandPose
from gcs.planning.terrain.terrain_search import band_of, levels_of

_BEARINGS: Final = 36
_DESCENTS_M: Final = (300.0, 450.0, 600.0, 900.0, 1200.0, 1500.0)
"""Lengths of the descent from the gate to the begin of the approach."""
_MAX_GATES: Final = 8
"""Gates that routes are planned to."""
_STEP_M: Final = 10.0
_ARC_RAD: Final = math.radians(60.0)
"""Greatest turn of one corner on a circle."""


@dataclass(frozen=True, slots=True)
class LandingSite:
    """Landing point, and the approach to it."""

    home_m: Point
    approach_alt_m: float
    """Height above the landing point where the approach begins."""
    grid: Grid
    """Map with the areas that an approach would meet."""


@dataclass(frozen=True, slots=True)
class _Gate:
    """Place in the band from where a straight descent leads to the approach."""

    pose: BandPose
    """Away from home."""
    begin_m: Point
    """Begin of the approach."""
    left_m: float
    """Length from the gate to home."""

    @property
    def place_m(self) -> Point:
        return self.pose.east_m, self.pose.north_m


def plan_return_over_terrain(
    terrain: Terrain, grid: Grid, route: Route, site: LandingSite, speed_m_s: float, options: PlanOptions
) -> ReturnRoute | None:
    """Plan a return route with heights; None if no approach is clear of the ground, or none is reached.

    Its first corners lead round the loiter circle at the end of the route to the target.

    Parameters
    ----------
    grid : Grid
        Map of routes.
    route : Route
        Route to the target. The return route prefers the heights of its altitude layer.
    """
    assert options.turns is not None
    assert options.loiter is not None
    model = FlightModel(speed_m_s, options.turn_lag_s, options.turns)
    band = band_of(terrain, grid, options.clearance_m, 0.0)
    back = replace(options, climb_gradient=options.sink_gradient, sink_gradient=options.climb_gradient)
    levels = [level.terrain for level in levels_of(terrain, grid, back)]
    circle = _end_circle(route, max(options.loiter.radius_m, options.turn_radius_m))
    goals = [goal_at(level, [circle]) for level in levels]
    gates = list(_gates(terrain, grid, site, options))
    lengths_m = cost_matrix(levels[0], [gate.pose for gate in gates], goals[:1])
    lengths_m = lengths_m[:, 0] + [gate.left_m for gate in gates]
    for k in np.argsort(lengths_m, kind="stable")[:_MAX_GATES].tolist():
        for level, goal in zip(levels, goals, strict=True):
            path = (
                None if goal is None else plan_route(level, gates[k].pose, goal, terrain.share(route.layer))
            )
            if path is None:
                continue
            flown = replace(path, points_m=path.points_m[::-1], heights_msl_m=path.heights_msl_m[::-1])
            if worst_departure_m(band, flown, model) > ALLOWED_M:
                continue
            landed = _landed(terrain, site, gates[k], flown)
            if _is_flown_clear(terrain, landed, model):
                return _from_circle(route, landed, circle)
    return None


def _end_circle(route: Route, radius_m: float) -> BandCircle:
    """Return the loiter circle at the end of a route, as it is flown backwards."""
    assert route.heights_msl_m is not None
    height_msl_m = float(route.heights_msl_m[-1])
    east_m, north_m = route.flown_m[-1].tolist()
    return BandCircle(east_m, north_m, radius_m, height_msl_m, height_msl_m, is_clockwise=False)


def _gates(terrain: Terrain, grid: Grid, site: LandingSite, options: PlanOptions) -> Iterator[_Gate]:
    """Yield the nearest gate on each side of home whose descent and approach are clear."""
    band = levels_of(terrain, grid, options)[0].terrain.search_band
    low_m, _ = _ends_msl_m(terrain, site)
    for k in range(_BEARINGS):
        angle = 2.0 * math.pi * k / _BEARINGS
        begin_m = _at(site.home_m, APPROACH_M, angle)
        for descent_m in _DESCENTS_M:
            place_m = _at(site.home_m, APPROACH_M + descent_m, angle)
            floor_m, ceiling_m = band.limits_at(np.array([place_m]))[0].tolist()
            floor_m = max(floor_m, low_m)
            high_m = min(ceiling_m, low_m + options.sink_gradient * (descent_m - EARLY_M))
            gate = _Gate(BandPose(*place_m, angle, floor_m, high_m), begin_m, descent_m + APPROACH_M)
            if floor_m <= high_m and _is_clear(terrain, site, gate, options.clearance_m):
                yield gate
                break


def _is_clear(terrain: Terrain, site: LandingSite, gate: _Gate, clearance_m: float) -> bool:
    """Return True if descent and approach from a gate keep above the ground, and beside obstacles."""
    points_m = np.array((gate.place_m, gate.begin_m, site.home_m))
    along_m = np.linspace(0.0, gate.left_m, round(gate.left_m / _STEP_M) + 1)
    parts = (along_m > gate.left_m - APPROACH_M).astype(np.int64)
    flown_m = points_m[0] + (along_m / gate.left_m)[:, None] * (points_m[2] - points_m[0])
    heights_m = np.array((gate.pose.low_msl_m, *_ends_msl_m(terrain, site)))
    if not site.grid.contains(gate.begin_m) or not _keeps_above(terrain, flown_m, parts, points_m, heights_m):
        return False
    is_clear = line_of_sight(site.grid, gate.place_m, gate.begin_m, clearance_m)
    return is_clear and line_of_sight(site.grid, gate.begin_m, site.home_m, 0.0)


def _ends_msl_m(terrain: Terrain, site: LandingSite) -> tuple[float, float]:
    """Return the heights where the approach begins and ends."""
    landing_msl_m = terrain.elevation.height_msl_m(*site.home_m)
    return landing_msl_m + site.approach_alt_m, landing_msl_m


@dataclass(frozen=True, eq=False)
class _Landed:
    """Path from a loiter circle to the landing: (k, 2) and (k,); the last three are gate, begin, home."""

    points_m: FloatArray
    heights_msl_m: FloatArray


def _landed(terrain: Terrain, site: LandingSite, gate: _Gate, flown: TerrainRoute) -> _Landed:
    return _Landed(
        np.vstack((flown.points_m, gate.begin_m, site.home_m)),
        np.concatenate((flown.heights_msl_m, _ends_msl_m(terrain, site))),
    )


def _is_flown_clear(terrain: Terrain, landed: _Landed, model: FlightModel) -> bool:
    """Return True if the simulated flight behind the gate keeps above the ground."""
    points_m = landed.points_m[-5:]
    begin, *ahead = ((float(east), float(north)) for east, north in points_m)
    radii_m = tuple(model.turns.accept_radii_m(points_m).tolist())
    flight = simulate_mission(
        Motion(*begin, model.speed_m_s, bearing_rad(*begin, *ahead[0])),
        None,
        RemainingMission(tuple(ahead), radii_m),
        model.turn_lag_s,
        model.turns.radius_m,
    )
    is_low = (flight.passed >= len(ahead) - 2) & (flight.passed < len(ahead))
    heights_m = landed.heights_msl_m[-5:]
    return _keeps_above(terrain, flight.places_m[is_low], flight.passed[is_low], points_m, heights_m)


def _keeps_above(
    terrain: Terrain, flown_m: FloatArray, parts: IntArray, points_m: FloatArray, heights_m: FloatArray
) -> bool:
    """Return True if a flight to a landing keeps above the ground; parameters as of `lowest_heights_m`."""
    landing_msl_m = float(heights_m[-1])
    above_m = lowest_heights_m(flown_m, parts, points_m, heights_m) - landing_msl_m
    ground_m = terrain.elevation.heights_at(flown_m) - landing_msl_m
    return bool(keeps_above_landing(above_m, ground_m, 0.5 * terrain.min_agl_m).all())


def _from_circle(route: Route, landed: _Landed, circle: BandCircle) -> ReturnRoute:
    """Return the return route from the end of a route: round its circle, clockwise, to the path."""
    centre_m = circle.east_m, circle.north_m
    entry_m = route.points_m[-1]
    exit_m = landed.points_m[0]
    entry_rad = bearing_rad(*centre_m, float(entry_m[0]), float(entry_m[1]))
    turn_rad = (bearing_rad(*centre_m, float(exit_m[0]), float(exit_m[1])) - entry_rad) % (2.0 * math.pi)
    count = math.ceil(turn_rad / _ARC_RAD - 1e-6)
    part_rad = turn_rad / max(count, 1)
    out_m = circle.radius_m / math.cos(0.5 * part_rad)
    corners = [_at(centre_m, out_m, entry_rad + (k + 0.5) * part_rad) for k in range(count)]
    points_m = np.vstack((np.array(corners).reshape(-1, 2), landed.points_m[1:]))
    heights_m = np.concatenate((np.full(count, circle.low_msl_m), landed.heights_msl_m[1:]))
    return ReturnRoute(read_only(points_m), False, heights_msl_m=read_only(heights_m), arc_points=count)


def _at(place_m: Point, distance_m: float, angle_rad: float) -> Point:
    return place_m[0] + distance_m * math.sin(angle_rad), place_m[1] + distance_m * math.cos(angle_rad)
