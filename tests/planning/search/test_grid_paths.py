"""Shortest paths on the grid, against a plain A* and against scipy's Dijkstra."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from helpers.grid_paths import distances_m, find_path, nearest_free
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from gcs.planning.map.grid import Grid, free_grid, random_obstacles
from gcs.planning.search.astar import astar
from gcs.planning.search.grid_search import borrow_search
from gcs.planning.search.neighbours import flat_index, search_map

MOVES = [m for m in itertools.product((-1, 0, 1), repeat=2) if m != (0, 0)]


def neighbours(blocked, node):
    row, col = node
    rows, cols = blocked.shape
    for dr, dc in MOVES:
        r, c = row + dr, col + dc
        if 0 <= r < rows and 0 <= c < cols and not (blocked[r, c] or blocked[row, c] or blocked[r, col]):
            yield (r, c), math.hypot(dr, dc)


def scipy_distances(blocked, source):
    rows, cols = blocked.shape
    edges = [
        (r * cols + c, t[0] * cols + t[1], step)
        for r in range(rows)
        for c in range(cols)
        if not blocked[r, c]
        for t, step in neighbours(blocked, (r, c))
    ]
    i, j, w = zip(*edges, strict=True) if edges else ((), (), ())
    graph = coo_matrix((w, (i, j)), shape=(rows * cols, rows * cols)).tocsr()
    return dijkstra(graph, indices=source[0] * cols + source[1]).reshape(rows, cols)


@st.composite
def maps(draw, max_side=14):
    shape = draw(st.tuples(st.integers(1, max_side), st.integers(1, max_side)))
    density = draw(st.sampled_from([0.0, 0.1, 0.2, 0.3, 0.45, 0.6]))
    seed = draw(st.integers(0, 2**32 - 1))
    return np.random.default_rng(seed).random(shape) < density


def node_in(data, blocked):
    return data.draw(st.tuples(st.integers(0, blocked.shape[0] - 1), st.integers(0, blocked.shape[1] - 1)))


@settings(max_examples=150)
@given(maps(), st.data())
def test_distances_to_all_nodes_are_those_of_dijkstra(blocked, data):
    source = node_in(data, blocked)
    blocked[source] = False
    found = distances_m(Grid((0.0, 0.0), 40.0, blocked), source)
    np.testing.assert_allclose(found, 40.0 * scipy_distances(blocked, source), rtol=0, atol=1e-6)


@settings(max_examples=150)
@given(maps(), st.data())
def test_a_path_is_as_short_as_the_map_allows_and_legal_move_by_move(blocked, data):
    start = node_in(data, blocked)
    goal = node_in(data, blocked)
    blocked[start] = blocked[goal] = False
    grid = Grid((0.0, 0.0), 1.0, blocked)
    path = find_path(grid, start, goal)
    smap = search_map(grid)
    _, best = astar(smap, flat_index(smap, start), flat_index(smap, goal))
    if path is None:
        assert best == math.inf
        return
    nodes = [tuple(node) for node in path.nodes.tolist()]
    assert (nodes[0], nodes[-1]) == (start, goal)
    steps = [dict(neighbours(blocked, a)).get(b) for a, b in itertools.pairwise(nodes)]
    assert None not in steps, "a move that is none, hits an obstacle or cuts a corner"
    assert path.length_m == pytest.approx(best, abs=1e-9) == sum(steps)


@settings(max_examples=150)
@given(maps(), st.data())
def test_a_path_with_clearance_costs_as_little_as_that_of_the_plain_form(blocked, data):
    ends = [node_in(data, blocked), node_in(data, blocked)]
    for end in ends:
        blocked[end] = False
    grid = Grid((0.0, 0.0), 40.0, blocked)
    smap = search_map(grid, 50.0)
    start, goal = (flat_index(smap, end) for end in ends)
    plain, best = astar(smap, start, goal)
    at_node = np.zeros(1)
    with borrow_search(grid, 50.0) as search:
        nodes, cost, _, _ = search.path(np.array([start]), at_node, np.array([goal]), at_node)
    assert cost == pytest.approx(best, abs=1e-9)
    assert (len(nodes) == 0) == (not plain)


@settings(max_examples=50)
@given(maps(), st.data())
def test_the_plain_form_has_the_distance_of_dijkstra(blocked, data):
    start = node_in(data, blocked)
    goal = node_in(data, blocked)
    blocked[start] = blocked[goal] = False
    smap = search_map(Grid((0.0, 0.0), 1.0, blocked))
    nodes, cost = astar(smap, flat_index(smap, start), flat_index(smap, goal))
    assert cost == pytest.approx(scipy_distances(blocked, start)[goal], abs=1e-9)
    assert [*nodes[:1], *nodes[-1:]] == ([flat_index(smap, start), flat_index(smap, goal)] if nodes else [])


def test_a_path_does_not_squeeze_between_two_obstacles_that_meet_at_a_corner():
    blocked = np.array([[0, 1], [1, 0]], dtype=bool)
    assert find_path(Grid((0.0, 0.0), 1.0, blocked), (0, 0), (1, 1)) is None
    blocked = np.array([[0, 1], [0, 0]], dtype=bool)
    path = find_path(Grid((0.0, 0.0), 1.0, blocked), (0, 0), (1, 1))
    assert path is not None
    assert path.length_m == 2.0


def test_a_wall_without_a_gap_is_no_way_rather_than_a_way_through():
    grid = free_grid((7, 7), 40.0).with_obstacles(cells=[(row, 3) for row in range(7)])
    assert find_path(grid, (3, 0), (3, 6)) is None
    assert np.isinf(distances_m(grid, (3, 0))[:, 3:]).all()


def test_clearance_is_kept_where_possible_and_given_up_where_not():
    """Two gaps in a wall: the wide one is a detour, the narrow one straight ahead."""
    wall = [(row, 8) for row in range(17) if row != 8 and row not in (14, 15, 16)]
    grid = free_grid((17, 17), 40.0).with_obstacles(cells=wall)
    plain = find_path(grid, (8, 2), (8, 14))
    careful = find_path(grid, (8, 2), (8, 14), clearance_m=25.0)
    assert plain is not None
    assert careful is not None
    assert plain.length_m == 12 * 40.0
    assert {tuple(n) for n in careful.nodes.tolist()} & {(15, 8), (16, 8)}
    assert not grid.inflate(25.0).blocked[careful.nodes[:, 0], careful.nodes[:, 1]].any()
    closed = grid.with_obstacles(cells=[(14, 8), (15, 8), (16, 8)])
    squeezed = find_path(closed, (8, 2), (8, 14), clearance_m=25.0)
    assert squeezed is not None
    assert (8, 8) in {tuple(n) for n in squeezed.nodes.tolist()}


def test_an_end_inside_an_obstacle_is_replaced_by_the_nearest_free_node():
    grid = free_grid((5, 5), 1.0).with_obstacles(cells=[(2, 2), (2, 1)])
    assert nearest_free(grid, (2, 2)) == (1, 2)
    path = find_path(grid, (2, 2), (4, 4))
    assert path is not None
    assert tuple(path.nodes[0]) == (1, 2)


def test_an_end_inside_an_obstacle_is_not_left_into_a_pocket():
    """(2, 2) is free and nearest to (2, 3), but walled in: from there nothing can be reached."""
    ring = [(1, 1), (1, 2), (1, 3), (2, 1), (2, 3), (3, 1), (3, 2), (3, 3)]
    grid = free_grid((7, 9), 1.0).with_obstacles(cells=ring)
    assert nearest_free(grid, (2, 3)) == (2, 4)


def test_a_map_without_a_free_node_has_no_way():
    full = Grid((0.0, 0.0), 1.0, np.ones((3, 3), dtype=bool))
    assert nearest_free(full, (1, 1)) is None
    assert find_path(full, (0, 0), (2, 2)) is None
    assert np.isinf(distances_m(full, (0, 0))).all()


def test_a_map_of_one_node():
    path = find_path(free_grid((1, 1), 1.0), (0, 0), (0, 0))
    assert path is not None
    assert path.length_m == 0.0
    assert path.nodes.tolist() == [[0, 0]]


@settings(max_examples=30)
@given(hnp.arrays(bool, (12, 12)), st.data())
def test_the_same_question_has_the_same_answer(blocked, data):
    start = node_in(data, blocked)
    goal = node_in(data, blocked)
    one = find_path(Grid((0.0, 0.0), 1.0, blocked), start, goal)
    two = find_path(Grid((0.0, 0.0), 1.0, blocked.copy()), start, goal)
    assert (one is None) == (two is None)
    if one is not None and two is not None:
        assert one.nodes.tolist() == two.nodes.tolist()


@pytest.mark.parametrize("density", [0.1, 0.2, 0.3])
def test_long_ways_on_a_big_map_stay_exact(density):
    grid = random_obstacles(free_grid((90, 110), 40.0), density, np.random.default_rng(7), [(0.0, 0.0)], 1.0)
    found = distances_m(grid, (0, 0))
    np.testing.assert_allclose(found, 40.0 * scipy_distances(grid.blocked, (0, 0)), rtol=0, atol=1e-6)
