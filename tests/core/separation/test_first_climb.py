"""A PX4 that begins a mission in the air climbs in a circle first, and Hold does not end that climb."""

from helpers.sky import FIELD, Sky, fly_on, give, place

from gcs.core.separation.forward_flight import GoalKind, simulate_flights
from gcs.model import Route, read_only
from gcs.model.vehicle_ids import home_label
from sim_vehicles.autopilots.autopilot_traits import Mode


def climbing(until_m):
    sky = Sky((1500.0, 1500.0, 20.0), px4=(1,))
    for _ in range(60):
        if sky.planes[1].alt_rel_m > until_m:
            return sky
        fly_on(sky, 0.4)
    raise AssertionError("it does not climb")


def is_predicted(sky, for_s, off_m=8.0):
    """Return True if the look-ahead, made now, has the place and the height some time later."""
    stages = sky.run_.engine.stages
    plane = sky.planes[1]
    flight = stages.intents.flight(stages.fleet.state(1), sky.run_.t_ns)
    paths = simulate_flights([flight], for_s)
    fly_on(sky, for_s)
    low_m, high_m = (float(heights[-1, 0]) for heights in (paths.low_m, paths.high_m))
    height_m = plane.alt_rel_m + 70.0
    away_m = abs(plane.east_m - paths.east_m[-1, 0]) + abs(plane.north_m - paths.north_m[-1, 0])
    return low_m - off_m < height_m < high_m + off_m and away_m < 60.0


def test_its_first_climb_is_predicted_as_a_circle():
    """Before, it was predicted to fly to its first point at once."""
    assert is_predicted(climbing(24.0), 8.0)


def test_it_is_predicted_to_climb_on_in_hold():
    """Before, one was held below a climbing PX4, and climbed beside it (PX4 SITL: 11 m and 3 m apart)."""
    sky = climbing(24.0)
    give(sky, "hold")
    fly_on(sky, 2.0)
    assert sky.planes[1].autopilot.mode is Mode.LOITER
    assert is_predicted(sky, 9.0)
    assert sky.planes[1].alt_rel_m > 50.0


def test_its_climb_is_predicted_before_the_next_look_at_its_mode():
    """Before, one that had just begun counted as away: another began beside it (PX4 SITL: 17 m and 7 m)."""
    sky = Sky((1500.0, 1500.0, 20.0), px4=(1,))
    agent = sky.run_.engine.state.agents[1].separation
    stages = sky.run_.engine.stages
    for step in range(1, 400):
        sky.run_.run(0.05 * step)
        state = stages.fleet.state(1)
        if state is not None and state.mode == "AUTO":
            break
    assert agent.mode != "AUTO"
    first = stages.intents.flight(state, sky.run_.t_ns).goals[0]
    assert first.kind is GoalKind.CIRCLE


def test_a_climb_that_is_over_is_forgotten():
    sky = climbing(55.0)
    fly_on(sky, 4.0)
    assert sky.run_.engine.state.agents[1].separation.first_climb is None


def test_of_two_that_are_near_each_other_one_climbs_after_the_other():
    """Before, both began at once, and climbed beside each other (PX4 SITL: 13 m and 3 m apart)."""
    sky = Sky((600.0, 1500.0, 60.0), (600.0, 1540.0, 60.0), px4=(1, 2))
    fly_on(sky, 0.4)
    order_check = sky.run_.engine.stages.avoidances._order_check
    label = home_label(1)
    routes = {
        vehicle: Route(
            vehicle, label, read_only([(600.0, 1500.0), (2900.0, 1500.0 + vehicle)]), 0.0, layer=layer
        )
        for vehicle, layer in ((1, 4), (2, 6))
    }
    t_ns = sky.run_.t_ns
    assert not order_check.mission_problem(routes[2], {}, t_ns)
    assert order_check.mission_problem(routes[1], {2: routes[2]}, t_ns)
    place(sky.planes[2], 600.0, 1540.0, 180.0)
    fly_on(sky, 2.0)
    assert not order_check.mission_problem(routes[1], {}, sky.run_.t_ns)


def test_vehicles_that_are_near_each_other_at_one_time_get_a_layer_each():
    """Before, a layer that was just given to another one counted as free."""
    sky = Sky(*[(400.0, 1440.0 + 40.0 * number, 80.0) for number in range(4)], px4=(1, 2, 3, 4), field=FIELD)
    fly_on(sky, 2.0)
    stacked = [agent.routes.stacked for agent in sky.run_.engine.state.agents.values()]
    layers = [route.layer for route in stacked if route is not None]
    assert len(layers) > 1
    assert len(set(layers)) == len(layers)
    fly_on(sky, 100.0)
    assert not sky.near_s
