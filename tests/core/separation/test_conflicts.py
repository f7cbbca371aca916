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
    [(180.0, True), (70.0, False), (60.0, False)],
    ids=["is above by then", "has come below it by then", "is there"],
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


@pytest.mark.parametrize(
    ("circle_msl_m", "is_met"),
    [(85.0, True), (60.0, True), (150.0, False)],
    ids=["slowly", "at once", "above"],
)
def test_a_circle_that_a_return_leads_through_is_not_clear(circle_msl_m, is_met):
    """Vehicle 18 in RTL flew through the circle of vehicle 13, at its height, within 8 m (ArduPlane SITL)."""
    own = circling(13, (0.0, 300.0), circle_msl_m, (0.0, 0.0), circle_msl_m)
    returns = circling(18, (30.0, 700.0), 110.0, (30.0, -500.0), 60.0)
    found = [*CONFLICTS.overlapping(own, [returns], last=True)]
    assert [one.other for one in found] == [18] * is_met
    assert bool([*CONFLICTS.overlapping(returns, [own], last=True)]) is is_met


def test_a_return_has_left_before_the_other_vehicle_is_on_its_circle():
    own = circling(13, (0.0, 1500.0), 85.0, (0.0, 0.0), 85.0)
    returns = circling(18, (30.0, 100.0), 110.0, (30.0, -500.0), 60.0)
    assert not [*CONFLICTS.overlapping(own, [returns], last=True)]
