"""At the end of its route a vehicle would count as at its beginning: figures would jump."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.fenced_field import WIDE, field
from helpers.staging import state

from gcs.core.replanning.route_crossing import is_crossed
from gcs.core.state import State
from gcs.core.tasking.mission_builder import flown_points
from gcs.core.tasking.tasking_state import OnboardMission
from gcs.model import NS_PER_S, Route, read_only
from gcs.planning.map.grid import free_grid
from gcs.planning.route_progress import remaining_length_m, remaining_m
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import parse_scenario

ROUTE = Route(1, (0, 0), read_only([[500.0, 0.0], [1000.0, 0.0], [1000.0, 900.0]]), 1900.0)
BEHIND, ABREAST = (1020.0, 960.0), (1070.0, 880.0)


def agent(route=ROUTE, *, onboard=ROUTE):
    """Return an agent that flies a route, of which item 2 is the first point."""
    one = State.initial([1]).agents[1]
    one.routes.flown = route
    one.tasking.onboard = None if onboard is None else OnboardMission(onboard, (), 2)
    return one


def at_item(seq, place=BEHIND):
    return replace(state(1, place, speed_m_s=15.0), mission_seq=seq)


@pytest.mark.parametrize(("seq", "passed"), [(1, 0), (2, 0), (3, 1), (4, 2), (5, 3), (6, 3)])
def test_the_item_that_a_vehicle_flies_to_tells_what_it_has_passed(seq, passed):
    assert flown_points(agent(), ROUTE, at_item(seq)) == passed


@pytest.mark.parametrize("place", [BEHIND, ABREAST])
def test_behind_its_route_a_vehicle_has_only_its_end_to_go(place):
    passed = flown_points(agent(), ROUTE, at_item(5, place))
    assert remaining_length_m(ROUTE.points_m, place, passed) < 80.0
    assert np.array_equal(remaining_m(ROUTE.points_m, passed), ROUTE.points_m[-1:])


def test_an_area_that_closes_behind_a_vehicle_at_the_end_of_its_route_does_not_concern_it():
    closed = free_grid((51, 51), 40.0).with_obstacles(discs_m=[(700.0, 0.0, 60.0)])
    passed = flown_points(agent(), ROUTE, at_item(5, ABREAST))
    assert not is_crossed(closed, ROUTE.points_m, ABREAST, passed)
    assert is_crossed(closed, ROUTE.points_m, (400.0, 0.0), 0)


def test_the_position_tells_it_while_the_route_is_not_on_board():
    on_second_leg = at_item(7, (1000.0, 500.0))
    assert flown_points(agent(onboard=None), ROUTE, on_second_leg) == 2
    other = Route(1, (0, 1), read_only([[0.0, 0.0]]), 1.0)
    assert flown_points(agent(onboard=other), ROUTE, on_second_leg) == 2


def test_to_go_and_arrival_do_not_jump_while_a_vehicle_circles_at_the_end_of_its_route():
    """Its target is outside the fence, so it circles before it. To go was a circle, then the whole route."""
    run = VirtualRun(parse_scenario(field((1450.0, 1000.0), WIDE), "fenced.toml"), 1)
    to_go_m = []

    def note(_event):
        if run.t_ns % NS_PER_S == 0:
            (one,) = run.engine.stages.status_report.build(run.t_ns).agents
            to_go_m.append(one.to_go_m)

    run.on_event = note
    run.run(110.0)
    known = np.array([metres for metres in to_go_m if metres is not None])
    assert run.t_ns > START_T_NS + 100 * NS_PER_S
    assert known.min() < 150.0
    first_near = int(np.flatnonzero(known < 150.0)[0])
    assert known[first_near:].max() < 300.0
