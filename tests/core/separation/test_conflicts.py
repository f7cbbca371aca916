"""A vehicle would be sent to circle where another one descends to the height of its return."""

import math

import pytest

from gcs.core.separation.conflicts import Conflicts
from gcs.core.separation.forward_flight import Flight, Goal, GoalKind

CONFLICTS = Conflicts(60.0, 10.0, str)


def circling(vehicle, place_m, height_m, centre_m, circle_height_m):
    """Return the flight of a vehicle straight to a circle, or on it."""
    circle = Goal(GoalKind.CIRCLE, *centre_m, 60.0, circle_height_m)
    return Flight(vehicle, *place_m, height_m, 15.0, math.pi, 0.0, 0.0, 0.3, (circle,))


@pytest.mark.parametrize(
    ("from_m", "is_met"),
    [(180.0, True), (105.0, False), (60.0, False)],
    ids=["is above by then", "has passed it by then", "is below"],
)
def test_a_circle_through_which_a_return_will_descend_is_not_clear(from_m, is_met):
    """Vehicle 6 in RTL sank through the circle of vehicle 7, 24 m above its own one (ArduPlane SITL)."""
    own = circling(7, (0.0, 300.0), 84.0, (0.0, 0.0), 84.0)
    returns = circling(6, (140.0, 60.0), from_m, (140.0, 0.0), 60.0)
    assert bool([*CONFLICTS.overlapping(own, [returns], last=True)]) is is_met
    assert bool([*CONFLICTS.overlapping(returns, [own], last=True)]) is is_met


def test_a_return_that_is_down_before_it_gets_there_descends_through_no_circle():
    own = circling(7, (0.0, 60.0), 84.0, (0.0, 0.0), 84.0)
    returns = circling(6, (140.0, 1400.0), 180.0, (140.0, 0.0), 60.0)
    assert not [*CONFLICTS.overlapping(returns, [own], last=True)]
