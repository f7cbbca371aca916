"""A user would lose two vehicles to each other: one held or on its way home, one with a new mission."""

from staging import mission, track

from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.replanning.records import OtherVehicle
from gcs.core.state import State
from gcs.model import Route, read_only

CONFIG = mission(
    agents=[(100.0, 200.0), (100.0, 800.0), (100.0, 500.0)],
    tables="[mission]\naltitude_rel_m = 90.0\nlayer_step_m = 30.0\nlayers = 2\n",
)
"""Vehicles 1 and 3 would like layer 0, vehicle 2 layer 1."""


def route(vehicle, *points, layer=0):
    return Route(vehicle, (0, vehicle), read_only(points), 1.0, layer=layer)


def given(*aside):
    """Layer of vehicle 1, that flies east along 200 m north, with others aside."""
    state = State.initial((1, 2, 3))
    state.replanning.other_vehicles = aside
    layers = AltitudeLayers(CONFIG, state.agents, state.replanning)
    routes, notes = layers.give(
        [route(1, (100.0, 200.0), (1500.0, 200.0))], [1], {1: track((0, 0), (100.0, 200.0))}, ()
    )
    return routes[0].layer, notes


def test_a_new_mission_keeps_clear_of_a_vehicle_that_is_held_at_its_altitude():
    held = (900.0, 200.0)
    assert given() == (0, [])
    assert given(OtherVehicle(3, held, held, 92.0)) == (1, [])
    assert given(OtherVehicle(3, held, held, 118.0)) == (0, [])
    assert given(OtherVehicle(3, held, held, 30.0)) == (0, []), "below all layers"


def test_a_new_mission_keeps_clear_of_a_vehicle_that_returns_across_it():
    speed_m_s = CONFIG.speeds_m_s[3]
    across = OtherVehicle(3, (900.0, 200.0 + 800.0), (900.0, 200.0 - 100.0), 90.0)
    assert CONFIG.speeds_m_s[1] == speed_m_s, "they meet after 800 m each"
    assert given(across) == (1, [])


def test_without_a_free_layer_the_operator_is_warned():
    a, b = (700.0, 200.0), (900.0, 200.0)
    _, notes = given(OtherVehicle(2, a, a, 120.0), OtherVehicle(3, b, b, 90.0))
    assert any("will come near each other at one altitude" in note for note in notes)


def test_a_route_is_not_flown_again_into_the_layer_of_another():
    state, places = State.initial((1, 2, 3)), {1: (100.0, 200.0), 3: (100.0, 500.0)}
    layers = AltitudeLayers(CONFIG, state.agents, state.replanning)
    resumed = route(1, (100.0, 200.0), (1500.0, 200.0))
    crossing = route(3, (100.0, 500.0), (300.0, 190.0), (1500.0, 190.0))
    assert not layers.is_clear(resumed, [crossing], places)
    assert layers.is_clear(
        resumed, [route(3, (100.0, 500.0), (300.0, 190.0), (1500.0, 190.0), layer=1)], places
    )
