"""Warm-up of the planner: one call of each of its kernels, which compiles it or loads it from the cache."""

from __future__ import annotations

import numpy as np

from gcs import jit
from gcs.planning import forward_simulation, intercept, layer_assignment
from gcs.planning.manoeuvres import loiter
from gcs.planning.map import clearance_nodes
from gcs.planning.map.grid import free_grid
from gcs.planning.map.line_of_sight import clear_leg, clearances_along
from gcs.planning.path.initial_turn import is_turn_safe, start_clearance
from gcs.planning.path.path_shaping import (
    connect_to_grid,
    is_adjacent_and_visible,
    keeps_clearance,
    legs_are_clear,
    shorten,
)
from gcs.planning.path.string_pulling import pull_string
from gcs.planning.path.turns import make_flyable
from gcs.planning.search import canonical_ordering, cost_matrix
from gcs.planning.search.neighbours import search_map


def warm_up_calls() -> list[jit.Call]:
    """Return one call of every kernel, as typed in a plan. The slowest to compile stand at the ends."""
    grid = free_grid((2, 2), 10.0)
    blocked = grid.blocked
    smap = search_map(grid)
    xy = np.zeros((1, 2))
    vertices = np.array([[0.0, 0.0], [1.0, 1.0]])
    return [
        (clear_leg, blocked, 0.0, 0.0, 1.0, 1.0, 0.0, -1),
        (pull_string, blocked, 0.0, vertices, np.zeros(2), 0.0, 0.0, -1),
        (shorten, blocked, 0.0, vertices, np.zeros(2), -1, False, False),
        (connect_to_grid, blocked, smap.largest_component, smap.tight_nodes, smap.stride, xy),
        (clearances_along, blocked, np.ones(3), xy, 1.0),
        (is_adjacent_and_visible, blocked, 0.0, xy[0], xy[0]),
        (keeps_clearance, blocked, 0.0, vertices, -1, False),
        (legs_are_clear, blocked, vertices, -1),
        *canonical_ordering.warm_up_calls(),
        *clearance_nodes.warm_up_calls(),
        *cost_matrix.warm_up_calls(),
        *intercept.warm_up_calls(),
        *forward_simulation.warm_up_calls(),
        *loiter.warm_up_calls(),
        *layer_assignment.warm_up_calls(),
        (make_flyable, blocked, 0.0, vertices, np.zeros(2), 1.0, -1),
        (is_turn_safe, blocked, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, -1),
        (start_clearance, blocked, 0.0, 0.0, 0.0),
    ]


def warm_up() -> None:
    """Compile every kernel, or load it from the cache. Otherwise the first plan takes seconds longer."""
    jit.warm_up(__name__)
