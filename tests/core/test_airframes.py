"""A user with two kinds of vehicles in one swarm would get routes, climbs and checks of the wrong kind."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.areas import ALABAMA
from helpers.staging import state

from gcs.config import parse
from gcs.core.airspace.airspace_state import AirspaceState
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.airspace.obstacle_map import mission_grid, mission_map
from gcs.core.preflight.mission_checks import rehearse
from gcs.core.preflight.vehicle_checks import envelope_of
from gcs.core.replanning.plan_targets import plan_options, vehicle_options
from gcs.core.takeoff.climbs import Climbs
from gcs.core.tasking.mission_builder import MissionBuilder
from gcs.errors import ConfigError
from gcs.mavlink.autopilots import ARDUPLANE, PX4
from gcs.model import Route, read_only
from gcs.planning.planner_inputs import AgentState
from gcs.planning.team_routes import plan_routes
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.vehicle.banked_airframe import BankedAirframe
from sim_vehicles.world.scenario import parse_scenario
from sim_vehicles.world.vehicle_specs import vehicle_specs

SLOW, FAST = 1, 2
MIXED = (
    'name = "mixed"\n'
    + ALABAMA
    + """\
boxes_m = [[1000.0, 800.0, 1200.0, 2200.0]]
[[agents]]
system_id = 1
east_m = 500.0
north_m = 1300.0
course_deg = 90.0
[[agents]]
system_id = 2
east_m = 500.0
north_m = 1700.0
course_deg = 90.0
airframe = "fast"
[[births]]
east_m = 2000.0
north_m = 1200.0
[[births]]
east_m = 2000.0
north_m = 1800.0
[airframe]
speed_m_s = 13.0
bank_deg = 35.0
[airframes.fast]
speed_m_s = 22.0
bank_deg = 30.0
turn_lag_s = 1.5
wind_m_s = 3.0
climb_deg = 12.0
ground_run_m = 60.0
loiter_radius_m = 110.0
end = "land"
[planning]
clearance_m = 40.0
shape = "flyable"
[mission]
altitude_rel_m = 100.0
[simulation]
forward_speed_m_s = 13.0
airframe = "banked"
[[simulation.targets]]
east_m = 2000.0
north_m = 1200.0
[[simulation.targets]]
east_m = 2000.0
north_m = 1800.0
"""
)
CONFIG = parse(MIXED, "mixed.toml")


class Reported:
    """A fleet of two vehicles that stand on the ground, with their noses to the east."""

    def state(self, vehicle):
        return replace(state(vehicle, (500.0, 1300.0)), armed=False, alt_msl_m=70.0)

    def home(self, _vehicle):
        return None


def test_each_vehicle_turns_as_wide_as_its_own_airframe():
    """At 22 m/s a turn has a radius of 112 m, not the 32 m of 13 m/s."""
    slow, fast = (CONFIG.airframe_of(vehicle) for vehicle in (SLOW, FAST))
    assert slow.turn_radius_m == pytest.approx(13.0**2 / (9.80665 * math.tan(math.radians(35.0))))
    assert fast.turn_radius_m == pytest.approx(25.0**2 / (9.80665 * math.tan(math.radians(30.0))))
    routes = {vehicle: rehearse(CONFIG, 1, {}).plan.routes[vehicle - 1] for vehicle in (SLOW, FAST)}
    builder = MissionBuilder(CONFIG)
    radii_m = {
        vehicle: [point.accept_radius_m for point in builder.of(route, 1, None).waypoints]
        for vehicle, route in routes.items()
    }
    assert max(radii_m[FAST]) > 1.5 * max(radii_m[SLOW])


def spare_m(points_m, radius_m):
    """Return the length of the legs that turns of a radius leave, the least of a route."""
    legs = np.diff(points_m, axis=0)
    lengths, courses = np.hypot(*legs.T), np.arctan2(*legs.T)
    turns = np.abs((np.diff(courses) + math.pi) % (2.0 * math.pi) - math.pi)
    tangents = np.array([0.0, *radius_m * np.tan(turns / 2.0), 0.0])
    return (lengths - tangents[:-1] - tangents[1:]).min()


def test_the_corners_of_a_route_are_as_wide_as_its_vehicle_turns():
    own, grid = vehicle_options(CONFIG), mission_grid(CONFIG, 1)
    for vehicle in (SLOW, FAST):
        start = AgentState(900.0, 1000.0, math.radians(180.0), 22.0, options=own[vehicle])
        plan = plan_routes(grid, {vehicle: start}, {(0, 0): (1400.0, 1500.0)}, {}, plan_options(CONFIG))
        path_m = np.vstack(((900.0, 1000.0), plan.routes[0].points_m))
        assert spare_m(path_m, own[vehicle].turn_radius_m) > 0.0


def test_a_landing_and_a_loiter_fly_in_one_swarm():
    route = Route(FAST, (0, 0), read_only([[900.0, 500.0]]), 1.0)
    builder = MissionBuilder(CONFIG)
    assert builder.of(route, 1, None).end == "land"
    assert builder.of(Route(SLOW, (0, 0), route.points_m, 1.0), 1, None).end == "loiter"
    options = vehicle_options(CONFIG)
    assert options[FAST].loiter.is_left  # in wind it needs room to turn
    assert not options[SLOW].loiter.is_left


def test_a_climb_has_the_angle_of_its_vehicle():
    climbs = Climbs(CONFIG, NoFlyZones(AirspaceState(), mission_map(CONFIG, 1)), Reported(), {})
    slow, fast = (climbs.climb(vehicle, 0) for vehicle in (SLOW, FAST))
    assert slow.length_m == pytest.approx(30.0 + 100.0 / math.tan(math.radians(20.0)))
    assert fast.length_m == pytest.approx(60.0 + 100.0 / math.tan(math.radians(12.0)))
    assert (slow.speed_m_s, fast.speed_m_s) == (13.0, 22.0)


@pytest.mark.parametrize("profile", [ARDUPLANE, PX4])
def test_preflight_does_not_ask_to_slow_the_faster_vehicle_down(profile):
    speeds = {"AIRSPEED_CRUISE", "FW_AIRSPD_TRIM"}
    wanted = {
        vehicle: next(one for one in profile.fits(envelope_of(CONFIG, vehicle)) if speeds & set(one.names))
        for vehicle in (SLOW, FAST)
    }
    assert wanted[FAST].accepts(22.0)
    assert not wanted[FAST].accepts(13.0)
    assert "(airframes.fast.speed_m_s)" in wanted[FAST].why
    assert wanted[SLOW].accepts(13.0)
    assert "(airframe.speed_m_s)" in wanted[SLOW].why


def test_an_own_speed_widens_the_turns_of_its_vehicle():
    config = parse(MIXED.replace('airframe = "fast"', "speed_m_s = 22.0"), "mixed.toml")
    assert config.airframe_of(FAST).turn_radius_m > 2.5 * config.airframe_of(SLOW).turn_radius_m


def test_a_name_without_its_table_is_refused_with_the_names_that_there_are():
    with pytest.raises(ConfigError) as error:
        parse(MIXED.replace('airframe = "fast"', 'airframe = "fats"'), "mixed.toml")
    assert "agents[1].airframe" in str(error.value)
    assert 'there is no table [airframes.fats]; there is "fast"' in str(error.value)
    with pytest.raises(ConfigError, match=r"airframes\.fast: unknown key `bank`: did you mean `bank_deg`"):
        parse(MIXED.replace("bank_deg = 30.0", "bank = 30.0"), "mixed.toml")


def test_simulated_vehicles_fly_as_their_airframes_say():
    run = VirtualRun(parse_scenario(MIXED, "mixed.toml"), 1)
    slow, fast = run.vehicles["vehicle:1"], run.vehicles["vehicle:2"]
    banks_rad = []
    run.on_event = lambda _event: banks_rad.append(abs(fast.airframe.roll_rad))
    run.run(60.0)
    assert math.radians(25.0) < max(banks_rad) <= math.radians(30.5)
    assert (slow.airframe.speed_m_s, fast.airframe.speed_m_s) == pytest.approx((13.0, 22.0), abs=0.5)


def test_a_simulated_vehicle_climbs_at_its_own_angle():
    (spec,) = [one for one in vehicle_specs(parse_scenario(MIXED, "mixed.toml"), 1) if one.system_id == FAST]
    plane = BankedAirframe(0.0, 0.0, 0.0, 0.0, 0.0)
    plane.limit_climb(math.radians(spec.climb_deg), spec.forward_speed_m_s)
    plane.is_climbing_out = True
    while plane.alt_rel_m < 40.0:
        plane.step(0.0, 100.0, spec.forward_speed_m_s)
    began_m = plane.north_m
    while plane.alt_rel_m < 80.0:
        plane.step(0.0, 100.0, spec.forward_speed_m_s)
    assert math.degrees(math.atan2(40.0, plane.north_m - began_m)) == pytest.approx(12.0, abs=0.5)


@pytest.mark.parametrize(("bank_deg", "radius_m"), [(45.0, 76.8), (10.0, 166.5)])
def test_circles_in_thin_air_are_planned_as_wide_as_arduplane_flies_them(bank_deg, radius_m):
    """A route was planned 60 m beside a circle of 60 m, which was flown with 71 m."""
    settings = f"[airframe]\nspeed_m_s = 15.0\nbank_deg = {bank_deg}\n[mission]\nloiter_radius_m = 60.0\n"
    config = parse(MIXED.split("[airframe]")[0].replace('airframe = "fast"\n', "") + settings, "thin.toml")
    airframe = config.airframe_of(SLOW)
    assert airframe.circle_radius_m == pytest.approx(max(60.0, airframe.turn_radius_m))
    assert airframe.at_height(2500.0).circle_radius_m == pytest.approx(radius_m, abs=0.5)
