"""A user would lose two vehicles to each other: one held or on its way home, one with a new mission."""

from dataclasses import replace

import numpy as np
from helpers.staging import at, mission, track

from gcs.core.airspace.obstacle_map import mission_map
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.mission_inputs import mission_inputs
from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.replanning.records import OtherVehicle
from gcs.core.state import State
from gcs.model import Route, read_only
from gcs.planning.manoeuvres.climb import Climb
from gcs.planning.plan_result import Choice
from gcs.planning.planner import plan_mission

CONFIG = mission(
    agents=[(100.0, 200.0), (100.0, 800.0), (100.0, 500.0)],
    tables="[mission]\naltitude_rel_m = 90.0\nlayer_step_m = 30.0\nlayers = 2\n",
)
"""Vehicles 1 and 3 would like layer 0, vehicle 2 layer 1."""
TASK = mission_inputs(CONFIG, mission_map(CONFIG, 1))


def route(vehicle, *points, layer=0):
    return Route(vehicle, (0, vehicle), read_only(points), 1.0, layer=layer)


def given(*aside):
    """Layer of vehicle 1, that flies east along 200 m north, with others aside."""
    state = State.initial((1, 2, 3))
    state.replanning.other_vehicles = aside
    new = route(1, (100.0, 200.0), (1500.0, 200.0))
    inputs = PlanningInputs(at(0.0), at(0.0), {1: track((0, 0), (100.0, 200.0))}, {}, frozenset())
    flights = AltitudeLayers(CONFIG, TASK, state.agents, state.replanning).flights((), [new], inputs)
    made = plan_mission(replace(TASK, targets={}), lambda _: Choice([new], (), flights))
    return made.routes[0].layer, made.conflicts


def test_a_new_mission_keeps_clear_of_a_vehicle_that_is_held_at_its_altitude():
    held = (900.0, 200.0)
    assert given() == (0, ())
    assert given(OtherVehicle(3, held, held, 92.0)) == (1, ())
    assert given(OtherVehicle(3, held, held, 118.0)) == (0, ())
    assert given(OtherVehicle(3, held, held, 30.0)) == (0, ()), "below all layers"


def test_a_new_mission_keeps_clear_of_a_vehicle_that_returns_across_it():
    speed_m_s = CONFIG.speeds_m_s[3]
    across = OtherVehicle(3, (900.0, 200.0 + 800.0), (900.0, 200.0 - 100.0), 90.0)
    assert CONFIG.speeds_m_s[1] == speed_m_s, "they meet after 800 m each"
    assert given(across) == (1, ())


def test_without_a_free_layer_the_vehicles_that_meet_are_named():
    a, b = (700.0, 200.0), (900.0, 200.0)
    _, conflicts = given(OtherVehicle(2, a, a, 120.0), OtherVehicle(3, b, b, 90.0))
    assert [conflict.vehicles for conflict in conflicts] == [(1, 3)]


def test_a_route_is_not_flown_again_into_the_layer_of_another():
    state, places = State.initial((1, 2, 3)), {1: (100.0, 200.0), 3: (100.0, 500.0)}
    layers = AltitudeLayers(CONFIG, TASK, state.agents, state.replanning)
    resumed = route(1, (100.0, 200.0), (1500.0, 200.0))
    crossing = route(3, (100.0, 500.0), (300.0, 190.0), (1500.0, 190.0))
    assert not layers.is_clear(resumed, [crossing], places)
    assert layers.is_clear(
        resumed, [route(3, (100.0, 500.0), (300.0, 190.0), (1500.0, 190.0), layer=1)], places
    )


def occupied(held, route_, climbs=None):
    """Return the vehicles of a flown route that another one stands in the way of."""
    state = State.initial((1, 2, 3))
    state.replanning.other_vehicles = held
    layers = AltitudeLayers(CONFIG, TASK, state.agents, state.replanning)
    agents = {1: track((0, 0), (100.0, 200.0))}
    inputs = PlanningInputs(at(0.0), at(0.0), agents, {}, frozenset(), climbs=climbs or {})
    return layers.occupied([route_], inputs)


def test_a_flown_route_is_given_up_where_a_vehicle_is_held_in_its_layer():
    """The vehicle was resumed, sent home and held after the route had been planned."""
    flown = route(1, (100.0, 200.0), (1500.0, 200.0))
    ahead, aside = (900.0, 200.0), (900.0, 500.0)
    assert occupied([OtherVehicle(3, ahead, ahead, 92.0)], flown) == {1}
    assert occupied([OtherVehicle(3, aside, aside, 92.0)], flown) == set()
    assert occupied([OtherVehicle(3, ahead, ahead, 118.0)], flown) == set()
    both = [OtherVehicle(3, ahead, ahead, 92.0), OtherVehicle(2, ahead, ahead, 118.0)]
    assert occupied(both, flown) == set(), "another layer would not help"


def test_the_climb_before_a_route_is_looked_at_too():
    flown, beside = route(1, (100.0, 900.0)), (500.0, 240.0)
    climb = Climb((100.0, 200.0), np.pi / 2.0, 20.0, 500.0, 90.0, 15.0)
    held = [OtherVehicle(3, beside, beside, 92.0)]
    assert occupied(held, flown) == set()
    assert occupied(held, flown, {1: climb}) == {1}
