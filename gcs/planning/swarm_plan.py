"""Plan a team on an occupancy grid: arrays in, arrays out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gcs.model import BoolArray, FloatArray, IntArray, read_only
from gcs.planning.map.grid import Grid, Point
from gcs.planning.plan_notes import PlanNote
from gcs.planning.planner_inputs import AgentState, PlanOptions
from gcs.planning.team_routes import plan_routes


@dataclass(frozen=True, slots=True)
class SwarmPlan:
    """Routes of n agents."""

    target: IntArray
    """(n,) number of the target of each agent; -1 for none."""
    paths_m: tuple[FloatArray, ...]
    """n arrays (k, 2), east and north: from the agent's position to its target; (0, 2) without a target."""
    lengths_m: FloatArray
    """(n,) length of each path; NaN without a target."""
    notes: tuple[PlanNote, ...]
    """What to know about the plan, such as targets that no path reaches; `PlanNote.line` is the text."""

    @property
    def total_length_m(self) -> float:
        """Length of all paths."""
        return float(np.nansum(self.lengths_m))


def plan_swarm(
    blocked: ArrayLike,
    spacing_m: float,
    agents_m: ArrayLike,
    targets_m: ArrayLike,
    *,
    origin_m: Point = (0.0, 0.0),
    clearance_m: float = 0.0,
    turn_radius_m: float | None = None,
) -> SwarmPlan:
    """Assign targets to agents with the least total length, and plan their paths around blocked cells.

    Parameters
    ----------
    blocked : (rows, cols) array of bool
        True for a blocked cell. Rows count north, columns east.
    spacing_m : float
        Side of a cell.
    agents_m : (n, 2) array
        Positions of the agents, east and north.
    targets_m : (m, 2) array
        Positions of the targets; each gets at most one agent.
    origin_m : (float, float)
        East and north of the centre of cell (0, 0).
    clearance_m : float
        Distance to keep from blocked cells, where a path can keep it.
    turn_radius_m : float, optional
        Least turn radius. Without it the paths have sharp corners.

    Raises
    ------
    ValueError
        An argument has another shape or unit: names it, the expected and the found.
    """
    grid = Grid(origin_m, spacing_m, _occupancy(blocked))
    starts = _positions("agents_m", agents_m)
    goals = _positions("targets_m", targets_m)
    for name, value in (("clearance_m", clearance_m), ("turn_radius_m", turn_radius_m or 0.0)):
        if not 0.0 <= value < math.inf:
            raise ValueError(f"{name}: expected metres of at least 0, got {value}")
    agents = {i: AgentState(east_m, north_m) for i, (east_m, north_m) in enumerate(starts.tolist())}
    options = PlanOptions("pulled", clearance_m)
    if turn_radius_m:
        options = PlanOptions("flyable", clearance_m, turn_radius_m=turn_radius_m)
    targets = {(0, j): (east_m, north_m) for j, (east_m, north_m) in enumerate(goals.tolist())}
    result = plan_routes(grid, agents, targets, {}, options)
    target = np.full(len(starts), -1)
    paths_m = [np.empty((0, 2)) for _ in starts]
    lengths_m = np.full(len(starts), np.nan)
    for route in result.routes:
        target[route.vehicle] = route.target[1]
        paths_m[route.vehicle] = np.vstack((starts[route.vehicle], route.points_m))
        lengths_m[route.vehicle] = route.length_m
    target.flags.writeable = False
    return SwarmPlan(target, tuple(map(read_only, paths_m)), read_only(lengths_m), result.notes)


def _occupancy(blocked: ArrayLike) -> BoolArray:
    cells = np.asarray(blocked)
    if cells.ndim != 2 or cells.size == 0:
        raise ValueError(
            f"blocked: expected shape (rows, cols) with at least one cell, rows north; got {cells.shape}"
        )
    if cells.dtype != np.bool_:
        raise ValueError(f"blocked: expected bool, True for a blocked cell; got {cells.dtype}")
    return cells


def _positions(name: str, positions_m: ArrayLike) -> FloatArray:
    found = np.asarray(positions_m, np.float64)
    if found.size == 0:
        return np.empty((0, 2))
    if found.ndim != 2 or found.shape[1] != 2:
        raise ValueError(f"{name}: expected shape (n, 2), east and north in metres; got {found.shape}")
    if not np.isfinite(found).all():
        raise ValueError(f"{name}: expected finite metres; row {np.argmin(np.isfinite(found).all(axis=1))}")
    return found
