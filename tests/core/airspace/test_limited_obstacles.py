"""A user would see vehicles fly through an obstacle, or around one that is far below them."""

from itertools import pairwise

import numpy as np
import pytest
from helpers.staging import mission, zones
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.core.airspace.obstacle_map import LowFlight, mission_map
from gcs.core.replanning.mission_inputs import mission_inputs
from gcs.model import NoFlyZone, VerticalLimits, vertical_limits
from gcs.planning.map.line_of_sight import line_of_sight
from gcs.planning.planner import plan_mission

LAYERS = "[mission]\naltitude_rel_m = {low}\nlayers = {layers}\nlayer_step_m = 20.0\n"
WALL = "[[map.obstacles]]\nbox_m = [900.0, 100.0, 980.0, 1800.0]\n{limits}\n"
PLANNING = '[planning]\nshape = "flyable"\nclearance_m = 50.0\nvertical_clearance_m = {clearance}\n'


def toml(limits: VerticalLimits) -> str:
    keys = {"floor_m": limits.floor_m, "ceiling_m": limits.ceiling_m}
    lines = [f"{name} = {value!r}" for name, value in keys.items() if value is not None]
    return "\n".join([*lines, f'reference = "{limits.reference}"']) if lines else ""


def planned(limits: VerticalLimits, low=100.0, layers=1, clearance=20.0):
    """Return whether the route of a mission crosses a wall with these limits, and the config."""
    tables = LAYERS.format(low=low, layers=layers) + WALL.format(limits=toml(limits))
    tables += PLANNING.format(clearance=clearance)
    config = mission(agents=[(200.0, 1000.0)], births=[(1700.0, 1000.0)], tables=tables)
    wall = mission_map(mission(tables=WALL.format(limits="")), 0).grid
    (route,) = plan_mission(mission_inputs(config, mission_map(config, 0))).routes
    places = [(200.0, 1000.0), *map(tuple, route.points_m.tolist())]
    return not all(line_of_sight(wall, a, b) for a, b in pairwise(places))


HEIGHTS = st.integers(-200, 400).map(float)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.tuples(st.none() | HEIGHTS, st.none() | HEIGHTS),
    st.sampled_from(["home", "msl", "ground"]),
    st.sampled_from([60.0, 100.0]),
    st.sampled_from([1, 3]),
    st.sampled_from([0.0, 20.0]),
)
def test_a_route_crosses_an_obstacle_only_if_all_layers_keep_the_vertical_clearance(
    bounds_m, reference, low, layers, clearance
):
    """The frame's origin is 70 m above sea level."""
    try:
        limits = vertical_limits(None, *bounds_m, None if bounds_m == (None, None) else reference)
    except ValueError:
        return
    zero_m = 70.0 if reference == "msl" else 0.0
    floor_m, ceiling_m = np.array(limits.bounds_m) - zero_m
    high = low + 20.0 * (layers - 1)
    keeps_clear = ceiling_m <= low - clearance or floor_m >= high + clearance
    assert planned(limits, low, layers, clearance) is bool(keeps_clear)


def test_an_obstacle_is_flown_over_and_the_same_one_a_little_higher_flown_around():
    assert planned(VerticalLimits(None, 80.0))
    assert not planned(VerticalLimits(None, 80.5))
    assert planned(VerticalLimits(120.0, None, "home"))
    assert not planned(VerticalLimits(119.5, None, "home"))


def test_layers_begin_at_a_lower_take_off_altitude():
    """A vehicle climbs on along its route from there."""
    tables = WALL.format(limits="height_m = 60.0")
    assert not mission_map(mission(tables=tables), 0).grid.blocked.any()
    low = mission(tables=tables + "[takeoff]\naltitude_rel_m = 50.0\n")
    assert mission_map(low, 0).grid.blocked.any()


def test_obstacles_below_the_layers_block_climbs_and_what_is_above_them_does_not():
    tables = WALL.format(limits="height_m = 30.0")
    tables += '[[map.obstacles]]\ndisc_m = [400.0, 400.0, 90.0]\nfloor_m = 250.0\nreference = "home"\n'
    obstacles = mission_map(mission(tables=tables), 0)
    wall = mission_map(mission(tables=WALL.format(limits="")), 0).grid
    assert not obstacles.grid.blocked.any()
    assert (obstacles.near_ground.blocked == wall.blocked).all()


def test_flights_below_the_layers_meet_obstacles_only_where_they_are_too_low():
    """At a tenth of rise from the ground, 30 m and 20 m of clearance are reached after 500 m."""
    obstacles = mission_map(mission(tables=WALL.format(limits="height_m = 30.0")), 0)
    from_ground = obstacles.below_layers([LowFlight((200.0, 1000.0), 0.0, 0.0, 0.1)])
    assert not from_ground.blocked.any()
    nearer = obstacles.below_layers([LowFlight((500.0, 1000.0), 0.0, 0.0, 0.1)])
    rows, cols = np.nonzero(nearer.blocked)
    away_m = np.hypot(40.0 * cols - 500.0, 40.0 * rows - 1000.0)
    assert 500.0 - 30.0 <= away_m.max() <= 500.0 + 30.0
    assert obstacles.below_layers([]) is obstacles.grid


def test_a_closed_zone_blocks_at_its_heights():
    config = mission()
    closed = zones(config)
    change = closed.change(NoFlyZone("fire", (1000.0, 1000.0, 100.0), limits=VerticalLimits(None, 60.0)))
    assert not change.layers.blocked.any()
    assert change.below_layers(LowFlight((1000.0, 1000.0), 500.0, 30.0, 0.15)).blocked.any()
    assert not change.below_layers(LowFlight((1000.0, 20.0), 500.0, 30.0, 0.15)).blocked.any()
    assert not closed.contain((1000.0, 1000.0)), "a vehicle in its layer is above it"
    change = closed.change(NoFlyZone("fire", (1000.0, 1000.0, 100.0)))
    assert change.layers.blocked.any()
    assert closed.contain((1000.0, 1000.0))
    closed.change(NoFlyZone("fire"))
    assert not closed.grid.blocked.any()


@pytest.mark.parametrize(
    ("ceiling_msl_m", "zone_m", "expected"),
    [(150.0, 100.0, False), (170.5, 100.0, True), (400.0, 100.0, True)],
)
def test_an_incursion_is_one_at_the_height_of_the_zone(ceiling_msl_m, zone_m, expected):
    closed = zones(mission())
    closed.change(
        NoFlyZone("fire", (1000.0, 1000.0, zone_m), limits=VerticalLimits(None, ceiling_msl_m, "msl"))
    )
    start_m, end_m = (500.0, 1000.0), (1500.0, 1000.0)
    assert closed.closed["fire"].is_met(start_m, end_m, (170.0, 170.0)) is expected
    assert not closed.closed["fire"].is_met(start_m, (600.0, 1000.0), (100.0, 100.0))
