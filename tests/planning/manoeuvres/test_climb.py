"""A vehicle would be lost to what stands ahead of its runway: the climb is flown before the route begins."""

import math

import numpy as np
import pytest

from gcs.planning.manoeuvres.climb import Climb, climb_obstruction, ground_obstruction, turn_obstruction
from gcs.planning.manoeuvres.takeoff_obstruction import ObstructionCode
from gcs.planning.map.grid import free_grid
from gcs.terrain.elevation_grid import Elevation

HEADING_RAD = math.radians(352.9)
STAND_M = (1501.5, 1000.0)
# Where ArduPlane (simulated, calm, pitch 15 degrees) had its take-off altitude and flew to the next item, as
# its flight log says: altitude, east, north. Runway heading and place as above.
CLIMBED = [
    (90.0, 1467.7, 1271.8),
    (90.0, 1464.9, 1282.4),
    (120.0, 1457.3, 1354.1),
    (120.0, 1453.9, 1365.3),
    (150.0, 1445.1, 1448.4),
    (180.0, 1431.7, 1530.4),
]
# The same with 6 m/s of wind from the west.
CLIMBED_IN_WIND = [(90.0, 1500.0, 1274.4), (120.0, 1507.1, 1356.9)]
# What it flew through in one of these flights, 45 m deep, on its climb to 90 m.
BOX_M = (1410.0, 1240.0, 1510.0, 1340.0)


def climb(altitude_m, wind_m_s=0.0):
    length_m = 30.0 + altitude_m / math.tan(math.radians(20.0))
    return Climb(STAND_M, HEADING_RAD, 30.0, length_m, altitude_m, 22.0, wind_m_s)


def field(*boxes_m):
    return free_grid((76, 76), 40.0).with_obstacles(boxes_m=boxes_m)


@pytest.mark.parametrize(("altitude_m", "east_m", "north_m"), CLIMBED)
def test_a_climb_ends_where_an_autopilot_was_seen_to_end_it(altitude_m, east_m, north_m):
    assert math.dist(climb(altitude_m).end_m, (east_m, north_m)) < 20.0


@pytest.mark.parametrize(("altitude_m", "east_m", "north_m"), CLIMBED_IN_WIND)
def test_the_wind_carries_a_climb_no_farther_than_the_checked_area(altitude_m, east_m, north_m):
    flown = climb(altitude_m, wind_m_s=6.0)
    off_m = math.dist(flown.end_m, (east_m, north_m))
    assert 20.0 < off_m < max(math.dist(flown.end_m, end) for end in flown.possible_ends_m())


@pytest.mark.parametrize("altitude_m", [90.0, 120.0])
def test_an_obstacle_ahead_of_the_runway_is_not_flown_through(altitude_m):
    found = climb_obstruction(field(BOX_M), climb(altitude_m), 60.0)
    assert found.code is ObstructionCode.CLIMB_BLOCKED
    assert {name: round(value) for name, value in found.parameters.items()} == {
        "min_clearance_m": 60, "distance_m": 161, "east_m": 1482, "north_m": 1160,
    }  # fmt: skip
    assert not climb_obstruction(field(), climb(altitude_m), 60.0)


def test_a_low_take_off_altitude_turns_before_the_obstacle():
    grid, low = field(BOX_M), climb(20.0)
    route = [(1336.0, 1157.0), (1073.0, 2067.0)]
    assert not climb_obstruction(grid, low, 60.0)
    assert not turn_obstruction(grid, low, route, 78.0, 60.0)


def test_an_obstacle_in_the_first_turn_is_named():
    grid, straight = field((1260.0, 1320.0, 1380.0, 1400.0)), climb(90.0)
    assert not climb_obstruction(grid, straight, 60.0)
    found = turn_obstruction(grid, straight, [(700.0, 1350.0)], 78.0, 60.0)
    assert found.code in (ObstructionCode.TURN_BLOCKED, ObstructionCode.TURN_MAY_BE_BLOCKED)
    assert not turn_obstruction(grid, straight, [(2200.0, 1350.0)], 78.0, 60.0)


GAP = ((900.0, 2190.0, 1335.0, 2210.0), (1385.0, 2190.0, 1800.0, 2210.0))
"""A gap of 40 m on the line of the runway, 900 m from the end of the climb."""


def ahead(far_m, aside_m=0.0):
    return [climb(90.0).at(far_m, aside_m)]


def test_a_narrow_gap_on_a_far_leg_is_not_the_first_turn():
    """The take-off was refused, although the route leads through the gap with what clearance there is."""
    assert not turn_obstruction(field(*GAP), climb(90.0), ahead(1600.0), 78.0, 60.0)
    assert turn_obstruction(field((900.0, 2190.0, 1800.0, 2210.0)), climb(90.0), ahead(1600.0), 78.0, 60.0)


def test_a_far_gap_that_is_missed_after_the_first_turn_is_a_problem():
    """From where the wind may carry the climb the way to the waypoint leads into its edge."""
    assert turn_obstruction(field(*GAP), climb(90.0, wind_m_s=6.0), ahead(1600.0), 78.0, 60.0)


def test_wind_requires_more_clearance_at_the_climb():
    grid = field((1580.0, 1240.0, 1660.0, 1400.0))
    assert not climb_obstruction(grid, climb(90.0), 60.0)
    assert climb_obstruction(grid, climb(90.0, wind_m_s=6.0), 60.0)


def test_a_climb_out_of_the_map_is_refused():
    out = Climb((1500.0, 100.0), math.pi, 30.0, 280.0, 90.0, 22.0)
    assert climb_obstruction(field(), out, 60.0).code is ObstructionCode.OUTSIDE_MAP


def test_on_the_ground_a_vehicle_may_stand_near_a_hangar():
    hangar = (1540.0, 960.0, 1580.0, 1000.0)
    assert not climb_obstruction(field(hangar), climb(20.0), 40.0)


def rising(gradient, from_m=150.0):
    """Return ground that rises along the runway, from a distance to it on."""
    at = np.arange(-1500.0, 3500.0, 20.0)
    east, north = np.meshgrid(at, at)
    along = (east - STAND_M[0]) * math.sin(HEADING_RAD) + (north - STAND_M[1]) * math.cos(HEADING_RAD)
    return Elevation((-1500.0, -1500.0), 20.0, 70.0 + gradient * np.maximum(along - from_m, 0.0))


def test_a_climb_towards_rising_ground_keeps_half_of_its_height():
    climbing = climb(120.0)
    assert ground_obstruction(climbing, rising(0.0), 25.0) is None
    assert ground_obstruction(climbing, rising(0.1), 25.0) is None
    found = ground_obstruction(climbing, rising(0.4), 25.0)
    assert found.code is ObstructionCode.NEAR_GROUND
    assert found.parameters["agl_m"] < 25.0
    assert "of the ground" in found.problem


def test_a_runway_may_rise():
    """Ground that rose from the stand on was above the height of a vehicle that had just left it."""
    assert ground_obstruction(climb(120.0), rising(0.05, 0.0), 25.0) is None


def test_a_climb_that_the_wind_drifts_towards_a_slope_is_obstructed():
    at = np.arange(-1500.0, 3500.0, 20.0)
    east, north = np.meshgrid(at, at)
    aside = (east - STAND_M[0]) * math.cos(HEADING_RAD) - (north - STAND_M[1]) * math.sin(HEADING_RAD)
    slope = Elevation((-1500.0, -1500.0), 20.0, 70.0 + 1.5 * np.maximum(aside - 30.0, 0.0))
    assert ground_obstruction(climb(120.0), slope, 25.0) is None
    drifted = climb(120.0, 8.0)
    assert ground_obstruction(drifted, slope, 25.0).code is ObstructionCode.NEAR_GROUND
