"""Whole plans: routes that can be flown, to whom they should go, and a reason wherever there is none."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.grid_paths import distances_m
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.config import load
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.model import Label, NoticeCode
from gcs.planning.forward_simulation import Motion
from gcs.planning.map.grid import Grid, free_grid, random_obstacles
from gcs.planning.map.line_of_sight import line_of_sight
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.plan_notes import PlanNote
from gcs.planning.planner_inputs import AgentState, PlanOptions, TargetDemand
from gcs.planning.team_routes import plan_routes

PLAIN = PlanOptions()
OPTIONS = st.builds(
    PlanOptions,
    shape=st.sampled_from(["grid", "pulled", "flyable"]),
    clearance_m=st.sampled_from([0.0, 15.0, 30.0]),
    switch_gain_m=st.sampled_from([0.0, 50.0]),
)


def plan(grid, agents, targets, current=None, options=PLAIN):
    starts = {v: a if isinstance(a, AgentState) else AgentState(*a) for v, a in agents.items()}
    return plan_routes(grid, starts, targets, current or {}, options)


@st.composite
def missions(draw, max_objects=5):
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    shape = draw(st.tuples(st.integers(1, 25), st.integers(1, 25)))
    grid = random_obstacles(
        free_grid(shape, 40.0, (-300.0, 70.0)), draw(st.sampled_from([0.0, 0.1, 0.2, 0.4, 1.0])), rng
    )
    size = 40.0 * np.array([shape[1], shape[0]])
    where = lambda: tuple(float(x) for x in np.array([-340.0, 30.0]) + rng.random(2) * (size + 40.0))  # noqa: E731
    course = st.one_of(st.none(), st.floats(-10.0, 10.0))
    agents = {v: AgentState(*where(), draw(course)) for v in range(1, draw(st.integers(0, max_objects)) + 1)}
    targets = {(draw(st.integers(0, 3)), i): where() for i in range(draw(st.integers(0, max_objects)))}
    pairs = zip(agents, draw(st.permutations(sorted(targets))), strict=False)
    return grid, agents, targets, dict(pairs)


@settings(max_examples=200)
@given(missions(), OPTIONS)
def test_every_leg_of_every_route_is_clear_of_obstacles(mission, options):
    grid, agents, targets, current = mission
    result = plan_routes(grid, agents, targets, current, options)
    for route in result.routes:
        start = (agents[route.vehicle].east_m, agents[route.vehicle].north_m)
        points = [tuple(p) for p in route.points_m.tolist()]
        if not grid.blocked[grid.node_of(start)]:
            points.insert(0, start)
        for a, b in itertools.pairwise(points):
            # Ends that lie on the edge of a cell to a rounding error are no business of this test.
            inner = (a[0] + 1e-6 * (b[0] - a[0]), a[1] + 1e-6 * (b[1] - a[1]))
            assert line_of_sight(grid, inner, b), (a, b)
            for t in np.linspace(0.001, 0.999, 200):
                point = (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]))
                assert not (grid.contains(point) and grid.blocked[grid.node_of(point)])


@settings(max_examples=200)
@given(missions(), OPTIONS)
def test_a_plan_accounts_for_everybody_and_its_lengths_are_true(mission, options):
    grid, agents, targets, current = mission
    result = plan_routes(grid, agents, targets, current, options)
    vehicles = [route.vehicle for route in result.routes]
    labels = [route.target for route in result.routes]
    assert vehicles == sorted(vehicles)
    assert sorted([*vehicles, *result.unassigned_vehicles]) == sorted(agents)
    assert sorted([*labels, *result.unassigned_targets]) == sorted(targets)
    if not result.routes:
        assert result.notes, "no vehicle flies, and no note says why"
    for route in result.routes:
        start = (agents[route.vehicle].east_m, agents[route.vehicle].north_m)
        legs = itertools.pairwise([start, *route.points_m.tolist()])
        if options.shape == "flyable":  # along its arcs, from the vehicle's course on
            assert route.length_m >= math.dist(start, route.points_m[-1]) - 1e-6
        else:
            assert route.length_m == pytest.approx(sum(math.dist(a, b) for a, b in legs), abs=1e-6)
        assert np.isfinite(route.points_m).all()
        if not grid.blocked[grid.node_of(targets[route.target])]:
            assert tuple(route.points_m[-1]) == grid.nearest_inside(targets[route.target])


@settings(max_examples=60)
@given(missions(), OPTIONS)
def test_the_same_mission_has_the_same_plan(mission, options):
    grid, agents, targets, current = mission
    other = Grid(grid.origin_m, grid.spacing_m, grid.blocked.copy())
    one = plan_routes(grid, agents, targets, current, options)
    two = plan_routes(
        other, dict(reversed(agents.items())), dict(reversed(targets.items())), current, options
    )
    assert repr(one) == repr(two)


@settings(max_examples=60)
@given(missions(max_objects=1))
def test_a_route_between_nodes_is_as_long_as_the_shortest_grid_path(mission):
    grid, agents, targets, _ = mission
    if not agents or not targets or grid.blocked.all():
        return
    (vehicle, agent), (label, target) = *agents.items(), *targets.items()
    start, goal = grid.node_of((agent.east_m, agent.north_m)), grid.node_of(target)
    if grid.blocked[start] or grid.blocked[goal]:
        return
    on_node = plan(grid, {vehicle: grid.point_of(start)}, {label: grid.point_of(goal)})
    best = distances_m(grid, start)[goal]
    pulled = plan(
        grid, {vehicle: grid.point_of(start)}, {label: grid.point_of(goal)}, None, PlanOptions(shape="pulled")
    )
    assert [r.length_m for r in on_node.routes] == ([pytest.approx(best)] if math.isfinite(best) else [])
    for route in pulled.routes:
        assert math.dist(grid.point_of(start), grid.point_of(goal)) - 1e-6 <= route.length_m <= best + 1e-6


def test_no_agent_is_sent_back_to_a_node_that_it_has_passed():
    """At 12 m past a node and flying east, the route goes on east."""
    grid = free_grid((51, 51), 40.0)
    for past_m in (1.0, 12.0, 25.0, 39.0):
        (route,) = plan(grid, {1: (400.0 + past_m, 801.0, math.pi / 2)}, {(0, 0): (1800.0, 800.0)}).routes
        assert route.points_m[0][0] > 400.0 + past_m


@settings(max_examples=60)
@given(
    st.tuples(st.floats(300.0, 700.0), st.floats(300.0, 1700.0)),
    st.tuples(st.floats(1200.0, 1700.0), st.floats(300.0, 1700.0)),
)
def test_no_leg_in_the_open_is_too_short_to_be_flown(start, goal):
    """Neither to a node next to the agent, nor from a node next to the target."""
    (route,) = plan(free_grid((51, 51), 40.0), {1: start}, {(0, 0): goal}).routes
    corners = [start, *(tuple(p) for p in route.points_m.tolist())]
    assert math.dist(corners[0], corners[1]) >= 40.0
    assert math.dist(corners[-2], corners[-1]) >= 40.0


@settings(max_examples=60)
@given(st.floats(300.0, 700.0), st.floats(300.0, 1700.0), st.floats(-math.pi, math.pi))
def test_a_turn_in_the_open_is_not_made_to_a_node_right_behind_the_agent(east_m, north_m, course_rad):
    (route,) = plan(
        free_grid((51, 51), 40.0), {1: (east_m, north_m, course_rad)}, {(0, 0): (1700.0, 900.0)}
    ).routes
    dx, dy = route.points_m[0] - (east_m, north_m)
    assert math.hypot(dx, dy) >= 80.0 or dx * math.sin(course_rad) + dy * math.cos(course_rad) >= 0.0


def test_the_nearer_agent_gets_the_target_even_if_it_has_just_passed_a_node():
    grid = free_grid((51, 51), 40.0)
    agents = {1: (401.0, 800.0), 2: (415.0, 800.0)}
    assert [r.vehicle for r in plan(grid, agents, {(0, 0): (1800.0, 800.0)}).routes] == [2]


def test_points_in_a_line_are_one_leg():
    (route,) = plan(free_grid((51, 51), 40.0), {1: (0.0, 400.0)}, {(0, 0): (1800.0, 400.0)}).routes
    assert route.points_m.tolist() == [[1800.0, 400.0]]


def test_pulling_the_string_shortens_the_way_and_leaves_fewer_corners():
    grid_length, pulled_length, grid_corners, pulled_corners = 0.0, 0.0, 0, 0
    for seed in range(20):
        places = [(0.0, 400.0), (2000.0, 1500.0)]
        grid = random_obstacles(free_grid((51, 51), 40.0), 0.15, np.random.default_rng(seed), places, 120.0)
        for shape in ("grid", "pulled"):
            (route,) = plan(grid, {1: places[0]}, {(0, 0): places[1]}, None, PlanOptions(shape=shape)).routes
            if shape == "grid":
                grid_length, grid_corners = grid_length + route.length_m, grid_corners + len(route.points_m)
            else:
                pulled_length, pulled_corners = (
                    pulled_length + route.length_m,
                    pulled_corners + len(route.points_m),
                )
    assert pulled_length < 0.96 * grid_length
    assert pulled_corners < 0.55 * grid_corners


@pytest.mark.parametrize("shape", ["grid", "pulled"])
def test_a_clearance_is_kept_where_there_is_a_way_that_keeps_it(shape):
    grid = free_grid((31, 31), 40.0).with_obstacles(boxes_m=[(380.0, 0.0, 500.0, 700.0)], cells=[(25, 20)])
    result = plan(grid, {1: (100.0, 300.0)}, {(0, 0): (900.0, 300.0)}, None, PlanOptions(shape, 55.0))
    (route,) = result.routes
    points = [(100.0, 300.0), *(tuple(p) for p in route.points_m.tolist())]
    assert all(line_of_sight(grid, a, b, 55.0) for a, b in itertools.pairwise(points))
    assert result.notes == ()


def test_without_a_clear_route_the_tight_one_is_flown_with_a_note():
    grid = free_grid((21, 21), 40.0).with_obstacles(cells=[(row, 10) for row in range(21) if row != 4])
    result = plan(grid, {1: (0.0, 400.0)}, {(0, 0): (800.0, 400.0)}, None, PlanOptions(clearance_m=30.0))
    assert len(result.routes) == 1
    assert (
        PlanNote(NoticeCode.ROUTE_NEAR_OBSTACLES, 1, {"target": "T0.0", "clearance_m": 30.0}) in result.notes
    )


def test_an_agent_inside_an_obstacle_leaves_it_and_the_notes_say_so():
    grid = free_grid((11, 11), 40.0).with_obstacles(cells=[(5, 5)])
    result = plan(grid, {1: (210.0, 200.0)}, {(0, 0): (400.0, 200.0)})
    assert result.routes[0].points_m[-1].tolist() == [400.0, 200.0]
    assert [(note.code, note.vehicle) for note in result.notes] == [(NoticeCode.INSIDE_OBSTACLE, 1)]


def test_a_target_over_an_obstacle_is_approached_to_the_nearest_free_node():
    grid = free_grid((11, 11), 40.0).with_obstacles(cells=[(5, 5)])
    result = plan(grid, {1: (0.0, 200.0)}, {(0, 0): (192.0, 201.0)})
    assert result.routes[0].points_m[-1].tolist() == [160.0, 200.0]
    assert NoticeCode.TARGET_OVER_OBSTACLE in {note.code for note in result.notes}


def test_behind_a_closed_wall_there_is_no_path_and_the_others_still_fly():
    grid = free_grid((11, 11), 40.0).with_obstacles(cells=[(row, 5) for row in range(11)])
    result = plan(grid, {1: (0.0, 0.0), 2: (0.0, 400.0), 3: (400.0, 0.0)}, {(0, 0): (80.0, 80.0)})
    assert [r.vehicle for r in result.routes] == [1]
    assert result.unassigned_vehicles == (2, 3)
    assert result.notes == (PlanNote(NoticeCode.NO_PATH_TO_TARGETS, 3),)


@pytest.mark.parametrize("cost", ["metric", "paper"])
def test_an_enclosed_target_is_left_out_and_named(cost):
    ring = [(r, c) for r in range(4, 7) for c in range(4, 7) if (r, c) != (5, 5)]
    grid = free_grid((11, 11), 40.0).with_obstacles(cells=ring)
    targets = {(0, 0): (200.0, 200.0), (0, 1): (400.0, 400.0)}
    result = plan(grid, {1: (0.0, 0.0)}, targets, {1: (0, 0)}, PlanOptions(cost, switch_gain_m=1e6))
    assert [r.target for r in result.routes] == [(0, 1)]
    assert result.notes == (PlanNote(NoticeCode.NO_PATH_FROM_AGENTS, None, {"target": "T0.0"}),)


def test_a_plan_without_agents_has_a_note():
    grid = free_grid((3, 3), 40.0)
    assert [note.code for note in plan(grid, {}, {}).notes] == [NoticeCode.NO_AGENTS, NoticeCode.NO_TARGETS]
    assert plan(grid, {1: (0.0, 0.0)}, {}).unassigned_vehicles == (1,)
    assert plan(grid, {}, {(0, 0): (0.0, 0.0)}).unassigned_targets == ((0, 0),)


@pytest.mark.parametrize("absurd", [math.nan, math.inf, -1e300])
def test_an_estimate_that_is_no_place_is_left_out_and_named(absurd):
    result = plan(
        free_grid((3, 3), 40.0),
        {1: (absurd, 0.0), 2: (0.0, 0.0)},
        {(0, 0): (80.0, 80.0), (0, 1): (0.0, absurd)},
    )
    assert [r.vehicle for r in result.routes] == [2]
    assert result.unassigned_vehicles == (1,)
    assert result.unassigned_targets == ((0, 1),)
    assert [(note.code, note.vehicle) for note in result.notes] == [
        (NoticeCode.AGENT_NOT_ON_EARTH, 1),
        (NoticeCode.TARGET_NOT_ON_EARTH, None),
    ]


def test_maps_of_one_node_and_without_a_free_one_do_not_stop_the_planner():
    agents, targets = {1: (3.0, 4.0)}, {(0, 0): (0.0, 0.0)}
    (route,) = plan(free_grid((1, 1), 40.0), agents, targets).routes
    assert (route.points_m.tolist(), route.length_m) == ([[0.0, 0.0]], 5.0)
    full = plan(Grid((0.0, 0.0), 40.0, np.ones((1, 1), dtype=bool)), agents, targets)
    assert (full.routes, full.notes) == ((), (PlanNote(NoticeCode.NO_FREE_CELL),))


def test_agents_keep_their_targets_unless_the_swarm_gains():
    grid = free_grid((51, 51), 40.0)
    agents = {1: (0.0, 400.0), 2: (0.0, 440.0)}
    targets = {(0, 0): (1600.0, 440.0), (0, 1): (1600.0, 400.0)}
    crossed = {1: (0, 0), 2: (0, 1)}
    patient = plan(grid, agents, targets, crossed, PlanOptions(switch_gain_m=50.0))
    assert {r.vehicle: r.target for r in patient.routes} == crossed
    agents[2], targets[0, 0] = (0.0, 800.0), (1600.0, 800.0)
    better = plan(grid, agents, targets, {1: (0, 0), 2: (0, 1)}, PlanOptions(switch_gain_m=50.0))
    assert {r.vehicle: r.target for r in better.routes} == {1: (0, 1), 2: (0, 0)}


def test_one_target_that_moved_in_a_swarm_of_fifty_sends_few_agents_elsewhere():
    """The optimum of `swarm-50` gives 17 agents other targets, to save less than 0.1 % of the way."""
    config = load("swarm-50")
    grid, options = mission_grid(config, 1), PlanOptions(clearance_m=20.0, switch_gain_m=50.0, shape="pulled")
    agents = {agent.vehicle: (agent.east_m, agent.north_m) for agent in config.agents}
    targets = {(0, i): (birth.east_m, birth.north_m) for i, birth in enumerate(config.births)}
    flown = {r.vehicle: r.target for r in plan(grid, agents, targets, {}, options).routes}
    targets[0, 52] = (targets[0, 52][0], targets[0, 52][1] - 400.0)
    result = plan(grid, agents, targets, flown, options)
    assert sum(flown[r.vehicle] != r.target for r in result.routes) <= 3
    best = plan(grid, agents, targets, {}, options)
    assert sum(result.grid_lengths_m.values()) <= 1.02 * sum(best.grid_lengths_m.values())


def test_active_agents_take_the_targets_of_a_lost_agent():
    grid = free_grid((51, 51), 40.0)
    targets = {(0, 0): (1600.0, 400.0), (0, 1): (1600.0, 800.0)}
    result = plan(grid, {2: (0.0, 800.0)}, targets, {1: (0, 0), 2: (0, 1)}, PlanOptions(switch_gain_m=50.0))
    assert [(r.vehicle, r.target) for r in result.routes] == [(2, (0, 1))]
    assert result.unassigned_targets == ((0, 0),)


def test_a_loop_on_to_the_route_never_leads_through_the_obstacle_that_its_agent_came_out_of():
    """It starts inside a blocked cell, heading away: the way back would cross the cell once more."""
    grid = Grid((-300.0, 70.0), 40.0, np.array([[False, False, False, True, False]]))
    result = plan(
        grid, {1: (-165.1, 45.0, 0.0)}, {(0, 0): (-182.2, 75.0)}, None, PlanOptions(shape="flyable")
    )
    points = [tuple(p) for p in result.routes[0].points_m.tolist()]
    assert all(line_of_sight(grid, a, b) for a, b in itertools.pairwise(points))
    assert NoticeCode.TIGHTEST_TURN in {note.code for note in result.notes}


@pytest.mark.parametrize("horizon_s", [0.0, 60.0])
def test_a_captured_route_is_the_shorter_one_that_a_plan_without_a_course_has(horizon_s):
    """A vehicle would fly a circle of an explicit first turn that it does not need."""
    turns = TurnAnticipation(40.0, 15.0, 10.0)
    options = PlanOptions(shape="flyable", clearance_m=15.0, horizon_s=horizon_s, turns=turns, turn_lag_s=1.0)
    found = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        grid = random_obstacles(free_grid((25, 25), 40.0), 0.06, rng)
        agents = {
            v: AgentState(east, north, course, motion=Motion(east, north, 15.0, course))
            for v in range(4)
            for east, north, course in [(*rng.uniform(100.0, 900.0, 2).tolist(), rng.uniform(-3.0, 3.0))]
        }
        targets = {(0, n): tuple(rng.uniform(100.0, 900.0, 2).tolist()) for n in range(4)}
        demands = {label: TargetDemand((3.0, -1.0)) for label in targets}
        result = plan_routes(grid, agents, targets, {}, options, demands=demands)
        lengths_m = {route.vehicle: route.length_m for route in result.routes}
        for vehicle, route in result.captured.items():
            starts = {vehicle: replace(agents[vehicle], course_rad=None)}
            place = {route.target: targets[route.target]}
            (plain,) = plan_routes(grid, starts, place, {}, options, demands=demands).routes
            assert np.array_equal(plain.points_m, route.points_m)
            assert route.length_m < lengths_m[vehicle]
            found += 1
    assert found >= 3


def with_pins(agents: dict[int, AgentState], pins: dict[int, Label]) -> dict[int, AgentState]:
    return {vehicle: replace(agent, pinned=pins.get(vehicle)) for vehicle, agent in agents.items()}


def test_a_pinned_agent_gets_its_target_and_others_make_room() -> None:
    grid = free_grid((50, 50), 10.0)
    agents = {1: AgentState(0.0, 0.0), 2: AgentState(0.0, 100.0), 3: AgentState(0.0, 200.0)}
    targets = {(0, k): (300.0, 100.0 * k) for k in range(3)}
    free = plan_routes(grid, agents, targets, {}, PlanOptions())
    assert [route.target[1] for route in free.routes] == [0, 1, 2]
    held = plan_routes(grid, with_pins(agents, {1: (0, 2)}), targets, {}, PlanOptions())
    assert {route.vehicle: route.target[1] for route in held.routes}[1] == 2
    assert sorted(route.target[1] for route in held.routes) == [0, 1, 2]
    both = plan_routes(grid, with_pins(agents, {1: (0, 2), 2: (0, 2), 3: (9, 9)}), targets, {}, PlanOptions())
    assert len({route.target for route in both.routes}) == len(both.routes) == 2


def test_a_pin_without_a_path_changes_nothing() -> None:
    grid = free_grid((50, 50), 10.0).with_obstacles(boxes_m=[(280.0, 180.0, 320.0, 220.0)])
    agents = {1: AgentState(0.0, 0.0), 2: AgentState(0.0, 100.0)}
    targets = {(0, 0): (300.0, 0.0), (0, 1): (300.0, 100.0)}
    free = plan_routes(grid, agents, targets, {}, PlanOptions())
    assert plan_routes(grid, with_pins(agents, {1: (5, 5)}), targets, {}, PlanOptions()).routes[0].target == (
        free.routes[0].target
    )


# ---------------------------------------------------------------- vehicles that should not get a target

NEAR, FAR = (0, 0), (0, 1)
FIELD = free_grid((26, 26), 40.0, (0.0, 0.0))


def served(result):
    return {route.vehicle: route.target for route in result.routes}


def test_a_spare_in_the_air_goes_before_a_vehicle_on_the_ground_however_near_that_is():
    agents = {1: AgentState(100.0, 100.0, is_grounded=True), 2: AgentState(900.0, 900.0)}
    assert served(plan(FIELD, agents, {NEAR: (140.0, 100.0)}, {1: NEAR})) == {2: NEAR}
    both = {NEAR: (140.0, 100.0), FAR: (900.0, 100.0)}
    assert sorted(served(plan(FIELD, agents, both))) == [1, 2]  # nothing is left out for it


def test_an_unfit_vehicle_keeps_its_target_only_while_no_other_can_take_it():
    agents = {1: AgentState(100.0, 100.0, is_unfit=True), 2: AgentState(900.0, 900.0)}
    assert served(plan(FIELD, agents, {NEAR: (140.0, 100.0)}, {1: NEAR})) == {2: NEAR}
    both = {NEAR: (140.0, 100.0), FAR: (900.0, 100.0)}
    assert served(plan(FIELD, agents, both, {1: NEAR, 2: FAR})) == {1: NEAR, 2: FAR}
    assert served(plan(FIELD, {1: agents[1]}, {FAR: (900.0, 100.0)})) == {}


def test_a_vehicle_gets_no_target_from_which_it_could_not_return():
    low = AgentState(500.0, 100.0, home_m=(100.0, 100.0), range_m=900.0)
    assert served(plan(FIELD, {1: low}, {FAR: (900.0, 900.0)})) == {}
    assert served(plan(FIELD, {1: low}, {NEAR: (540.0, 140.0)})) == {1: NEAR}
