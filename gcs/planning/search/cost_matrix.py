"""Cost matrix: shortest paths of all agent-target pairs, by A* or by Dijkstra, whichever is faster.

One-to-all Dijkstra from each place of the smaller side covers the other side, and ends when all of it is
reached. For few pairs, and on open ground, A* per pair is faster. `is_pairwise_faster` estimates both from
the distances and the share of blocked nodes.

A path is kept as the arrival moves of its nodes, a byte per node. Costs are read at the endpoints and then
overwritten by the next search, so memory stays small and in the cache.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from gcs.jit import Call, kernel
from gcs.model import BoolArray, ByteArray, FloatArray, IntArray
from gcs.planning.map.grid import Grid, free_grid
from gcs.planning.path.path_shaping import is_adjacent_and_visible
from gcs.planning.search.bucket_astar import bucket_astar
from gcs.planning.search.canonical_ordering import NO_MOVE, move_length
from gcs.planning.search.dijkstra import costs_at, dijkstra_buffers, one_to_all, trace_back
from gcs.planning.search.grid_search import borrow_search
from gcs.planning.search.neighbours import SearchMap, flat_index, search_map

PathLookup: TypeAlias = Callable[[int, int], IntArray]
"""Function that returns the flat nodes of the path of agent i to target j, in order of flight.

Empty for adjacent places in line of sight.
"""

# Instead of the index of the connecting node at the end of a path: no path, or a direct leg.
_NO_PATH = -1
_DIRECT = -2

# Search times (2-core AMD EPYC, random obstacles), to choose between A* and one-to-all searches.
_CALL_US = 20.0
_DIJKSTRA_NODE_US = 0.013
_ASTAR_NODE_US = 0.025
_ASTAR_SHARE = 0.8
"""Expanded nodes of A*, divided by the squared distance in cells and the share of blocked nodes."""


class Endpoints(NamedTuple):
    """Positions of n agents or targets in cells, and their connections to the grid (`path.path_shaping`).

    ======  ======  =======  =========================================================
    xy      (n, 2)  float64  column and row
    nodes   (n, 4)  int64    flat nodes that connect a place to the grid, -1 for none
    gaps    (n, 4)  float64  distances to these nodes
    inside  (n,)    bool     True for places inside an obstacle
    ======  ======  =======  =========================================================
    """

    xy: FloatArray
    nodes: IntArray
    gaps: FloatArray
    inside: BoolArray


def shortest_paths(
    grid: Grid, smap: SearchMap, starts: Endpoints, goals: Endpoints, clearance_m: float
) -> tuple[FloatArray, PathLookup]:
    """Return the shortest paths of all pairs and their lengths in metres, (n, m); inf without a path.

    With clearance the path is the one of least cost; the length counts tight moves once.
    """
    if is_pairwise_faster(smap, starts.xy, goals.xy):
        lengths, path = _pairwise(grid, smap, starts, goals, clearance_m)
    elif len(goals.xy) < len(starts.xy):
        lengths, path = _reverse(*_one_to_all(grid, smap, goals, starts, clearance_m))
    else:
        lengths, path = _one_to_all(grid, smap, starts, goals, clearance_m)
    return lengths * grid.spacing_m, path


def _reverse(lengths: FloatArray, path: PathLookup) -> tuple[FloatArray, PathLookup]:
    """Return the paths in the other direction."""
    return lengths.T, lambda i, j: path(j, i)[::-1]


def is_pairwise_faster(smap: SearchMap, starts_xy: FloatArray, goals_xy: FloatArray) -> bool:
    """Return True if A* per pair is expected to be faster than one-to-all searches from the smaller side.

    A* expands a share of the squared distance that grows with the obstacles in between. A one-to-all search
    expands a disc that reaches the farthest place.
    """
    free = np.count_nonzero(smap.component) / smap.component.size
    hindered = (
        1.0
        - free
        + (np.count_nonzero(smap.tight_nodes) / smap.tight_nodes.size if smap.has_tight_moves else 0.0)
    )
    apart2 = ((starts_xy[:, np.newaxis, :] - goals_xy[np.newaxis, :, :]) ** 2).sum(axis=2)
    pairs_us = apart2.size * _CALL_US + _ASTAR_NODE_US * _ASTAR_SHARE * hindered * apart2.sum()
    farthest2 = apart2.max(axis=int(len(starts_xy) <= len(goals_xy)))
    discs = np.minimum(free * np.pi * farthest2, free * smap.component.size)
    return bool(pairs_us < len(discs) * _CALL_US + _DIJKSTRA_NODE_US * discs.sum())


def _one_to_all(
    grid: Grid, smap: SearchMap, near: Endpoints, far: Endpoints, clearance_m: float
) -> tuple[FloatArray, PathLookup]:
    """Return paths in cells from each of `near` to each of `far`."""
    size = smap.moves.size
    n = len(near.xy)
    came_by = np.empty((n, size), dtype=np.uint8)
    field = np.empty(size)
    costs = np.empty((n, *far.nodes.shape))
    wanted = far.nodes[far.nodes >= 0]
    parts = smap.component[wanted]
    with borrow_search(grid, clearance_m, smap.shifts_nodes) as search:
        for i in range(n):
            nodes = near.nodes[i]
            within_reach = wanted[(parts[:, None] == smap.component[nodes[nodes >= 0]]).any(axis=1)]
            if within_reach.size:
                search.one_to_all(nodes, near.gaps[i], within_reach, field, came_by[i])
            else:
                field[:] = np.inf
            costs_at(field, far.nodes, costs[i])
    lengths, via = _path_ends(
        grid.blocked,
        clearance_m / grid.spacing_m,
        near,
        far,
        costs,
        smap.has_tight_moves,
        smap.offsets,
        came_by,
    )
    buffer = np.empty(size, dtype=np.int64)

    def path(i: int, j: int) -> IntArray:
        count = trace_back(smap.offsets, came_by[i], far.nodes[j, via[i, j]], buffer) if via[i, j] >= 0 else 0
        return buffer[:count][::-1].copy()

    return lengths, path


def _pairwise(
    grid: Grid, smap: SearchMap, starts: Endpoints, goals: Endpoints, clearance_m: float
) -> tuple[FloatArray, PathLookup]:
    """Return paths in cells of all pairs, with one A* search each."""
    lengths = np.full((len(starts.xy), len(goals.xy)), np.inf)
    paths: dict[tuple[int, int], IntArray] = {}
    clearance = clearance_m / grid.spacing_m
    start_parts, goal_parts = (
        [set(smap.component[row[row >= 0]].tolist()) for row in side.nodes] for side in (starts, goals)
    )
    with borrow_search(grid, clearance_m, smap.shifts_nodes) as search:
        for i, j in np.ndindex(lengths.shape):
            a = starts.xy[i]
            b = goals.xy[j]
            is_inside = starts.inside[i] or goals.inside[j]
            if not is_inside and is_adjacent_and_visible(grid.blocked, clearance, a, b):
                lengths[i, j] = np.hypot(*(b - a))
                paths[i, j] = np.empty(0, dtype=np.int64)
                continue
            if start_parts[i].isdisjoint(goal_parts[j]):
                continue
            nodes, cost, length, _ = search.path(
                starts.nodes[i], starts.gaps[i], goals.nodes[j], goals.gaps[j]
            )
            if not nodes.size:
                continue
            paths[i, j] = nodes
            lengths[i, j] = cost
            if smap.has_tight_moves:
                # The search cost counts tight moves several times; the assignment compares lengths.
                first_gap = starts.gaps[i][starts.nodes[i] == nodes[0]][0]
                last_gap = goals.gaps[j][goals.nodes[j] == nodes[-1]][0]
                lengths[i, j] = length + (first_gap + last_gap)
    return lengths, lambda i, j: paths[i, j]


@kernel
def _path_ends(
    blocked: BoolArray, clearance: float, near: Endpoints, far: Endpoints, costs: FloatArray,
    has_tight_moves: bool, offsets: IntArray, came_by: ByteArray,
) -> tuple[FloatArray, IntArray]:  # fmt: skip
    """Return the path length in cells of all pairs, (n, m), and the index of the last connecting node."""
    lengths = np.empty((near.inside.size, far.inside.size))
    via = np.empty((near.inside.size, far.inside.size), np.int64)
    for i in range(near.inside.size):
        for j in range(far.inside.size):
            lengths[i, j] = np.inf
            via[i, j] = _NO_PATH
            is_inside = near.inside[i] or far.inside[j]
            if not is_inside and is_adjacent_and_visible(blocked, clearance, near.xy[i], far.xy[j]):
                lengths[i, j] = np.hypot(far.xy[j, 0] - near.xy[i, 0], far.xy[j, 1] - near.xy[i, 1])
                via[i, j] = _DIRECT
                continue
            for k in range(costs.shape[2]):
                if costs[i, j, k] + far.gaps[j, k] < lengths[i, j]:
                    lengths[i, j] = costs[i, j, k] + far.gaps[j, k]
                    via[i, j] = k
            if has_tight_moves and via[i, j] >= 0:
                # The search cost counts tight moves several times; the assignment compares lengths.
                node = far.nodes[j, via[i, j]]
                length = far.gaps[j, via[i, j]]
                while came_by[i, node] != NO_MOVE:
                    move = came_by[i, node]
                    length += move_length(move, False)
                    node -= offsets[move]
                for k in range(near.nodes.shape[1]):
                    if near.nodes[i, k] == node:
                        length += near.gaps[i, k]
                        break
                lengths[i, j] = length
    return lengths, via


def warm_up_calls() -> list[Call]:
    """Return one call of every search kernel with the types of a plan."""
    grid = free_grid((2, 2), 10.0)
    smap = search_map(grid)
    size = smap.moves.size
    node = flat_index(smap, (0, 0))
    nodes = np.full(4, node)
    gaps = np.zeros(4)
    ends = Endpoints(np.zeros((1, 2)), nodes[None], gaps[None], np.zeros(1, np.bool_))
    path = np.empty(size, np.int64)
    field = np.zeros(size)
    came_by = np.full((1, size), NO_MOVE, np.uint8)
    lists = smap.move_lists, smap.has_tight_moves, smap.offsets
    packed = smap.packed.copy()
    entries = np.empty((2 * size, 2), np.int32)
    return [
        (bucket_astar, *lists, smap.stride, nodes, gaps, nodes, gaps, np.zeros(size), packed, entries, path),
        (_path_ends, grid.blocked, 0.0, ends, ends, np.zeros((1, 1, 4)), *lists[1:], came_by),
        (costs_at, field, ends.nodes, ends.gaps),
        (trace_back, smap.offsets, came_by[0], node, path),
        (one_to_all, *lists, nodes, gaps, nodes, field, came_by[0], packed, *dijkstra_buffers(smap)),
    ]
