"""Vehicles would fly into obstacles that are elsewhere on the map of the plan."""

import math

import numpy as np
from helpers.staging import mission

from gcs.core.airspace.obstacle_map import mission_grid


def test_a_seed_means_one_map_and_keeps_starts_and_births_clear():
    config = mission(tables="[map]\nrandom_threshold = 0.2\n")
    maps = [mission_grid(config, seed) for seed in (1, 1, 2)]
    assert np.array_equal(maps[0].blocked, maps[1].blocked)
    assert not np.array_equal(maps[0].blocked, maps[2].blocked)
    assert 0.15 < maps[0].blocked.mean() < 0.22
    for row, col in np.argwhere(maps[0].blocked).tolist():
        place = maps[0].point_of((row, col))
        for thing in (*config.agents, *config.births):
            assert math.dist(place, (thing.east_m, thing.north_m)) > 120.0


def test_obstacles_placed_by_hand_are_on_the_map_at_their_place():
    tables = "[map]\ndiscs_m = [[1000.0, 400.0, 50.0]]\nboxes_m = [[0.0, 1900.0, 80.0, 2000.0]]\n"
    grid = mission_grid(mission(tables=tables), 0)
    assert (grid.shape, grid.spacing_m, grid.origin_m) == ((51, 51), 40.0, (0.0, 0.0))
    assert grid.blocked[grid.node_of((1000.0, 400.0))]
    assert grid.blocked[grid.node_of((40.0, 1950.0))]
    assert not grid.blocked[grid.node_of((400.0, 1000.0))]
