"""Paths of all agents to all targets, aimed ahead of moving ones, and the path of one to where it ends.

A moving target is intercepted (`gcs.planning.intercept`): its predicted positions are extra columns of the
path search. Shaping and turns change the length of a route, so the intercept is corrected by the length of
the shaped route.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.model import FloatArray, IntArray, NoticeCode, NoticeContent, read_only
from gcs.planning.intercept import intercept_times, predict_targets
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import clear_leg
from gcs.planning.path.path_shaping import ShapedPath, connect_to_grid, shape_path
from gcs.planning.path.turns import SHARP_CORNER, SHARP_START
from gcs.planning.planner_inputs import AgentState, PlanOptions, TargetDemand
from gcs.planning.search.cost_matrix import Endpoints, PathLookup, shortest_paths
from gcs.planning.search.neighbours import SearchMap, cells, places, search_map

_MAX_CORRECTIONS = 4
_MIN_CLOSING_SHARE = 0.05
"""Share of the agent speed. Limits the correction for an agent that closes in slowly."""
_INTERCEPT_TOLERANCE_M = 5.0
"""Distance between target and route end at arrival that needs no correction."""


@dataclass(frozen=True, slots=True)
class PlannedRoute:
    """Route of one agent to one target."""

    points_m: FloatArray
    """(k, 2), without the agent's position."""
    length_m: float
    grid_length_m: float
    target_m: Point
    """Intercept point: the last waypoint, unless it is over an obstacle."""
    notes: tuple[NoticeContent, ...]
    """For the operator, without the target."""


class RouteSearch:
    """Paths of n agents to m targets.

    Attributes
    ----------
    agents : sequence of AgentState
    smap : SearchMap
    starts : Endpoints
    costs : ndarray, shape (n, m)
        Assignment cost in metres; inf without a path. Arrival times count as metres at the mean agent speed.
    """

    def __init__(
        self,
        grid: Grid,
        agents: Sequence[AgentState],
        targets: Sequence[Point],
        demands: Sequence[TargetDemand],
        options: PlanOptions,
    ) -> None:
        self._grid = grid
        self.agents = agents
        self._options = options
        self.smap: SearchMap = search_map(grid, options.clearance_m, shifts_nodes=options.shape != "grid")
        self._velocities = [one.velocity_m_s if options.horizon_s > 0.0 else (0.0, 0.0) for one in demands]
        self._prediction = predict_targets(grid, targets, self._velocities, options.horizon_s)
        self.starts = self._endpoints([(agent.east_m, agent.north_m) for agent in agents])
        self._goals = self._endpoints(self._prediction.places_m)
        self._lengths_m, self._path = self._paths(self.starts, self._goals)
        speeds = np.array([agent.speed_m_s for agent in agents])
        waited_m = speeds * [agent.start_delay_s for agent in agents]
        arrivals_s, self._intercepts_s = intercept_times(
            self._lengths_m + waited_m[:, None], self._prediction, speeds
        )
        by_length = options.cost == "length"
        self.costs: FloatArray = arrivals_s * (speeds[:, None] if by_length else speeds.mean())

    def route(self, i: int, j: int, *, turns: bool = True) -> PlannedRoute:
        """Return the route of agent i to target j, for a finite cost; without `turns` from any course."""
        first = self._prediction.first[j]
        if self._prediction.first[j + 1] - first == 1:
            return self._route_to(i, first, turns)
        return self._intercept_route(i, j, turns)

    def _intercept_route(self, i: int, j: int, turns: bool) -> PlannedRoute:
        """Route to the intercept point, corrected by the shaped length with Newton's method.

        The derivative of the path length is the target velocity along the last leg.
        """
        first = self._prediction.first[j]
        last = self._prediction.first[j + 1] - 1
        place_m = self._prediction.places_m[first]
        velocity_m_s = np.array(self._velocities[j])
        agent = self.agents[i]
        latest_s = float(self._prediction.after_s[last])
        meeting_s = float(self._intercepts_s[i, j])
        best: PlannedRoute | None = None
        for _ in range(_MAX_CORRECTIONS):
            end_m = place_m + velocity_m_s * meeting_s
            goals = self._endpoints(end_m[None, :])
            lengths_m, waypoints = self._paths(self._endpoint_of(i), goals)
            if not np.isfinite(lengths_m[0, 0]):
                break
            shaped = self._shape(i, goals, 0, waypoints(0, 0), turns)
            is_inside = bool(goals.inside[0])
            best = self._in_metres(shaped, end_m, is_inside, float(lengths_m[0, 0]))
            late_s = agent.start_delay_s + best.length_m / agent.speed_m_s - meeting_s
            off_m = float(np.hypot(*velocity_m_s)) * abs(late_s)
            leg = np.diff(shaped.points[-2:], axis=0).sum(axis=0)
            leg_length = float(np.hypot(*leg))
            if (
                off_m <= _INTERCEPT_TOLERANCE_M
                or leg_length == 0.0
                or (late_s > 0.0 and meeting_s >= latest_s)
            ):
                break
            receding = float(leg @ velocity_m_s) / (leg_length * agent.speed_m_s)
            meeting_s += late_s / max(1.0 - receding, _MIN_CLOSING_SHARE)
            meeting_s = min(max(meeting_s, 0.0), latest_s)
        if best is not None:
            return best
        reached = np.flatnonzero(np.isfinite(self._lengths_m[i, first : last + 1]))
        return self._route_to(i, first + int(reached[-1]), turns)

    def _route_to(self, i: int, k: int, turns: bool) -> PlannedRoute:
        """Return the route of agent i to a predicted position."""
        shaped = self._shape(i, self._goals, k, self._path(i, k), turns)
        is_inside = self._goals.inside[k]
        return self._in_metres(
            shaped, self._prediction.places_m[k], bool(is_inside), float(self._lengths_m[i, k])
        )

    def _endpoints(self, points_m: FloatArray | Sequence[Point]) -> Endpoints:
        """Connect positions to the grid."""
        grid = self._grid
        smap = self.smap
        xy = (np.array(points_m, dtype=np.float64) - grid.origin_m) / grid.spacing_m
        return Endpoints(
            xy, *connect_to_grid(grid.blocked, smap.largest_component, smap.tight_nodes, smap.stride, xy)
        )

    def _endpoint_of(self, i: int) -> Endpoints:
        one = slice(i, i + 1)
        of = self.starts
        return Endpoints(of.xy[one], of.nodes[one], of.gaps[one], of.inside[one])

    def _paths(self, starts: Endpoints, goals: Endpoints) -> tuple[FloatArray, PathLookup]:
        return shortest_paths(self._grid, self.smap, starts, goals, self._options.clearance_m)

    def _shape(self, i: int, goals: Endpoints, j: int, nodes: IntArray, turns: bool) -> ShapedPath:
        """Return a shaped route, in cells."""
        grid = self._grid
        options = self._options
        course = self.agents[i].course_rad
        turn_radius_m = (self.agents[i].options or options).turn_radius_m
        ends_at_target = not goals.inside[j]
        start_xy = self.starts.xy[i]
        goal_xy = goals.xy[j]
        parts = [start_xy[None], self._waypoints(nodes, start_xy, goal_xy)] + [goal_xy[None]] * ends_at_target
        heading = np.zeros(2)
        if turns and course is not None and math.isfinite(course):
            heading = np.array([math.sin(course), math.cos(course)])
        return shape_path(
            grid.blocked,
            options.clearance_m / grid.spacing_m,
            np.concatenate(parts),
            heading,
            bool(self.starts.inside[i]),
            bool(ends_at_target),
            options.shape,
            turn_radius_m / grid.spacing_m,
        )

    def _waypoints(self, nodes: IntArray, start_xy: FloatArray, goal_xy: FloatArray) -> FloatArray:
        """Return the waypoints of a grid path, in cells.

        The end nodes are not shifted where that breaks their line of sight to the endpoint.
        """
        waypoints = places(self.smap, nodes)
        for end, (x, y) in ((0, start_xy), (-1, goal_xy)):
            if not len(waypoints):
                continue
            to_x, to_y = waypoints[end].tolist()
            if not clear_leg(self._grid.blocked, x, y, to_x, to_y, 0.0, -1):
                waypoints[end] = cells(self.smap, nodes[[end]])
        is_new = np.append(True, (np.diff(waypoints, axis=0) != 0.0).any(axis=1))[: len(waypoints)]
        return waypoints[is_new]

    def _in_metres(
        self, shaped: ShapedPath, place_m: FloatArray, is_inside: bool, grid_length_m: float
    ) -> PlannedRoute:
        """Return a shaped route in metres, with its notes."""
        grid = self._grid
        clearance_m = self._options.clearance_m
        points = shaped.points * grid.spacing_m + np.array(grid.origin_m)
        notes: list[NoticeContent] = []
        if is_inside:
            east, north = points[-1]
            end_m = {"east_m": float(east), "north_m": float(north)}
            notes.append((NoticeCode.TARGET_OVER_OBSTACLE, end_m))
        else:
            points[-1] = place_m
        if not shaped.keeps_clearance:
            notes.append((NoticeCode.ROUTE_NEAR_OBSTACLES, {"clearance_m": float(clearance_m)}))
        if shaped.problem & SHARP_START:
            notes.append((NoticeCode.TIGHTEST_TURN, {}))
        if shaped.problem & SHARP_CORNER:
            notes.append((NoticeCode.SHARP_CORNERS, {}))
        length_m = shaped.length * grid.spacing_m
        met_m = (float(place_m[0]), float(place_m[1]))
        return PlannedRoute(read_only(points[1:]), length_m, grid_length_m, met_m, tuple(notes))
