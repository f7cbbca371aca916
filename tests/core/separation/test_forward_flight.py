"""An encounter would be told too late, or of the wrong pair, if flights were predicted wrongly."""

import math

import numpy as np
import pytest
from helpers import plain_flights

from gcs.core.separation import forward_flight
from gcs.core.separation.forward_flight import Flight, Goal, GoalKind, simulate_flights
from gcs.core.separation.look_ahead import encounters
from gcs.geo import LocalFrame
from gcs.model import NS_PER_S
from gcs.planning.circle_guidance import commanded_radius_m
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.autopilots.mission_protocol import Item
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

SPEED_M_S = 15.0
FRAME = LocalFrame(33.2, -87.6, 0.0)


def flight(vehicle=1, place=(0.0, 0.0), height_m=100.0, course_deg=0.0, goals=(), **more):
    values = {"climb_m_s": 0.0, "turn_rate_rad_s": 0.0, "max_turn_rate_rad_s": 0.4} | more
    return Flight(
        vehicle, *place, height_m, SPEED_M_S, math.radians(course_deg),
        goals=tuple(goals) or (Goal(GoalKind.KEEP),), **values,
    )  # fmt: skip


def waypoint(east_m, north_m, height_m=100.0):
    return Goal(GoalKind.WAYPOINT, east_m, north_m, 15.0, height_m)


def at(paths, t_s, i=0):
    return float(paths.east_m[round(t_s), i]), float(paths.north_m[round(t_s), i])


def test_a_vehicle_flies_from_waypoint_to_waypoint():
    paths = simulate_flights([flight(goals=[waypoint(0.0, 150.0), waypoint(300.0, 150.0)])], 25.0)
    assert at(paths, 5.0) == pytest.approx((0.0, 75.0), abs=1.0)
    assert at(paths, 20.0) == pytest.approx((150.0, 150.0), abs=20.0)


def test_a_vehicle_on_a_circle_stays_on_it():
    circle = Goal(GoalKind.CIRCLE, 0.0, 0.0, commanded_radius_m(60.0, 15.0), 100.0)
    paths = simulate_flights([flight(place=(0.0, 60.0), course_deg=90.0, goals=[circle])], 40.0)
    radius_m = np.hypot(paths.east_m, paths.north_m)
    assert np.abs(radius_m - 60.0).max() < 6.0
    assert radius_m[-1] == pytest.approx(60.0, abs=0.5)


def test_a_vehicle_that_joins_a_circle_from_afar_is_on_it_half_a_minute_later():
    circle = Goal(GoalKind.CIRCLE, 0.0, 0.0, 60.0, 100.0)
    paths = simulate_flights([flight(place=(0.0, -400.0), goals=[circle])], 60.0)
    radius_m = np.hypot(paths.east_m, paths.north_m)
    assert np.abs(radius_m[30:] - 60.0).max() < 15.0


def test_a_descent_on_a_circle_may_go_on_as_slowly_as_it_has_begun():
    """A vehicle in RTL sank 3 m/s, 5 were predicted: it met one 40 m below that it was to be past (SITL)."""
    circle = Goal(GoalKind.CIRCLE, 0.0, 0.0, 60.0, 60.0)
    sinking = flight(place=(0.0, 60.0), course_deg=90.0, goals=[circle], climb_m_s=-3.0)
    paths = simulate_flights([sinking], 10.0)
    assert paths.high_m[10, 0] >= 70.0
    assert paths.low_m[10, 0] <= 65.0


@pytest.mark.parametrize("to_m", [160.0, 40.0])
def test_a_climb_or_descent_that_begins_late_stays_in_the_band(to_m):
    """A vehicle climbed 4 s later than predicted, after a turn, past one that held (58 m and 6 m)."""
    rate_m_s = (to_m - 100.0) / (400.0 / SPEED_M_S)
    now_m_s = -0.2 * rate_m_s
    paths = simulate_flights([flight(goals=[waypoint(0.0, 400.0, to_m)], climb_m_s=now_m_s)], 12.0)
    t_s = np.arange(13.0)
    lag_s = 3.0
    flown_m = 100.0 + rate_m_s * t_s + (now_m_s - rate_m_s) * lag_s * (1.0 - np.exp(-t_s / lag_s))
    assert (paths.low_m[:, 0] <= flown_m + 3.0).all()
    assert (paths.high_m[:, 0] >= flown_m - 3.0).all()
    nearer_m = flown_m - paths.low_m[:, 0] if to_m > 100.0 else paths.high_m[:, 0] - flown_m
    assert nearer_m.max() < 6.0


def test_a_turn_rate_that_is_seen_is_kept():
    paths = simulate_flights([flight(turn_rate_rad_s=SPEED_M_S / 80.0)], 25.0)
    away_m = np.hypot(paths.east_m - 80.0, paths.north_m)
    assert np.abs(away_m - 80.0).max() < 4.0


def test_a_change_of_height_is_a_band_of_both_ways_to_fly_it():
    paths = simulate_flights([flight(goals=[waypoint(0.0, 1500.0, 160.0)])], 20.0)
    assert paths.low_m[10, 0] == pytest.approx(106.0, abs=2.0)  # evenly along the leg
    assert paths.high_m[10, 0] == pytest.approx(150.0, abs=1.0)  # at once, 5 m/s


def test_a_vehicle_that_turns_round_to_a_waypoint_may_keep_its_height_until_it_is_nearer():
    """The waypoint counted as passed, and the descent to it as flown, while the vehicle flew away from it."""
    goals = [waypoint(10.0, -30.0, 60.0), Goal(GoalKind.CIRCLE, 10.0, -30.0, 60.0, 60.0)]
    paths = simulate_flights([flight(goals=goals)], 20.0)
    assert paths.high_m[7, 0] > 95.0
    assert paths.low_m[7, 0] < 70.0
    assert paths.high_m[20, 0] < 75.0


def test_a_vehicle_whose_descent_begins_after_a_turn_is_found_near_one_on_a_circle():
    """Vehicle 1 was sent to the layer 40 m below, and met the circle of vehicle 2 in the turn."""
    goals = [waypoint(873.0, 666.0, 130.0), Goal(GoalKind.CIRCLE, 873.0, 666.0, 60.0, 130.0)]
    sent = flight(1, (860.0, 703.0), 170.0, -10.0, goals=goals)
    circle = Goal(GoalKind.CIRCLE, 912.0, 677.0, 60.0, 170.0)
    holding = flight(2, (947.0, 722.0), 170.0, 60.0, goals=[circle])
    (found,) = encounters(simulate_flights([sent, holding], 25.0), 60.0, 15.0)
    assert 5.0 < found.after_s < 20.0


@pytest.mark.parametrize("goal", [Goal(GoalKind.CIRCLE, 60.0, 0.0, 60.0, 180.0), waypoint(0.0, 40.0, 180.0)])
def test_a_change_of_height_near_its_end_is_no_faster_than_an_aeroplane_climbs(goal):
    """A vehicle that returned 80 m below another was told to come near it in 3 s."""
    paths = simulate_flights([flight(goals=[goal])], 8.0)
    assert np.diff(paths.high_m[:, 0]).max() <= 7.5 + 1e-9


def test_a_vehicle_that_has_landed_is_in_nobodys_way():
    touch_down = Goal(GoalKind.LAND, 0.0, 75.0, 0.0, 70.0)
    lander = flight(height_m=75.0, goals=[touch_down])
    paths = simulate_flights(
        [lander, flight(2, (0.0, -150.0), 72.0, goals=[waypoint(0.0, 900.0, 72.0)])], 25.0
    )
    assert np.isnan(paths.low_m[12:, 0]).all()
    assert encounters(paths, 60.0, 15.0) == []


def test_an_old_position_is_taken_further():
    paths = simulate_flights([flight(age_s=2.0)], 5.0)
    assert at(paths, 0.0) == pytest.approx((0.0, 30.0))
    assert at(paths, 1.0) == pytest.approx((0.0, 75.0 - 30.0))


def test_a_climb_from_the_ground_through_the_layer_of_another_is_found():
    """A PX4 climbed through the layer of an ArduPlane: they passed at 11 m, 16 m in height."""
    climb = [Goal(GoalKind.CLIMB, height_m=160.0), waypoint(0.0, 2000.0, 160.0)]
    low = flight(1, (0.0, 0.0), 70.0, goals=climb, climb_gradient=math.tan(math.radians(12.0)))
    cruising = flight(2, (-240.0, 180.0), 110.0, 90.0, goals=[waypoint(900.0, 180.0, 110.0)])
    (found,) = encounters(simulate_flights([low, cruising], 25.0), 60.0, 15.0)
    assert found.vehicles == (1, 2)
    assert 8.0 < found.after_s < 16.0
    assert found.place_m == pytest.approx((0.0, 180.0, 105.0), abs=60.0)


def test_vehicles_in_neighbouring_layers_are_apart():
    paths = simulate_flights(
        [
            flight(1, (-200.0, 0.0), 100.0, 90.0, goals=[waypoint(600.0, 0.0, 100.0)]),
            flight(2, (200.0, 0.0), 120.0, 270.0, goals=[waypoint(-600.0, 0.0, 120.0)]),
        ],
        25.0,
    )
    assert encounters(paths, 60.0, 15.0) == []


def test_each_pair_is_found_wherever_it_is_in_a_swarm():
    rng = np.random.default_rng(3)
    flights = [
        flight(v, rng.uniform(0.0, 600.0, 2), 100.0 + 20.0 * (v % 3), float(rng.uniform(0.0, 360.0)))
        for v in range(1, 41)
    ]
    paths = simulate_flights(flights, 25.0)
    expected = {
        (a + 1, b + 1)
        for a in range(40)
        for b in range(a + 1, 40)
        if (a - b) % 3 == 0
        and (
            np.hypot(paths.east_m[:, a] - paths.east_m[:, b], paths.north_m[:, a] - paths.north_m[:, b])
            < 60.0 + np.arange(26)
        ).any()
    }
    assert {one.vehicles for one in encounters(paths, 60.0, 15.0)} == expected
    assert len(expected) > 20


def test_no_flight_leaves_its_reach():
    """Vehicles out of reach are left out of the checks of orders and new missions."""
    rng = np.random.default_rng(4)
    flights = []
    for vehicle in range(60):
        goals = [
            Goal(GoalKind(int(kind)), *rng.uniform(-500.0, 500.0, 2), *rng.uniform(-80.0, 80.0, 2))
            for kind in rng.integers(0, len(GoalKind), 3)
        ]
        place_m = rng.uniform(-300.0, 300.0, 3)
        speed_m_s = rng.uniform(0.0, 30.0)
        rest = (*rng.uniform(-3.0, 3.0, 3), rng.uniform(0.1, 1.0))
        flights.append(
            Flight(vehicle, *place_m, speed_m_s, *rest, tuple(goals), age_s=rng.uniform(0.0, 10.0))
        )
    paths = simulate_flights(flights, 25.0, 0.5)
    begin_m = np.array([(one.east_m, one.north_m) for one in flights]).T
    away_m = np.hypot(paths.east_m - begin_m[0], paths.north_m - begin_m[1])
    assert (away_m.max(axis=0) <= [one.reach_m(25.0) for one in flights]).all()


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("to_m", [60.0, 160.0])
def test_either_firmware_changes_its_height_inside_the_predicted_band(autopilot, to_m):
    """PX4 has the height of a waypoint NAV_LOITER_RAD (80 m) before it, ArduPlane at it; both lag by 3 s."""
    spec = VehicleSpec(
        1, 0.0, 0.0, 0.5 * math.pi, 100.0, SPEED_M_S, airframe="banked", autopilot=autopilot,
        arming_delay_s=0.0, parameters={"MIS_TKO_LAND_REQ": 0.0},
    )  # fmt: skip
    plane = SimVehicle(spec, FRAME, 0)
    places = [(0.0, 100.0), (200.0, 100.0), (500.0, to_m), (900.0, to_m)]
    points = [(*FRAME.to_geodetic(east_m, 0.0), height_m) for east_m, height_m in places]
    items = [Item(16, 3, x=round(lat * 1e7), y=round(lon * 1e7), z=z) for lat, lon, z in points]
    plane.autopilot.mission.replace(items[autopilot == "px4" :])
    plane.autopilot.arm(0)
    plane.autopilot.set_mode(Mode.AUTO)
    tenths = 0
    while plane.east_m < 200.0:
        tenths += 1
        plane.advance(tenths * NS_PER_S // 10)
    goals = [Goal(GoalKind.WAYPOINT, east_m, 0.0, 10.0, height_m) for east_m, height_m in places[2:]]
    begun = flight(place=(plane.east_m, plane.north_m), course_deg=90.0, goals=goals)
    paths = simulate_flights([begun], 25.0)
    late_m = 3.0 * abs(to_m - 100.0) / (300.0 - 80.0) * SPEED_M_S
    for after_s in range(26):
        plane.advance((tenths + 10 * after_s) * NS_PER_S // 10)
        low_m = paths.low_m[after_s, 0] - (late_m if to_m > 100.0 else 1.0)
        high_m = paths.high_m[after_s, 0] + (late_m if to_m < 100.0 else 1.0)
        assert low_m < plane.alt_rel_m < high_m, after_s
    assert plane.alt_rel_m == pytest.approx(to_m, abs=3.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("course_deg", [0.0, 90.0, 200.0])
def test_a_circle_that_begins_at_its_centre_is_entered_on_its_own_side(course_deg, side):
    """At its centre there is no direction to it: some holds were predicted to turn the other way."""
    course_rad = np.radians(course_deg)
    circle = Goal(GoalKind.CIRCLE, 500.0, 500.0, side * 60.0, 100.0)
    hold = Flight(1, 500.0, 500.0, 100.0, 18.0, course_rad, 0.0, 0.0, 0.5, (circle,))
    paths = simulate_flights([hold], 4.0)
    east_m, north_m = paths.east_m[-1, 0] - 500.0, paths.north_m[-1, 0] - 500.0
    to_the_right_m = east_m * np.cos(course_rad) - north_m * np.sin(course_rad)
    assert side * to_the_right_m > 10.0


def some_flight(rng, vehicle, wind_m_s):
    """Return a flight over goals of all kinds, with no turn right round at its end: that has two sides."""
    goals = [
        Goal(
            kind := GoalKind(int(rng.integers(len(GoalKind)))),
            *rng.uniform(-400.0, 400.0, 2),
            rng.uniform(-100.0, 100.0) if kind is GoalKind.CIRCLE else rng.uniform(5.0, 40.0),
            rng.uniform(50.0, 200.0),
            rng.choice([math.inf, rng.uniform(1.0, 20.0)]),
        )
        for _ in range(rng.integers(1, 6))
    ]
    return Flight(
        vehicle, *rng.uniform(-400.0, 400.0, 2), rng.uniform(50.0, 200.0), rng.uniform(0.0, 25.0),
        rng.uniform(-4.0, 7.0), rng.uniform(-3.0, 3.0), rng.uniform(-0.3, 0.3), rng.uniform(0.05, 0.6),
        (*goals, Goal(GoalKind.KEEP)), rng.uniform(0.0, 2.0), rng.uniform(0.0, 0.2), rng.uniform(0.0, 5.0),
        wind_m_s, float(rng.choice([0.0, rng.uniform(0.0, 6.0)])),
    )  # fmt: skip


@pytest.mark.parametrize("step_s", [0.5, 1.0])
@pytest.mark.parametrize("most_wind_m_s", [0.0, 8.0])
def test_the_kernel_flies_as_the_plain_form_does(monkeypatch, step_s, most_wind_m_s):
    rng = np.random.default_rng(1)
    winds_m_s = rng.uniform(-most_wind_m_s, most_wind_m_s, (1000, 2)).tolist()
    flights = [some_flight(rng, vehicle, tuple(wind_m_s)) for vehicle, wind_m_s in enumerate(winds_m_s)]
    fast = simulate_flights(flights, 30.0, step_s)
    monkeypatch.setattr(forward_flight, "_fly", plain_flights.fly)
    plain = simulate_flights(flights, 30.0, step_s)
    for one, other in zip(fast._arrays, plain._arrays, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-6)
