"""Agents meet moving targets as early as possible; uncertain velocities do not mislead them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from gcs.model import Track, read_only
from gcs.planning.intercept import TargetPrediction, intercept_times, shrunk_velocity
from gcs.planning.map.grid import free_grid, random_obstacles
from gcs.planning.planner_inputs import AgentState, PlanOptions, TargetDemand
from gcs.planning.team_routes import plan_routes

OPEN = free_grid((101, 101), 40.0)
SPEED_M_S = 15.0
LABEL = (0, 0)


def route_to(grid, agent, target, velocity, horizon_s=200.0, shape="pulled"):
    options = PlanOptions(shape=shape, horizon_s=horizon_s)
    demands = {LABEL: TargetDemand(velocity)}
    result = plan_routes(grid, {1: AgentState(*agent)}, {LABEL: target}, {}, options, demands=demands)
    return result.routes[0]


def earliest_s(agent, target, velocity, speed_m_s=SPEED_M_S):
    """When an agent meets a target on open ground: the root of |d + v t| = s t."""
    dx, dy = target[0] - agent[0], target[1] - agent[1]
    a = velocity[0] ** 2 + velocity[1] ** 2 - speed_m_s**2
    b, c = 2.0 * (dx * velocity[0] + dy * velocity[1]), dx * dx + dy * dy
    return (-b - math.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)


@settings(max_examples=150)
@given(st.integers(0, 2**32))
def test_on_open_ground_the_meeting_is_the_one_of_the_textbook(seed):
    rng = np.random.default_rng(seed)
    agent, target = rng.uniform(1000, 3000, 2), rng.uniform(1000, 3000, 2)
    course, share = rng.uniform(0, 2 * math.pi), rng.uniform(0.1, 0.9)
    velocity = (share * SPEED_M_S * math.sin(course), share * SPEED_M_S * math.cos(course))
    meeting_s = earliest_s(agent, target, velocity)
    place = target + np.array(velocity) * meeting_s
    assume(meeting_s < 180.0 and place.min() > 0 and place.max() < 4000)

    route = route_to(OPEN, tuple(agent), tuple(target), velocity)

    arrival_s = route.length_m / SPEED_M_S
    assert np.hypot(*(target + np.array(velocity) * arrival_s - route.points_m[-1])) < 10.0
    assert abs(arrival_s - meeting_s) * SPEED_M_S * (1.0 - share) < 10.0


@settings(max_examples=60)
@given(st.integers(0, 2**32))
@example(1104532)
def test_around_obstacles_the_target_is_there_when_the_agent_is(seed):
    rng = np.random.default_rng(seed)
    grid = random_obstacles(free_grid((51, 51), 40.0), 0.15, rng)
    agent, target = rng.uniform(0, 2000, 2), rng.uniform(700, 1300, 2)
    assume(not grid.blocked[grid.node_of(tuple(agent))])
    course = rng.uniform(0, 2 * math.pi)
    velocity = (5.0 * math.sin(course), 5.0 * math.cos(course))
    demands = {LABEL: TargetDemand(velocity)}
    options = PlanOptions(shape="pulled", horizon_s=120.0)
    result = plan_routes(grid, {1: AgentState(*agent)}, {LABEL: tuple(target)}, {}, options, demands=demands)
    assume(result.routes and not result.notes)
    (route,) = result.routes

    arrival_s = route.length_m / SPEED_M_S
    then = target + np.array(velocity) * arrival_s
    if arrival_s < 115.0 and grid.contains(tuple(then)) and not grid.blocked[grid.node_of(tuple(then))]:
        error_m = np.hypot(*(route.points_m[-1] - then))
        there_s = route_to(grid, tuple(agent), tuple(then), (0.0, 0.0)).length_m / SPEED_M_S
        is_jump = there_s > arrival_s + 4.0  # an obstacle is in the way to the nearer place: no time fits
        assert error_m < 60.0 or is_jump


def test_without_a_horizon_a_route_ends_where_the_target_is():
    route = route_to(OPEN, (100.0, 100.0), (2000.0, 2000.0), (5.0, 0.0), horizon_s=0.0)
    assert route.points_m[-1].tolist() == [2000.0, 2000.0]


def test_a_target_that_gets_away_is_followed_to_the_edge_of_the_map():
    route = route_to(OPEN, (100.0, 2000.0), (3500.0, 2000.0), (14.0, 0.0))
    assert 3900.0 < route.points_m[-1][0] < 4020.0
    assert route.points_m[-1][1] == pytest.approx(2000.0)


def test_who_meets_whom_is_decided_by_the_meetings():
    """Target 0 runs towards agent 2, which is farther off now."""
    agents = {1: AgentState(1000.0, 2000.0), 2: AgentState(3200.0, 2000.0)}
    targets = {(0, 0): (2000.0, 2000.0)}
    here = plan_routes(OPEN, agents, targets, {}, PlanOptions())
    met = plan_routes(
        OPEN, agents, targets, {}, PlanOptions(horizon_s=120.0), demands={(0, 0): TargetDemand((9.0, 0.0))}
    )
    assert [route.vehicle for route in here.routes] == [1]
    assert [route.vehicle for route in met.routes] == [2]


def test_a_fast_agent_far_off_arrives_first_though_its_way_is_longer():
    agents = {1: AgentState(1000.0, 2000.0, speed_m_s=10.0), 2: AgentState(3200.0, 2000.0, speed_m_s=20.0)}
    targets = {(0, 0): (2000.0, 2000.0)}
    by_length = plan_routes(OPEN, agents, targets, {}, PlanOptions())
    by_arrival = plan_routes(OPEN, agents, targets, {}, PlanOptions(cost="arrival"))
    assert [route.vehicle for route in by_length.routes] == [1]
    assert [route.vehicle for route in by_arrival.routes] == [2]


@settings(max_examples=100)
@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(0.01, 30))
def test_velocities_are_led_by_as_much_as_they_are_known(v_east, v_north, std):
    track = Track(LABEL, read_only([0, 0, v_east, v_north]), read_only(np.diag([1, 1, std**2, std**2])), 1.0)
    led = shrunk_velocity(track)
    assert math.hypot(*led) <= math.hypot(v_east, v_north)
    if std > math.hypot(v_east, v_north):
        assert led == (0.0, 0.0)
    sharp = Track(LABEL, track.mean, read_only(1e-9 * np.eye(4)), 1.0)
    assert shrunk_velocity(sharp) == pytest.approx((v_east, v_north), rel=1e-3, abs=1e-4)


def test_a_target_that_needs_two_gets_two():
    agents = {v: AgentState(100.0 * v, 100.0) for v in (1, 2, 3)}
    targets = {(0, 0): (500.0, 500.0), (0, 1): (3000.0, 3000.0)}
    result = plan_routes(OPEN, agents, targets, {}, PlanOptions(), demands={(0, 0): TargetDemand(agents=2)})
    assert sorted(route.target for route in result.routes) == [(0, 0), (0, 0), (0, 1)]
    flown = {route.vehicle: route.target for route in result.routes}
    again = plan_routes(
        OPEN,
        agents,
        targets,
        flown,
        PlanOptions(switch_gain_m=50.0),
        demands={(0, 0): TargetDemand(agents=2)},
    )
    assert {route.vehicle: route.target for route in again.routes} == flown


def test_what_ranks_first_is_served_first_though_it_is_far():
    targets = {(0, 0): (200.0, 200.0), (0, 1): (3900.0, 3900.0)}
    agents = {1: AgentState(100.0, 100.0)}
    ranked = plan_routes(OPEN, agents, targets, {}, PlanOptions(), demands={(0, 0): TargetDemand(rank=1)})
    assert ranked.routes[0].target == (0, 1)


def test_surplus_agents_get_no_route():
    agents = {v: AgentState(100.0 * v, 100.0) for v in range(1, 6)}
    targets = {(0, 0): (500.0, 500.0), (0, 1): (600.0, 900.0)}
    result = plan_routes(OPEN, agents, targets, {}, PlanOptions())
    assert sorted(route.target for route in result.routes) == sorted(targets)
    assert len(result.unassigned_vehicles) == 3


@settings(max_examples=200)
@given(st.integers(0, 2**32), st.integers(1, 3), st.integers(1, 3))
def test_the_meeting_is_the_first_place_in_time_or_the_last_that_is_reached(seed, agents, targets):
    rng = np.random.default_rng(seed)
    counts = rng.integers(1, 6, targets)
    after_s = np.concatenate([5.0 * np.arange(count) for count in counts])
    first = (0, *np.cumsum(counts).tolist())
    view = TargetPrediction(np.zeros((after_s.size, 2)), read_only(after_s), first)
    lengths_m = rng.choice([np.inf, 40.0, 120.0, 260.0], (agents, after_s.size))
    speeds_m_s = rng.uniform(8.0, 15.0, agents)
    arrivals_s, meetings_s = intercept_times(lengths_m, view, speeds_m_s)
    for i in range(agents):
        for j in range(targets):
            t_s = after_s[first[j] : first[j + 1]]
            flown_s = lengths_m[i, first[j] : first[j + 1]] / speeds_m_s[i]
            in_time = np.flatnonzero(flown_s <= t_s)
            reached = np.flatnonzero(np.isfinite(flown_s))
            if not reached.size:
                assert arrivals_s[i, j] == np.inf
            elif not in_time.size:
                assert meetings_s[i, j] == t_s[reached[-1]]
                assert arrivals_s[i, j] == pytest.approx(flown_s[reached[-1]])
            else:
                k = in_time[0]
                assert arrivals_s[i, j] == meetings_s[i, j]
                if k == 0 or np.isinf(flown_s[k - 1]):
                    assert meetings_s[i, j] == t_s[k]
                else:  # it is there when the agent is, both moving evenly between the two places
                    share = (meetings_s[i, j] - t_s[k - 1]) / (t_s[k] - t_s[k - 1])
                    assert flown_s[k - 1] + share * (flown_s[k] - flown_s[k - 1]) == pytest.approx(
                        meetings_s[i, j]
                    )
