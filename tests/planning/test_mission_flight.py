"""An operator would confirm a plan by a clearance that is not flown."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config.airframe import AgentAirframe
from gcs.core.tasking.mission_builder import mission_ahead
from gcs.geo import LocalFrame
from gcs.model import Route, read_only
from gcs.planning.forward_simulation import Motion
from gcs.planning.mission_flight import simulate_mission
from sim_vehicles.autopilots.base import Mode
from sim_vehicles.autopilots.mission_protocol import Item
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

FRAME = LocalFrame(-35.3632621, 149.165237, 584.09)
STEP_NS = 10_000_000
HEIGHT_M = 100.0


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
    [((71, 71, 71), 106.0), ((60, -60), 80.0), ((90, -90), 80.0), ((107, -107), 120.0), ((45, 45), 62.0)],
)
def test_sharp_corners_between_close_waypoints_are_flown_as_simulated(
    turns_deg, leg_m, turn_lag_s, autopilot
):
    """The vehicle follows the line of each leg, and swings out behind a corner: up to 17 m farther."""
    airframe = AgentAirframe(22.0, 35.0, turn_lag_s, 0.0, 20.0, 30.0, 30.0, 80.0, "loiter")
    points_m = corners(turns_deg, leg_m)
    ahead = mission_ahead(Route(1, (0, 0), points_m, 1.0), (0.0, 0.0), airframe)
    motion = Motion(0.0, 0.0, airframe.speed_m_s, 0.0)
    flight = simulate_mission(motion, None, ahead, airframe.turn_lag_s, airframe.turn_radius_m)
    simulated_m = flight.places_m[flight.passed < len(points_m)]
    way_m = flown(points_m, ahead, airframe, autopilot)
    assert len(way_m) > 300
    apart_m = np.hypot(*(way_m[:, None] - simulated_m[None]).transpose(2, 0, 1)).min(axis=1)
    assert apart_m.max() < 7.0
