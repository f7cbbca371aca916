"""A vehicle would be blown into an obstacle from a route that is clear in still air."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from scipy.spatial import KDTree

from gcs.config.airframe import AgentAirframe
from gcs.core.tasking.mission_builder import corners_of, mission_ahead
from gcs.geo import LocalFrame
from gcs.model import Route, read_only
from gcs.planning.flight_variants import flight_variants
from gcs.planning.forward_simulation import (
    HEADING_S,
    L1_S,
    LoiterCircle,
    Motion,
    RemainingMission,
    predict_motion,
    simulate,
)
from gcs.planning.mission_flight import NOWHERE
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.autopilots.mission_protocol import Item
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

FRAME = LocalFrame(-35.3632621, 149.165237, 584.09)
HEIGHT_M = 100.0
SPEED_M_S = 15.0
WIND_M_S = 4.5
STEP_NS = 10_000_000
AIRFRAME = AgentAirframe(SPEED_M_S, 30.0, 1.0, 5.6, 20.0, 30.0, 10.0, 80.0, "loiter")
LAWS = {"banked": L1_S, "paper": -HEADING_S}


def corners(turns_deg, leg_m):
    places_m, course_rad = [np.array((0.0, 300.0))], 0.0
    for number, turn_deg in enumerate(turns_deg, start=1):
        course_rad += math.radians(turn_deg)
        ahead = np.array((math.sin(course_rad), math.cos(course_rad)))
        places_m.append(places_m[-1] + ahead * (leg_m if number < len(turns_deg) else 500.0))
    return read_only(places_m)


def at(place_m):
    lat_deg, lon_deg = FRAME.to_geodetic(*place_m)
    return {"x": round(lat_deg * 1e7), "y": round(lon_deg * 1e7), "z": HEIGHT_M}


def flown(points_m, radii_m, kind, wind_m_s, circle=None, circle_s=0.0):
    """Return the way of a simulated vehicle in steady wind up to the last waypoint, each 0.1 s.

    With a loiter circle behind that, up to `circle_s` afterwards.
    """
    spec = VehicleSpec(1, 0.0, 0.0, 0.0, HEIGHT_M, SPEED_M_S, airframe=kind)
    vehicle = SimVehicle(spec, FRAME, 0)
    pilot, places_m = vehicle.autopilot, []
    items = []
    for place_m, radius_m in zip(points_m.tolist(), radii_m, strict=True):
        items.append(Item(dialect.MAV_CMD_NAV_WAYPOINT, 3, param2=float(round(radius_m)), **at(place_m)))
    left_steps = round(circle_s * 1e9 / STEP_NS)
    if circle is not None:
        place = at(circle.centre_m)
        items.append(Item(dialect.MAV_CMD_NAV_LOITER_UNLIM, 3, param3=circle.radius_m, **place))
    pilot.mission.replace(items[:1] + items)
    vehicle.airframe.wind_east_m_s, vehicle.airframe.wind_north_m_s = wind_m_s
    pilot.set_mode(Mode.AUTO)
    for step in range(20_000):
        pilot.step(step * STEP_NS)
        if pilot.mode is not Mode.AUTO or pilot.seq > len(points_m):
            left_steps -= 1
            if left_steps < 0:
                break
        if step % 10 == 0:
            places_m.append((vehicle.east_m, vehicle.north_m))
    return np.array(places_m)


@pytest.mark.parametrize("towards_deg", [20.0, 110.0, 200.0, 290.0])
@pytest.mark.parametrize(("kind", "turn_lag_s"), [("banked", 1.0), ("paper", 2.8)])
@pytest.mark.parametrize(("turns_deg", "leg_m"), [((90, -90, 60), 150.0), ((120, -120, 90), 300.0)])
def test_what_is_flown_in_wind_is_among_the_simulated_flights(
    turns_deg, leg_m, kind, turn_lag_s, towards_deg
):
    angle = math.radians(towards_deg)
    wind_m_s = (WIND_M_S * math.sin(angle), WIND_M_S * math.cos(angle))
    airframe = AgentAirframe(SPEED_M_S, 30.0, turn_lag_s, 5.6, 20.0, 30.0, 10.0, 80.0, "loiter")
    points_m = corners(turns_deg, leg_m)
    ahead = mission_ahead(Route(1, (0, 0), points_m, 1.0), (0.0, 0.0), airframe)
    way_m = flown(points_m, ahead.radii_m, kind, wind_m_s)
    begins_rad = math.atan2(wind_m_s[0], SPEED_M_S + wind_m_s[1])
    motion = Motion(0.0, 0.0, SPEED_M_S, begins_rad, ahead=ahead)
    lags_s = {
        lag_s
        for lag_s, rate, law, *_ in flight_variants(corners_of(airframe), turn_lag_s, SPEED_M_S).tolist()
        if law == LAWS[kind] and rate == math.inf
    }
    (lag_s,) = lags_s
    states = simulate(NOWHERE, motion, 0.1 * len(way_m), lag_s, l1_s=LAWS[kind], wind_m_s=wind_m_s).states
    simulated_m = states[states[:, 4] < len(points_m), :2]
    between_m = np.concatenate(
        [simulated_m[:-1] + share * np.diff(simulated_m, axis=0) for share in (0.0, 0.3, 0.7)]
    )
    assert len(way_m) > 300
    assert KDTree(between_m).query(way_m)[0].max() < 8.0


@pytest.mark.parametrize("turn_deg", [-100, 60])
@pytest.mark.parametrize(
    ("strength_m_s", "towards_deg"), [(0.0, 0.0), (8.0, 20.0), (8.0, 110.0), (8.0, 200.0), (8.0, 290.0)]
)
def test_a_route_starts_where_its_vehicle_will_be_after_a_turn(strength_m_s, towards_deg, turn_deg):
    """Over Davos a route began 36 m beside its vehicle, which then flew 11 m too low over a slope."""
    angle = math.radians(towards_deg)
    wind_m_s = (strength_m_s * math.sin(angle), strength_m_s * math.cos(angle))
    airframe = AgentAirframe(SPEED_M_S, 35.0, 1.0, strength_m_s, 20.0, 30.0, 10.0, 80.0, "loiter")
    points_m = corners((turn_deg, -turn_deg, 60), 300.0)
    ahead = mission_ahead(Route(1, (0, 0), points_m, 1.0), (0.0, 0.0), airframe)
    way_m = flown(points_m, ahead.radii_m, "banked", wind_m_s)
    to_corner_m = np.hypot(*(way_m - ahead.points_m[0]).T)
    begin = int(np.argmax(to_corner_m < ahead.radii_m[0] + 25.0))
    east_m_s, north_m_s = (way_m[begin] - way_m[begin - 1]) / 0.1
    speed_m_s = math.hypot(east_m_s, north_m_s)
    motion = Motion(*way_m[begin].tolist(), speed_m_s, math.atan2(east_m_s, north_m_s), ahead=ahead)
    there = predict_motion(NOWHERE, motion, 4.5, 1.0, wind_m_s, airframe.still_air_radius_m)
    assert math.dist(there.place_m, way_m[begin + 45]) < 6.0
    assert there.speed_m_s == pytest.approx(10.0 * math.dist(way_m[begin + 45], way_m[begin + 44]), abs=1.5)


@pytest.mark.parametrize("towards_deg", [20.0, 110.0, 200.0, 290.0])
@pytest.mark.parametrize(("kind", "turn_lag_s"), [("banked", 1.0), ("paper", 2.8)])
@pytest.mark.parametrize("aside_deg", [-60.0, 40.0, 90.0])
def test_way_onto_a_distant_circle_is_among_the_simulated_flights(aside_deg, kind, turn_lag_s, towards_deg):
    """Autopilots fly along the line to its centre: an obstacle on that line is in the way."""
    angle = math.radians(towards_deg)
    wind_m_s = (WIND_M_S * math.sin(angle), WIND_M_S * math.cos(angle))
    aside = math.radians(aside_deg)
    centre_m = (300.0 * math.sin(aside), 400.0 + 300.0 * math.cos(aside))
    circle = LoiterCircle(centre_m, 75.0)
    ahead = RemainingMission(((0.0, 200.0), (0.0, 400.0)), (20.0, 20.0), circle=circle)
    way_m = flown(np.array(ahead.points_m), ahead.radii_m, kind, wind_m_s, circle, circle_s=30.0)
    begins_rad = math.atan2(wind_m_s[0], SPEED_M_S + wind_m_s[1])
    motion = Motion(0.0, 0.0, SPEED_M_S, begins_rad, ahead=ahead)
    (lag_s,) = {
        lag_s
        for lag_s, rate, law, *_ in flight_variants(corners_of(AIRFRAME), turn_lag_s, SPEED_M_S).tolist()
        if law == LAWS[kind] and rate == math.inf
    }
    states = simulate(NOWHERE, motion, 90.0, lag_s, l1_s=LAWS[kind], wind_m_s=wind_m_s).states
    assert math.dist(way_m[-1], ahead.points_m[-1]) > 200.0
    assert KDTree(states[:, :2]).query(way_m)[0].max() < 10.0


def test_in_still_air_no_flights_in_wind_are_simulated():
    calm = AgentAirframe(SPEED_M_S, 30.0, 1.0, 0.0, 20.0, 30.0, 10.0, 80.0, "loiter")
    assert len(flight_variants(corners_of(calm), 1.0, SPEED_M_S)) == 2
