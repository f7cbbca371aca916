"""In wind of half its airspeed a vehicle flies 7 to 23 m/s over ground; it was predicted at one speed."""

import math

import numpy as np
import pytest
from helpers.sky import FIELD, Sky, fly_on
from helpers.staging import S

from gcs.core.separation.forward_flight import Flight, Goal, GoalKind, simulate_flights
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS

AHEAD_S = 25
NORTH, EAST = 0.0, 0.5 * math.pi


def windy(east_m_s):
    return FIELD + f"[simulation.wind]\neast_m_s = {east_m_s}\n"


def predicted(sky, mode=None):
    """Return the predicted flight of vehicle 1, also in another mode, (k, 2)."""
    engine = sky.run_.engine
    (state,) = engine.stages.intents.in_air(sky.run_.t_ns)
    paths = simulate_flights([engine.stages.intents.flight(state, sky.run_.t_ns, mode)], AHEAD_S)
    return np.hstack((paths.east_m, paths.north_m))


def flown(sky):
    """Return the same as it is flown."""
    run = sky.run_
    begin_s = (run.t_ns - START_T_NS) / S
    places = []
    for after_s in range(AHEAD_S + 1):
        run.run(begin_s + after_s)
        run.ended = False
        places.append((sky.planes[1].east_m, sky.planes[1].north_m))
    return np.array(places)


def circling(field, px4):
    """Return a vehicle that circles at its target."""
    sky = Sky((2700.0, 2700.0, 60.0), field=field, px4=px4, courses_deg=[45.0])
    while sky.run_.engine.state.agents[1].perception.status.status != "arrived":
        fly_on(sky, 2.0)
    return fly_on(sky, 30.0)


@pytest.mark.parametrize("px4", [(), (1,)])
def test_a_vehicle_that_turns_downwind_is_predicted_where_it_flies(px4):
    """Its target is in the north-west."""
    sky = Sky((2600.0, 1000.0, 60.0), field=windy(-8.0), px4=px4, courses_deg=[90.0])
    while sky.planes[1].autopilot.mode is not Mode.AUTO:
        fly_on(sky, 0.4)
    assert np.hypot(*sky.planes[1].airframe.velocity_m_s) < 11.0
    ahead_m = predicted(sky)
    flown_m = flown(sky)
    assert np.hypot(*sky.planes[1].airframe.velocity_m_s) > 14.0
    assert np.hypot(*(ahead_m - flown_m).T).max() < 20.0  # 103 m before


@pytest.mark.parametrize("px4", [(), (1,)])
def test_a_circle_in_wind_is_flown_fast_downwind_and_slowly_upwind(px4):
    field = windy(5.0).replace("[airframe]\n", "[airframe]\nbank_deg = 45.0\n")
    sky = circling(field.replace("loiter_radius_m = 60.0", "loiter_radius_m = 80.0"), px4)
    off_m = [np.hypot(*(predicted(sky) - flown(sky)).T) for _ in range(6)]
    assert np.max(off_m) < 40.0  # 150 m before


@pytest.mark.parametrize(("px4", "parameter"), [((), "WP_LOITER_RAD"), ((1,), "NAV_LOITER_RAD")])
@pytest.mark.parametrize("east_m_s", [0.0, -6.0])
def test_a_hold_is_flown_where_it_is_predicted(east_m_s, px4, parameter):
    """From its centre a vehicle flies out before it turns, by the radius that its parameter sets."""
    field = windy(east_m_s).replace("S = 1.0", f"S = 1.0, {parameter} = 90.0")
    sky = Sky((1500.0, 1500.0, 60.0), field=field, px4=px4, courses_deg=[90.0])
    while sky.planes[1].autopilot.mode is not Mode.AUTO:
        fly_on(sky, 0.4)
    fly_on(sky, 15.0)
    ahead_m = predicted(sky, "LOITER")
    sky.planes[1].autopilot.set_mode(Mode.LOITER)
    off_m = np.hypot(*(ahead_m - flown(sky)).T)
    assert off_m[:9].max() < 10.0  # 75 to 90 m before
    assert off_m.max() < 25.0


@pytest.mark.parametrize(("px4", "parameter"), [((), "WP_LOITER_RAD"), ((1,), "NAV_LOITER_RAD")])
def test_a_circle_without_a_radius_of_its_own_has_that_of_the_vehicle(px4, parameter):
    field = FIELD.replace("loiter_radius_m = 60.0", "loiter_radius_m = 0.0")
    sky = circling(field.replace("S = 1.0", f"S = 1.0, {parameter} = 110.0"), px4)
    off_m = np.hypot(*(predicted(sky) - flown(sky)).T)
    assert off_m.max() < 15.0


@pytest.mark.parametrize(("px4", "parameter"), [((), "RTL_RADIUS"), ((1,), "RTL_LOITER_RAD")])
def test_a_return_ends_in_a_circle_with_the_radius_of_returns(px4, parameter):
    """Not with that of LOITER, which the vehicle flew before."""
    field = windy(0.0).replace("S = 1.0", f"S = 1.0, {parameter} = 120.0")
    sky = Sky((1500.0, 1500.0, 60.0), field=field, px4=px4, courses_deg=[90.0])
    plane = sky.planes[1]
    while plane.autopilot.mode is not Mode.AUTO:
        fly_on(sky, 0.4)
    plane.autopilot.set_mode(Mode.LOITER)
    fly_on(sky, 40.0)
    plane.autopilot.set_mode(Mode.RTL)
    fly_on(sky, 5.0)
    off_m = np.hypot(*(predicted(sky) - flown(sky)).T)
    assert off_m.max() < 15.0


@pytest.mark.parametrize("px4", [(), (1,)])
def test_a_circle_in_thin_air_is_as_wide_as_the_firmware_flies_it(px4):
    """At 2,500 m ArduPlane flies a circle of 90 m with 116 m."""
    field = FIELD.replace("alt_msl_m = 70.0", "alt_msl_m = 2500.0")
    field = field.replace("loiter_radius_m = 60.0", "loiter_radius_m = 90.0")
    sky = circling(field, px4)
    off_m = np.hypot(*(predicted(sky) - flown(sky)).T)
    assert off_m.max() < 25.0  # with ArduPlane 102 m before


def test_a_vehicle_in_calm_air_is_predicted_alike_beside_one_in_wind():
    circle = Goal(GoalKind.CIRCLE, 0.0, 0.0, 60.0, 100.0)
    calm = Flight(1, 0.0, -300.0, 100.0, 15.0, NORTH, 0.0, 0.0, 0.4, (circle,))
    blown = Flight(2, 0.0, -300.0, 100.0, 15.0, NORTH, 0.0, 0.0, 0.4, (circle,), wind_m_s=(0.0, 6.0))
    alone = simulate_flights([calm], AHEAD_S)
    both = simulate_flights([calm, blown], AHEAD_S)
    assert both.east_m[:, :1] == pytest.approx(alone.east_m, abs=1e-9)
    assert both.north_m[:, :1] == pytest.approx(alone.north_m, abs=1e-9)


@pytest.mark.parametrize(("course_rad", "drift_m"), [(NORTH, (125.0, 0.0)), (EAST, (125.0, 0.0))])
def test_a_vehicle_that_keeps_its_bank_drifts_with_the_wind(course_rad, drift_m):
    """A round of 25 s at 15 m/s through the air, in wind of 5 m/s."""
    wind_m_s = (5.0, 0.0)
    speed_m_s = 20.0 if course_rad == EAST else math.sqrt(15.0**2 - 5.0**2)
    rate_rad_s = 2.0 * math.pi / 25.0 * 15.0 / 20.0 if course_rad == EAST else 2.0 * math.pi / 25.0
    goal = Goal(GoalKind.KEEP)
    turning = Flight(
        1, 0.0, 0.0, 100.0, speed_m_s, course_rad, 0.0, rate_rad_s, 0.5, (goal,), wind_m_s=wind_m_s
    )
    paths = simulate_flights([turning], 25.0, 0.25)
    assert (paths.east_m[-1, 0], paths.north_m[-1, 0]) == pytest.approx(drift_m, abs=4.0)


def test_an_estimate_of_the_wind_that_no_aeroplane_could_fly_in_is_ignored():
    sky = Sky((1500.0, 1500.0, 60.0), courses_deg=[0.0])
    fly_on(sky, 8.0)
    calm_m = predicted(sky)
    sky.run_.engine.state.agents[1].link.wind_m_s = (60.0, 0.0)
    assert np.array_equal(predicted(sky), calm_m)
