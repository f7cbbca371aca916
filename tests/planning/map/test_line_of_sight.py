"""Line of sight: a leg that is reported clear is clear at every point."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.jit import kernel
from gcs.planning.map.grid import TOUCH, Grid, free_grid
from gcs.planning.map.line_of_sight import blocking_cell, clear_leg, is_clear_at, leg_clearance, line_of_sight

COORD = st.one_of(st.floats(-1.5, 9.5), st.integers(-3, 19).map(lambda k: k / 2))
POINT = st.tuples(COORD, COORD)


def least_gap(grid, a, b, samples=4001):
    """Distance of a densely sampled leg from the nearest blocked square."""
    along = np.linspace(0.0, 1.0, samples)[:, None]
    points = np.array(a) + along * (np.array(b) - np.array(a))
    rows, cols = np.nonzero(grid.blocked)
    if not len(rows):
        return np.inf
    return np.hypot(
        np.maximum(abs(points[:, :1] - cols) - 0.5, 0.0), np.maximum(abs(points[:, 1:] - rows) - 0.5, 0.0)
    ).min()


def random_map(seed, density):
    return Grid((0.0, 0.0), 1.0, np.random.default_rng(seed).random((9, 9)) < density)


@settings(max_examples=300)
@given(
    st.integers(0, 2**32),
    st.sampled_from([0.03, 0.1, 0.3]),
    POINT,
    POINT,
    st.sampled_from([0.0, 0.25, 0.5, 1.3, 3.0]),
)
def test_sight_is_what_dense_sampling_sees(seed, density, a, b, clearance):
    grid = random_map(seed, density)
    gap = least_gap(grid, a, b)
    seen = line_of_sight(grid, a, b, clearance)
    step = np.hypot(b[0] - a[0], b[1] - a[1]) / 4000
    if seen:
        assert gap > 0.0
        assert gap >= clearance - 1e-6
    else:
        assert gap < clearance + step + 1e-6


@settings(max_examples=100)
@given(st.integers(0, 2**32), POINT, POINT, st.floats(0.0, 2.0))
def test_sight_is_mutual(seed, a, b, clearance):
    grid = random_map(seed, 0.1)
    assert line_of_sight(grid, a, b, clearance) == line_of_sight(grid, b, a, clearance)


def test_a_leg_that_is_next_to_none_sees_as_a_place_does():
    """Its length squared is 0 in a float: the obstacle three cells off is no farther for that."""
    grid = free_grid((9, 9), 1.0).with_obstacles(cells=[(0, 3)])
    for clearance, seen in ((2.0, True), (3.0, False)):
        assert line_of_sight(grid, (0.0, 0.0), (0.0, 1e-175), clearance) == seen


def test_a_leg_that_touches_a_corner_is_not_clear():
    """Between two obstacles that meet at a corner there is no way through, however thin the aeroplane."""
    grid = free_grid((2, 2), 1.0).with_obstacles(cells=[(0, 1), (1, 0)])
    assert not line_of_sight(grid, (0.0, 0.0), (1.0, 1.0))


def test_a_leg_along_a_row_next_to_an_obstacle_has_half_a_cell():
    grid = free_grid((3, 9), 40.0).with_obstacles(cells=[(1, col) for col in range(2, 7)])
    assert line_of_sight(grid, (0.0, 0.0), (320.0, 0.0), 20.0)
    assert not line_of_sight(grid, (0.0, 0.0), (320.0, 0.0), 20.001)
    assert not line_of_sight(grid, (0.0, 20.0), (320.0, 20.0))


def test_a_place_inside_an_obstacle_sees_nothing_not_even_itself():
    grid = free_grid((3, 3), 1.0).with_obstacles(cells=[(1, 1)])
    assert not line_of_sight(grid, (1.0, 1.0), (1.0, 1.0))
    assert line_of_sight(grid, (0.0, 0.0), (0.0, 0.0))


def test_beyond_the_maps_edge_the_view_is_free():
    grid = free_grid((3, 3), 1.0).with_obstacles(cells=[(0, 0)])
    assert line_of_sight(grid, (-5.0, -2.0), (9.0, -2.0), 1.0)
    assert not line_of_sight(grid, (-5.0, -2.0), (9.0, -2.0), 1.6)


@kernel
def check_leg(blocked, x0, y0, x1, y1, reach, own, guesses):
    """Return clearance of a leg, whether its first place is clear, and the blocking cell by each guess."""
    found = np.empty(guesses.size, np.int64)
    for k in range(guesses.size):
        found[k] = blocking_cell(blocked, x0, y0, x1, y1, reach, own, guesses[k])
    clear_to = leg_clearance(blocked, x0, y0, x1, y1, reach + 1.0, own)
    return clear_to, is_clear_at(blocked, x0, y0, reach), found


@settings(max_examples=150)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.3, 0.625, 1.4]), st.booleans())
def test_sight_is_that_of_every_cell_measured_whatever_is_guessed_to_be_in_the_way(seed, reach, is_point):
    rng = np.random.default_rng(seed)
    blocked = rng.random((12, 15)) < 0.2
    x0, y0, x1, y1 = (
        np.round(rng.uniform(-2.0, 16.0, 4) * 4.0) / 4.0 if seed % 2 else rng.uniform(-2.0, 16.0, 4)
    )
    if is_point:
        x1, y1 = x0, y0
    cells = np.flatnonzero(blocked)
    own = int(rng.choice(cells)) if cells.size and seed % 3 == 0 else -1
    guesses = np.array([-1, *cells[:: max(1, cells.size // 8)].tolist()])
    clear_to, is_clear, found = check_leg(blocked, x0, y0, x1, y1, reach, own, guesses)
    clear = clear_to >= max(reach - TOUCH, TOUCH)
    assert clear_leg(blocked, x0, y0, x1, y1, reach, own) == clear
    assert ((found < 0) == clear).all()
    assert (blocked.ravel()[found] & (found != own))[found >= 0].all()
    if is_point and own < 0:
        assert is_clear == clear
