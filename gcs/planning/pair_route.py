"""Route of one agent to one target: shaped, with its loiter circle, and fit for wind or terrain.

`RouteSearch` or `TerrainSearch` gives the path. In wind a route that keeps more clearance, or turns more
gently, may cost less (`gcs.planning.routes_in_wind`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs.model import FloatArray, Label, NoticeCode, Route, read_only
from gcs.planning.manoeuvres.loiter import plan_terminal_loiter
from gcs.planning.map.grid import Grid, Point
from gcs.planning.plan_notes import PlanNote, of_route
from gcs.planning.planner_inputs import AgentState, PlanOptions, TargetDemand
from gcs.planning.route_joining import capture_length_m, has_explicit_turn, turn_around_s
from gcs.planning.route_search import RouteSearch
from gcs.planning.routes_in_wind import (
    WIND_SHARES,
    clearance_in_wind_m,
    detour_worth_m,
    keeps_enough,
    needed_clearance_m,
    widened,
)
from gcs.planning.terrain.detour import AvoidedFlight
from gcs.planning.terrain.terrain_search import TerrainSearch

_OF_WIDER = (NoticeCode.ROUTE_NEAR_OBSTACLES, NoticeCode.SHARP_CORNERS)
"""Notes on a route that compare it with the clearance and the turns asked for."""


@dataclass(frozen=True, slots=True)
class ShapedRoute:
    """Route of one agent to one target."""

    vehicle: int
    label: Label
    route: Route | None
    """None if no loiter circle at its end is clear."""
    grid_length_m: float
    notes: list[PlanNote]
    is_short: bool = False
    """True if it ends before the target."""
    captured: Route | None = None
    """Shorter route without an explicit first turn."""


def shape_route(
    grid: Grid, search: RouteSearch, pair: tuple[int, int], vehicle: int, label: Label, options: PlanOptions
) -> ShapedRoute:
    """Return the route of an agent to a target, with its terminal loiter."""
    i, j = pair
    start = search.agents[pair[0]]
    own = start.options or options
    aimed = search.route(i, j)
    notes = [of_route(code, vehicle, label, parameters) for code, parameters in aimed.notes]
    planned = Route(vehicle, label, aimed.points_m, aimed.length_m)
    route, problem = _with_terminal_loiter(grid, planned, start, aimed.target_m, own)
    if problem:
        notes.append(of_route(problem, vehicle, label))
    captured = None
    if route is not None and has_explicit_turn(start, route.points_m) and options.shape == "flyable":
        aimed = search.route(i, j, turns=False)
        plain = Route(vehicle, label, aimed.points_m, aimed.length_m)
        begin = replace(start, course_rad=None)
        ended, plain_problem = _with_terminal_loiter(grid, plain, begin, aimed.target_m, own)
        length_m = math.inf if ended is None or plain_problem else _captured_m(grid, ended, begin, own)
        if ended is not None and length_m < route.length_m:
            captured = replace(ended, length_m=length_m)
    return ShapedRoute(
        vehicle, label, route, aimed.grid_length_m, notes, route is not None and problem is not None, captured
    )


def shape_over_terrain(
    search: TerrainSearch,
    pair: tuple[int, int],
    vehicle: int,
    label: Label,
    layer: int,
    avoided: Sequence[AvoidedFlight] = (),
) -> ShapedRoute:
    """Return the route of an agent to a target inside the flight band, with its loiter circle."""
    found = search.route(*pair, layer, avoided)
    if found is None:
        note = of_route(NoticeCode.NO_ROUTE_IN_BAND, vehicle, label)
        return ShapedRoute(vehicle, label, None, math.inf, [note])
    planned, target_m = found
    points_m = planned.points_m[1:]
    circle = planned.circle
    route = Route(
        vehicle,
        label,
        read_only(points_m),
        planned.length_m,
        wait_m=(circle.east_m, circle.north_m),
        heights_msl_m=read_only(np.append(planned.heights_msl_m[1:], circle.low_msl_m)),
        target_point=-1 if target_m is None else int(np.argmin(np.hypot(*(points_m - target_m).T))),
    )
    notes = [of_route(NoticeCode.LOITERS_SHORT, vehicle, label)] if target_m is None else []
    return ShapedRoute(vehicle, label, route, float(search.costs[pair]), notes, target_m is None)


def fit_for_wind(
    grid: Grid,
    planned: ShapedRoute,
    shape: Callable[..., ShapedRoute],
    aim: tuple[AgentState, Point, TargetDemand],
    options: PlanOptions,
) -> ShapedRoute:
    """Return the route of an agent to a target that costs least in wind (`gcs.planning.routes_in_wind`)."""
    start, target_m, demand = aim
    own = start.options or options
    is_windy = own.turns is not None and own.turns.wind_m_s > 0.0
    if not is_windy or planned.route is None or own.shape != "flyable" or not grid.blocked.any():
        return planned

    def rated(points_m: FloatArray, length_m: float, most_m: float) -> tuple[float, float]:
        """Return the clearance of flights in wind, and cost of a route; exact below `most_m`."""
        give_up_m = needed_clearance_m(most_m - length_m, own)
        clearance_m = clearance_in_wind_m(grid, start, points_m, own, give_up_m)
        return clearance_m, length_m + detour_worth_m(clearance_m, own)

    best = planned
    best_m, least_cost_m = rated(planned.route.points_m, planned.route.length_m, math.inf)
    for shares in WIND_SHARES:
        is_whole = best_m >= 0.0 and best.is_short <= planned.is_short
        if is_whole and keeps_enough(best_m, own):
            break
        agent = replace(start, options=widened(own, *shares))
        wide = widened(options, *shares)
        search = RouteSearch(grid, [agent], [target_m], [demand], wide)
        if not math.isfinite(search.costs[0, 0]):
            continue
        most_m = least_cost_m if is_whole else math.inf
        aimed = search.route(0, 0)
        clearance_m, cost_m = rated(aimed.points_m, aimed.length_m, most_m)
        if is_whole and cost_m >= least_cost_m:
            continue
        other = shape(search, (0, 0), options=wide)
        if other.route is None:
            continue
        if not np.array_equal(other.route.points_m, aimed.points_m):
            clearance_m, cost_m = rated(other.route.points_m, other.route.length_m, most_m)
        # To hit nothing comes first, to reach the target second.
        rank = clearance_m < 0.0, other.is_short, cost_m
        if rank < (best_m < 0.0, best.is_short, least_cost_m):
            best = other
            best_m = clearance_m
            least_cost_m = cost_m
    notes = [note for note in best.notes if best is planned or note.code not in _OF_WIDER]
    if not keeps_enough(best_m, own) and all(
        note.code is not NoticeCode.ROUTE_NEAR_OBSTACLES for note in notes
    ):
        about = {"clearance_m": float(own.clearance_m)}
        notes.append(of_route(NoticeCode.ROUTE_NEAR_OBSTACLES, best.vehicle, best.label, about))
    captured = best.captured
    if captured is not None and clearance_in_wind_m(grid, start, captured.points_m, own, best_m) < best_m:
        captured = None
    return replace(best, notes=notes, captured=captured)


def _with_terminal_loiter(
    grid: Grid, route: Route, start: AgentState, target_m: Point, options: PlanOptions
) -> tuple[Route | None, NoticeCode | None]:
    """Return a route whose end can be flown, None without one, and what the operator should know."""
    if options.loiter is None or options.shape != "flyable":
        return route, None
    end = plan_terminal_loiter(grid, start, route.points_m, target_m, options, options.loiter)
    if end.clearance_m < 0.0:
        return None, NoticeCode.NO_CLEAR_LOITER
    problem = None if end.passes_target else NoticeCode.LOITERS_SHORT
    if options.loiter.is_left:
        end = replace(end, wait_m=None)
    if end.points_m is route.points_m:
        return replace(route, wait_m=end.wait_m), problem
    path_m = np.vstack(((start.east_m, start.north_m), end.points_m))
    length_m = float(np.hypot(*np.diff(path_m, axis=0).T).sum())
    route = replace(route, points_m=read_only(end.points_m), length_m=length_m, wait_m=end.wait_m)
    return route, problem


def _captured_m(grid: Grid, route: Route, start: AgentState, options: PlanOptions) -> float:
    """Return the length of a route captured without an explicit turn; infinite if it is not clear."""
    motion = start.motion
    turns = options.turns
    lag_s = options.turn_lag_s
    if motion is None or turns is None:
        return math.inf
    horizon_s = turn_around_s(motion, options.turn_radius_m, lag_s)
    return capture_length_m(grid, motion, route.points_m, turns, horizon_s, lag_s, options.clearance_m)
