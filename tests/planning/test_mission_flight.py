"""An operator would confirm a plan by a clearance that is not flown."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from scipy.spatial import KDTree

from gcs.config.airframe import AgentAirframe
from gcs.core.tasking.mission_builder import mission_ahead
from gcs.geo import LocalFrame
from gcs.model import Route, read_only
from gcs.planning.forward_simulation import Motion
from gcs.planning.mission_flight import simulate_mission
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.autopilots.mission_protocol import Item
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

FRAME = LocalFrame(-35.3632621, 149.165237, 584.09)
STEP_NS = 10_000_000
HEIGHT_M = 100.0
RNG = np.random.default_rng(1)


def corners(turns_deg, leg_m):
    """Return corners `leg_m` apart, straight ahead of the origin first, and a long last leg."""
    places_m, course_rad = [np.array((0.0, 300.0))], 0.0
    for number, turn_deg in enumerate(turns_deg, start=1):
        course_rad += math.radians(turn_deg)
        ahead = np.array((math.sin(course_rad), math.cos(course_rad)))
        places_m.append(places_m[-1] + ahead * (leg_m if number < len(turns_deg) else 600.0))
    return read_only(places_m)


def flown(points_m, ahead, airframe, autopilot):
    """Return the way of a vehicle under its autopilot's guidance, up to the last waypoint, each 0.1 s."""
    spec = VehicleSpec(1, 0.0, 0.0, 0.0, HEIGHT_M, airframe.speed_m_s, autopilot=autopilot, airframe="banked")
    vehicle = SimVehicle(spec, FRAME, 0)
    pilot, places_m = vehicle.autopilot, []
    items = []
    for place_m, radius_m in zip(points_m.tolist(), ahead.radii_m, strict=True):
        lat_deg, lon_deg = FRAME.to_geodetic(*place_m)
        where = {"x": round(lat_deg * 1e7), "y": round(lon_deg * 1e7), "z": HEIGHT_M}
        items.append(Item(dialect.MAV_CMD_NAV_WAYPOINT, 3, param2=float(round(radius_m)), **where))
    home_items = int(autopilot == "ardupilot")
    pilot.mission.replace(items[:home_items] + items)
    pilot.set_mode(Mode.AUTO)
    for step in range(20_000):
        pilot.step(step * STEP_NS)
        if pilot.mode is not Mode.AUTO or pilot.seq - home_items >= len(points_m):
            break
        if step % 10 == 0:
            places_m.append((vehicle.east_m, vehicle.north_m))
    return np.array(places_m)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("turn_lag_s", [1.0, 1.5])
@pytest.mark.parametrize(
    ("turns_deg", "leg_m"),
    [((71, 71, 71), 106.0), ((60, -60), 80.0), ((90, -90), 80.0), ((107, -107), 120.0), ((107, 107), 200.0)],
)
def test_no_obstacle_beside_sharp_corners_is_nearer_to_the_flight_than_simulated(
    turns_deg, leg_m, turn_lag_s, autopilot
):
    """The vehicle follows the line of each leg, swings out behind a corner, or turns more tightly."""
    airframe = AgentAirframe(22.0, 35.0, turn_lag_s, 0.0, 20.0, 30.0, 30.0, 80.0, "loiter")
    points_m = corners(turns_deg, leg_m)
    ahead = mission_ahead(Route(1, (0, 0), points_m, 1.0), (0.0, 0.0), airframe)
    motion = Motion(0.0, 0.0, airframe.speed_m_s, 0.0)
    simulated_m = []
    for radius_m in (airframe.turn_radius_m, 0.0):
        flight = simulate_mission(motion, None, ahead, airframe.turn_lag_s, radius_m)
        simulated_m.append(flight.places_m[flight.passed < len(points_m)])
    way_m = flown(points_m, ahead, airframe, autopilot)
    assert len(way_m) > 300
    places_m = way_m.min() - 80.0 + RNG.random((4000, 2)) * (np.ptp(way_m, axis=0).max() + 160.0)
    is_near = abs(distance_m(places_m, way_m) - 35.0) < 25.0
    places_m = places_m[is_near]
    shown_m = np.minimum(*(distance_m(places_m, one) for one in simulated_m))
    assert (shown_m - distance_m(places_m, way_m)).max() < 6.0


def distance_m(places_m, way_m):
    """Return the distance of each place from a way, at most 60 m."""
    return KDTree(way_m).query(places_m, distance_upper_bound=60.0)[0].clip(max=60.0)
