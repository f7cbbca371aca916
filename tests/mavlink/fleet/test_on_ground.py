"""A user would have a vehicle on the ground tasked as one in the air."""

from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.mavlink.mission.items import Home
from gcs.model import VehicleState

HOME = Home(33.2, -87.6, 70.0)


def test_on_the_ground_is_disarmed_or_slow_and_low():
    def state(armed, alt_m, speed, climb=0.0, grounded=None):
        return VehicleState(1, 0, 0.0, 0.0, alt_m, speed, 0.0, "MANUAL", armed, 0, climb, grounded)

    assert is_on_ground(state(False, 70.0, 15.0), HOME)  # in a car
    assert is_on_ground(state(False, 170.0, 0.5), HOME)  # in a tree, on a hill
    assert not is_on_ground(state(False, 170.0, 15.0), HOME)  # disarmed in flight
    assert is_on_ground(state(True, 170.0, 0.5, grounded=True), HOME)  # crashed on a hill
    assert not is_on_ground(state(True, 71.0, 0.5, climb=-4.0), HOME)  # falls into a strong wind
    assert is_on_ground(state(True, 71.0, 0.5), HOME)
    assert is_on_ground(state(True, 71.0, 6.0), HOME)  # rolls
    assert not is_on_ground(state(True, -45.0, 6.0), HOME)  # in a valley, against the wind
    assert not is_on_ground(state(True, 170.0, 0.5), HOME)
    assert not is_on_ground(state(True, 71.0, 15.0), HOME)
    assert not is_on_ground(state(True, 71.0, 0.5), None)
    assert not is_on_ground(None, HOME)
