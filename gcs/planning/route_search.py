"""The ways of all agents to all targets, and the route of one agent to one target.

A target that moves is met on its way (`gcs.planning.intercept`): the places that it will pass stand in the
cost matrix beside those of targets that stand still. What an agent then flies differs a little from its way
along the grid, by shaping and turns; so the meeting is corrected by the route's own length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.model import FloatArray, read_only
from gcs.planning.intercept import meetings, outlook
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import clear_leg
from gcs.planning.options import AgentState, PlanOptions, TargetDemand
from gcs.planning.path.shortcut import Shaped, joins, shape_way
from gcs.planning.path.turns import SHARP_CORNER, SHARP_START
from gcs.planning.search.canonical_ordering import IntArray
from gcs.planning.search.cost_matrix import Places, Way, metric_ways, paper_ways
from gcs.planning.search.neighbours import SearchMap, cells, places, search_map

_CORRECTIONS = 4
_LEAST_CLOSING = 0.05
"""Of the agent's speed: an agent that closes in more slowly is not sent any farther at once."""
_CORRECT_M = 5.0
"""A meeting is right when the target is this near to it as the agent arrives."""


@dataclass(frozen=True, slots=True)
class PlannedRoute:
    """A route of one agent to one target."""

    points_m: FloatArray
    """(k, 2), the agent's place excluded."""
    length_m: float
    grid_length_m: float
    target_m: Point
    """Where the target is met: the last point, unless it is over an obstacle."""
    notes: tuple[str, ...]
    """With ``{}`` where the target's name belongs."""


class Search:
    """Ways of n agents to m targets.

    Attributes
    ----------
    smap : SearchMap
    starts : Places
    costs : ndarray, shape (n, m)
        What an agent at a target costs, in metres; inf where there is no way. Times of arrival count as what
        the average agent flies meanwhile.
    """

    def __init__(
        self,
        grid: Grid,
        agents: Sequence[AgentState],
        targets: Sequence[Point],
        demands: Sequence[TargetDemand],
        options: PlanOptions,
    ) -> None:
        self._grid, self._agents, self._options = grid, agents, options
        self.smap: SearchMap = search_map(grid, options.clearance_m, shifts_nodes=options.shape != "grid")
        self._find = paper_ways if options.search_cost == "paper" else metric_ways
        self._velocities = [one.velocity_m_s if options.horizon_s > 0.0 else (0.0, 0.0) for one in demands]
        self._view = outlook(grid, targets, self._velocities, options.horizon_s)
        self.starts = self._places([(agent.east_m, agent.north_m) for agent in agents])
        self._goals = self._places(self._view.places_m)
        self._lengths_m, self._way = self._ways(self.starts, self._goals)
        speeds = np.array([agent.speed_m_s for agent in agents])
        waited_m = speeds * [agent.start_delay_s for agent in agents]
        arrivals_s, self._met_s = meetings(self._lengths_m + waited_m[:, None], self._view, speeds)
        by_length = options.cost == "length"
        self.costs: FloatArray = arrivals_s * (speeds[:, None] if by_length else speeds.mean())

    def route(self, i: int, j: int) -> PlannedRoute:
        """Return the route of agent i to target j, to which there is a way."""
        first = self._view.first[j]
        if self._view.first[j + 1] - first == 1:
            return self._at(i, first)
        return self._intercepting(i, j)

    def _intercepting(self, i: int, j: int) -> PlannedRoute:
        """Aim at the meeting, and correct it by what is really flown, as Newton would.

        A way grows with its end by the end's velocity along the last leg.
        """
        first, last = self._view.first[j], self._view.first[j + 1] - 1
        place_m, velocity_m_s = self._view.places_m[first], np.array(self._velocities[j])
        agent, latest_s = self._agents[i], float(self._view.after_s[last])
        meeting_s = float(self._met_s[i, j])
        best: PlannedRoute | None = None
        for _ in range(_CORRECTIONS):
            end_m = place_m + velocity_m_s * meeting_s
            goals = self._places(end_m[None, :])
            lengths_m, way = self._ways(self._start(i), goals)
            if not np.isfinite(lengths_m[0, 0]):
                break
            shaped, is_inside = self._shaped(i, goals, 0, way(0, 0)), bool(goals.inside[0])
            best = self._in_metres(shaped, end_m, is_inside, float(lengths_m[0, 0]))
            late_s = agent.start_delay_s + best.length_m / agent.speed_m_s - meeting_s
            off_m = float(np.hypot(*velocity_m_s)) * abs(late_s)
            leg = np.diff(shaped.points[-2:], axis=0).sum(axis=0)
            leg_length = float(np.hypot(*leg))
            if off_m <= _CORRECT_M or leg_length == 0.0 or (late_s > 0.0 and meeting_s >= latest_s):
                break
            receding = float(leg @ velocity_m_s) / (leg_length * agent.speed_m_s)
            meeting_s += late_s / max(1.0 - receding, _LEAST_CLOSING)
            meeting_s = min(max(meeting_s, 0.0), latest_s)
        if best is not None:
            return best
        return self._at(i, first + int(np.flatnonzero(np.isfinite(self._lengths_m[i, first : last + 1]))[-1]))

    def _at(self, i: int, k: int) -> PlannedRoute:
        """Return the route of agent i to a place of the outlook."""
        shaped, is_inside = self._shaped(i, self._goals, k, self._way(i, k)), bool(self._goals.inside[k])
        return self._in_metres(shaped, self._view.places_m[k], is_inside, float(self._lengths_m[i, k]))

    def _places(self, points_m: FloatArray | Sequence[Point]) -> Places:
        """Find how places join the map."""
        grid, smap = self._grid, self.smap
        xy = (np.array(points_m, dtype=np.float64) - grid.origin_m) / grid.spacing_m
        return Places(xy, *joins(grid.blocked, smap.mainland, smap.tight, smap.stride, xy))

    def _start(self, i: int) -> Places:
        one, of = slice(i, i + 1), self.starts
        return Places(of.xy[one], of.nodes[one], of.off[one], of.inside[one])

    def _ways(self, starts: Places, goals: Places) -> tuple[FloatArray, Way]:
        return self._find(self._grid, self.smap, starts, goals, self._options.clearance_m)

    def _shaped(self, i: int, goals: Places, j: int, nodes: IntArray) -> Shaped:
        """Return a route as it is flown, in cells."""
        grid, options, course = self._grid, self._options, self._agents[i].course_rad
        ends_at_target = not goals.inside[j]
        start_xy, goal_xy = self.starts.xy[i], goals.xy[j]
        parts = [start_xy[None], self._passed(nodes, start_xy, goal_xy)] + [goal_xy[None]] * ends_at_target
        heading = np.zeros(2)
        if course is not None and math.isfinite(course):
            heading = np.array([math.sin(course), math.cos(course)])
        return shape_way(
            grid.blocked,
            options.clearance_m / grid.spacing_m,
            np.concatenate(parts),
            heading,
            bool(self.starts.inside[i]),
            bool(ends_at_target),
            options.shape,
            options.turn_radius_m / grid.spacing_m,
        )

    def _passed(self, nodes: IntArray, start_xy: FloatArray, goal_xy: FloatArray) -> FloatArray:
        """Return where a way passes by its nodes, in cells; where it joins a place, it is in sight of it."""
        way = places(self.smap, nodes)
        for end, (x, y) in ((0, start_xy), (-1, goal_xy)):
            if len(way) and not clear_leg(self._grid.blocked, x, y, *way[end].tolist(), 0.0, -1):
                way[end] = cells(self.smap, nodes[[end]])
        is_new = np.append(True, (np.diff(way, axis=0) != 0.0).any(axis=1))[: len(way)]
        passed: FloatArray = way[is_new]
        return passed

    def _in_metres(
        self, shaped: Shaped, place_m: FloatArray, is_inside: bool, grid_length_m: float
    ) -> PlannedRoute:
        """Return a shaped route in metres, with what an operator should know of it."""
        grid, clearance_m = self._grid, self._options.clearance_m
        points = shaped.points * grid.spacing_m + np.array(grid.origin_m)
        notes = []
        if is_inside:
            east, north = points[-1]
            notes.append(f"target {{}} is over an obstacle; the route ends at ({east:.0f}, {north:.0f}) m")
        else:
            points[-1] = place_m
        if not shaped.is_roomy:
            notes.append(
                f"the route to target {{}} comes nearer than {clearance_m:g} m to obstacles: "
                "no way but a long detour, or none, keeps away"
            )
        if shaped.problem & SHARP_START:
            notes.append("no clear turn on to its route; it turns as tightly as it can")
        if shaped.problem & SHARP_CORNER:
            notes.append("its route has corners that it cannot fly without coming too near")
        length_m, met_m = shaped.length * grid.spacing_m, (float(place_m[0]), float(place_m[1]))
        return PlannedRoute(read_only(points[1:]), length_m, grid_length_m, met_m, tuple(notes))
