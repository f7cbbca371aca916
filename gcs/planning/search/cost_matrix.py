"""The cost matrix: shortest ways of all pairs of agents and targets.

One search from each place of the smaller side serves all of the other side; it ends when all of them are
reached. A few pairs are cheaper to search one by one, all the more on open ground: there A* looks at little
more than the path. Which way is the cheaper one is estimated from how far apart the places are and how much
of the map is blocked (`pairwise_pays`).

A way is kept as the moves by which its nodes were reached, a byte a node; the costs themselves are read where
they are needed and then overwritten by the next search, so that memory stays small and in the cache.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from gcs.jit import Call, kernel
from gcs.model import FloatArray
from gcs.planning.map.grid import BoolArray, Grid, free_grid
from gcs.planning.path.shortcut import close_and_seen
from gcs.planning.search.astar import seek, seek_paper, seeker
from gcs.planning.search.canonical_ordering import NO_MOVE, IntArray, move_cost
from gcs.planning.search.dijkstra import costs_at, room_to_work, spread, trace_back
from gcs.planning.search.neighbours import SearchMap, cells, flat_index, kernel_arrays, search_map

Way: TypeAlias = Callable[[int, int], IntArray]
"""Flat nodes of the way of agent i to target j, in the order of flight; empty if they see each other
closely."""

_NO_WAY, _DIRECT = -1, -2
"""In place of the join by which a way ends: there is none; the two places are close and see each other."""

# What searches take (2-core AMD EPYC, random obstacles), to choose between the two ways to fill a matrix.
_CALL_US = 20.0
_SPREAD_NODE_US = 0.013
_PAIR_NODE_US = 0.025
_PAIR_PART = 0.8
"""Nodes that A* looks at, over the squared distance in cells and the part of the map that is blocked."""


@dataclass(frozen=True, eq=False)
class Places:
    """Where n agents or targets are, in cells, and how they join the map (see `shaping.joins`).

    Attributes
    ----------
    xy : ndarray, shape (n, 2)
        Column and row.
    nodes : ndarray of int, shape (n, 4)
        Flat nodes by which they join the map, -1 for none.
    off : ndarray, shape (n, 4)
        How far off these are.
    inside : ndarray of bool, shape (n,)
        Whether they are inside an obstacle.
    """

    xy: FloatArray
    nodes: IntArray
    off: FloatArray
    inside: BoolArray


def metric_ways(
    grid: Grid, smap: SearchMap, starts: Places, goals: Places, clearance_m: float
) -> tuple[FloatArray, Way]:
    """Shortest ways of all pairs: their lengths in metres, (n, m), inf where there is none, and the ways.

    Where clearance makes tight moves count more, the way is the one of least cost, the length what is flown.
    """
    if pairwise_pays(smap, starts.xy, goals.xy):
        lengths, way = _one_by_one(grid, smap, starts, goals, clearance_m)
    elif len(goals.xy) < len(starts.xy):
        turned, back = _one_to_all(grid, smap, goals, starts, clearance_m)
        lengths, way = turned.T, lambda i, j: back(j, i)[::-1]
    else:
        lengths, way = _one_to_all(grid, smap, starts, goals, clearance_m)
    return lengths * grid.spacing_m, way


def pairwise_pays(smap: SearchMap, starts_xy: FloatArray, goals_xy: FloatArray) -> bool:
    """Whether single searches are expected to take less time than one search to all from the fewer side.

    A* looks at a part of the square of the distance that grows with the obstacles in the way; a search to all
    at a disc that reaches the farthest.
    """
    free = np.count_nonzero(smap.part) / smap.part.size
    hindered = 1.0 - free + (np.count_nonzero(smap.tight) / smap.tight.size if smap.any_near else 0.0)
    apart2 = ((starts_xy[:, np.newaxis, :] - goals_xy[np.newaxis, :, :]) ** 2).sum(axis=2)
    pairs_us = apart2.size * _CALL_US + _PAIR_NODE_US * _PAIR_PART * hindered * apart2.sum()
    farthest2 = apart2.max(axis=int(len(starts_xy) <= len(goals_xy)))
    discs = np.minimum(free * np.pi * farthest2, free * smap.part.size)
    return bool(pairs_us < len(discs) * _CALL_US + _SPREAD_NODE_US * discs.sum())


def _one_to_all(
    grid: Grid, smap: SearchMap, near: Places, far: Places, clearance_m: float
) -> tuple[FloatArray, Way]:
    """Ways in cells from each of `near` to each of `far`."""
    size, n = smap.moves.size, len(near.xy)
    came = np.empty((n, size), dtype=np.uint8)
    field, costs, reach = np.empty(size), np.empty((n, *far.nodes.shape)), clearance_m / grid.spacing_m
    asked = far.nodes[far.nodes >= 0]
    parts = smap.part[asked]
    with seeker(grid, clearance_m, smap.shifts_nodes) as search:
        for i in range(n):
            nodes = near.nodes[i]
            within_reach = asked[(parts[:, None] == smap.part[nodes[nodes >= 0]]).any(axis=1)]
            if within_reach.size:
                search.spread(nodes, near.off[i], within_reach, field, came[i])
            else:
                field[:] = np.inf
            costs_at(field, far.nodes, costs[i])
    lengths, via = _ends_of_ways(
        *(grid.blocked, reach, near.xy, near.inside, far.xy, far.off, far.inside, costs),
        *(smap.any_near, smap.offsets, came, near.nodes, near.off, far.nodes),
    )
    path = np.empty(size, dtype=np.int64)

    def way(i: int, j: int) -> IntArray:
        count = trace_back(smap.offsets, came[i], far.nodes[j, via[i, j]], path) if via[i, j] >= 0 else 0
        return path[:count][::-1].copy()

    return lengths, way


def _one_by_one(
    grid: Grid, smap: SearchMap, starts: Places, goals: Places, clearance_m: float
) -> tuple[FloatArray, Way]:
    """Ways in cells of all pairs, each searched by itself."""
    lengths = np.full((len(starts.xy), len(goals.xy)), np.inf)
    ways: dict[tuple[int, int], IntArray] = {}
    reach = clearance_m / grid.spacing_m
    parts = [[set(smap.part[row[row >= 0]].tolist()) for row in side.nodes] for side in (starts, goals)]
    with seeker(grid, clearance_m, smap.shifts_nodes) as search:
        for i, j in np.ndindex(lengths.shape):
            a, b = starts.xy[i], goals.xy[j]
            if not (starts.inside[i] or goals.inside[j]) and close_and_seen(grid.blocked, reach, a, b):
                lengths[i, j], ways[i, j] = np.hypot(*(b - a)), np.empty(0, dtype=np.int64)
                continue
            ends = (starts.nodes[i], starts.off[i], goals.nodes[j], goals.off[j])
            if parts[0][i].isdisjoint(parts[1][j]):
                continue
            nodes, cost, flown, _ = search.path(*ends)
            if nodes.size:
                # Tight moves counted many times over while searching; what is flown is compared later.
                off = ends[1][ends[0] == nodes[0]][0] + ends[3][ends[2] == nodes[-1]][0]
                ways[i, j], lengths[i, j] = nodes, flown + off if smap.any_near else cost
    return lengths, lambda i, j: ways[i, j]


@kernel
def _ends_of_ways(  # type: ignore[no-untyped-def]
    blocked, reach, near, near_inside, far, far_off, far_inside, costs, any_near, offsets, came,
    near_nodes, near_off, far_nodes,
):  # fmt: skip
    """Length in cells of the way between all pairs, (n, m), and the join by which it ends."""
    n, m = near.shape[0], far.shape[0]
    lengths, via = np.empty((n, m)), np.empty((n, m), np.int64)
    for i in range(n):
        for j in range(m):
            lengths[i, j], via[i, j] = np.inf, _NO_WAY
            if not (near_inside[i] or far_inside[j]) and close_and_seen(blocked, reach, near[i], far[j]):
                lengths[i, j] = np.hypot(far[j, 0] - near[i, 0], far[j, 1] - near[i, 1])
                via[i, j] = _DIRECT
                continue
            for k in range(costs.shape[2]):
                if costs[i, j, k] + far_off[j, k] < lengths[i, j]:
                    lengths[i, j] = costs[i, j, k] + far_off[j, k]
                    via[i, j] = k
            if any_near and via[i, j] >= 0:
                # Tight moves counted many times over while searching; what is flown is compared later.
                node, flown = far_nodes[j, via[i, j]], far_off[j, via[i, j]]
                while came[i, node] != NO_MOVE:
                    move = came[i, node]
                    flown += move_cost(move, False)
                    node -= offsets[move]
                for k in range(near_nodes.shape[1]):
                    if near_nodes[i, k] == node:
                        flown += near_off[i, k]
                        break
                lengths[i, j] = flown
    return lengths, via


def paper_ways(
    grid: Grid, smap: SearchMap, starts: Places, goals: Places, clearance_m: float
) -> tuple[FloatArray, Way]:
    """Ways of all pairs by the paper's cost, from nearest node to nearest node; lengths are what is flown.

    That cost has no search to all: what is found depends on the goal, so it is searched pair by pair.
    """
    lengths_m = np.full((len(starts.xy), len(goals.xy)), np.inf)
    ways: dict[tuple[int, int], IntArray] = {}
    reach = clearance_m / grid.spacing_m
    path = np.empty(smap.moves.size, dtype=np.int64)
    for i, (a, first) in enumerate(zip(starts.xy, _nearest_joins(starts), strict=True)):
        for j, (b, last) in enumerate(zip(goals.xy, _nearest_joins(goals), strict=True)):
            if first < 0 or last < 0:
                continue
            count = 0
            if starts.inside[i] or goals.inside[j] or not close_and_seen(grid.blocked, reach, a, b):
                count, _ = seek_paper(smap.moves, smap.near, smap.offsets, smap.stride, first, last, path)
                if count == 0:
                    continue
            ways[i, j] = path[:count][::-1].copy()
            points = np.vstack((a, cells(smap, ways[i, j]), b))
            lengths_m[i, j] = np.hypot(*np.diff(points, axis=0).T).sum() * grid.spacing_m
    return lengths_m, lambda i, j: ways[i, j]


def _nearest_joins(places: Places) -> list[int]:
    """Return the nearest node by which each place joins the map, -1 for none."""
    best = np.argmin(np.where(places.nodes >= 0, places.off, np.inf), axis=1)
    return [int(node) for node in places.nodes[np.arange(len(best)), best]]


def warm_up_calls() -> list[Call]:
    """One call of every kernel that searches, types as in a plan."""
    grid = free_grid((2, 2), 10.0)
    smap = search_map(grid)
    size, node = smap.moves.size, flat_index(smap, (0, 0))
    nodes, off = np.full((1, 4), node), np.zeros((1, 4))
    xy, inside = np.zeros((1, 2)), np.zeros(1, np.bool_)
    path, field, came = np.empty(size, np.int64), np.zeros(size), np.full((1, size), NO_MOVE, np.uint8)
    entries, searched = np.empty((2 * size, 2), np.int32), kernel_arrays(smap)
    empty = np.zeros(size), smap.packed.copy(), entries, path
    return [
        (seek, *searched, smap.stride, nodes[0], off[0], nodes[0], off[0], *empty),
        (
            *(_ends_of_ways, grid.blocked, 0.0, xy, inside, xy, off, inside, np.zeros((1, 1, 4))),
            *(smap.any_near, smap.offsets, came, nodes, off, nodes),
        ),
        (costs_at, field, nodes, off),
        (trace_back, smap.offsets, came[0], node, path),
        (spread, *searched, nodes[0], off[0], nodes[0], field, came[0], empty[1], *room_to_work(smap)),
        (seek_paper, smap.moves, smap.near, smap.offsets, smap.stride, node, node, path),
    ]
