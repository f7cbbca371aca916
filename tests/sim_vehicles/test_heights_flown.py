"""A mission that is safe over simulated ground would not be over real one.

`arduplane_climbs.csv` is a flight of ArduPlane 4.7-dev in SITL with its own parameters, at 1500 m above sea
level: legs due east that rise or fall, gently or more steeply than it climbs.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from helpers.ridged import RIDGE_EAST_M, VALLEY_MSL_M, ground, ridge

from gcs.geo import LocalFrame
from gcs.model import NS_PER_S
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.autopilots.mission_protocol import Item
from sim_vehicles.vehicle.faults import FaultKind
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

FRAME = LocalFrame(46.8, 9.8, 1500.0)
LEGS_M = [
    (600, 100), (1600, 100), (2200, 110), (3000, 110), (3800, 140), (4600, 140), (5200, 180), (6200, 180),
    (6500, 280), (7700, 280), (8500, 250), (9300, 250), (9900, 200), (10900, 200), (11200, 100), (12400, 100),
    (13400, 101),
]  # fmt: skip
WAYPOINT, LAND, TAKEOFF, LOITER = 16, 21, 22, 17
LEVEL_M = 0.0


def item(command: int, east_m: float, height_m: float, frame: int = 0, north_m: float = 0.0) -> Item:
    """An item at a height above the origin: in metres above sea level (frame 0) or above home (3)."""
    lat_deg, lon_deg = FRAME.to_geodetic(east_m, north_m)
    z = FRAME.alt_msl_m + height_m if frame == 0 else height_m
    return Item(command, frame, x=round(lat_deg * 1e7), y=round(lon_deg * 1e7), z=z)


class Flown:
    """A vehicle, and its track: time, east, height above the origin."""

    def __init__(self, *items: Item, elevation=None, **changes) -> None:
        given = {"airframe": "banked", "arming_delay_s": 0.0, "parameters": {}} | changes
        spec = VehicleSpec(1, 0.0, 0.0, math.pi / 2.0, 100.0, given.pop("speed_m_s", 20.0), **given)
        self.vehicle = SimVehicle(spec, FRAME, 0, elevation=elevation)
        pilot = self.vehicle.autopilot
        home = [item(WAYPOINT, 0.0, 0.0)] if spec.autopilot == "ardupilot" else []
        pilot.mission.replace([*home, *items])
        pilot.arm(0)
        pilot.set_mode(Mode.AUTO)
        self.rows: list[tuple[float, float, float]] = []

    def until(self, condition, most_s: float = 1500.0) -> np.ndarray:
        tenth = round(10 * (self.rows[-1][0] if self.rows else 0.0))
        while tenth < 10 * most_s and not (self.rows and condition(self.vehicle)):
            tenth += 1
            self.vehicle.advance(tenth * NS_PER_S // 10)
            self.rows.append((tenth / 10.0, self.vehicle.east_m, self.vehicle.alt_rel_m))
        assert condition(self.vehicle)
        return np.array(self.rows)


def at(track: np.ndarray, east_m: float) -> float:
    return float(np.interp(east_m, track[:, 1], track[:, 2]))


@pytest.mark.parametrize("airspeed_m_s", [25.8, 17.6])
def test_climbs_and_descents_are_flown_as_arduplane_flew_them(airspeed_m_s):
    with (Path(__file__).parent / "data/arduplane_climbs.csv").open() as lines:
        rows = [row for row in csv.DictReader(lines) if float(row["airspeed_m_s"]) == airspeed_m_s]
    flown = Flown(
        Item(TAKEOFF, 0, 15.0, z=FRAME.alt_msl_m + 90.0),
        *(item(WAYPOINT, *leg) for leg in LEGS_M),
        airborne=False,
        speed_m_s=airspeed_m_s,
        parameters={"ALT_SLOPE_MIN": float(rows[0]["alt_slope_min_m"]), "WP_RADIUS": 50.0},
    )
    track = flown.until(lambda vehicle: vehicle.east_m > 13_000.0)
    off_m = [at(track, float(row["east_m"])) - float(row["alt_rel_m"]) for row in rows]
    assert np.sqrt(np.mean(np.square(off_m))) < 1.5
    assert np.quantile(np.abs(off_m), 0.95) < 3.0


@pytest.mark.parametrize("frame", [0, 3])
def test_altitude_is_linear_along_a_leg_and_flown_with_a_lag_of_three_seconds(frame):
    flown = Flown(item(WAYPOINT, 500, 100, frame), item(WAYPOINT, 2500, 200, frame))
    track = flown.until(lambda vehicle: vehicle.east_m > 2000.0)
    assert at(track, 1500.0) == pytest.approx(150.0 - 3.0 * 20.0 * 100.0 / 2000.0, abs=0.5)


@pytest.mark.parametrize(("min_rise_m", "halfway_m"), [(15.0, 110.0), (1.0, 104.0), (0.0, 110.0)])
def test_a_small_rise_is_climbed_at_once_unless_the_parameter_says_otherwise(min_rise_m, halfway_m):
    flown = Flown(
        item(WAYPOINT, 500, 100), item(WAYPOINT, 1500, 110), parameters={"ALT_SLOPE_MIN": min_rise_m}
    )
    track = flown.until(lambda vehicle: vehicle.east_m > 1000.0)
    assert at(track, 1000.0) == pytest.approx(halfway_m, abs=1.0)


def test_px4_reaches_the_altitude_of_an_item_a_loiter_radius_before_it():
    items = [item(WAYPOINT, 500, 100), item(WAYPOINT, 2500, 200)]
    flown = Flown(*items, autopilot="px4", parameters={"NAV_LOITER_RAD": 200.0})
    track = flown.until(lambda vehicle: vehicle.east_m > 2450.0)
    rate = 20.0 * 100.0 / 1800.0
    assert at(track, 1400.0) == pytest.approx(150.0 - 3.0 * rate, abs=1.0)
    assert at(track, 2450.0) == pytest.approx(200.0, abs=0.5)


def test_a_vehicle_climbs_and_sinks_no_faster_than_its_airframe():
    items = [item(WAYPOINT, 500, 100), item(WAYPOINT, 1500, 300), item(WAYPOINT, 4500, 300)]
    items += [item(WAYPOINT, 5500, 100), item(LOITER, 9000, 100)]
    flown = Flown(*items, climb_m_s=2.5, sink_m_s=2.0)
    track = flown.until(lambda vehicle: vehicle.east_m > 8500.0)
    climb_m_s = np.diff(track[:, 2]) / np.diff(track[:, 0])
    assert climb_m_s.max() == pytest.approx(2.5, abs=0.05)
    assert climb_m_s.min() == pytest.approx(-2.0, abs=0.05)


# ------------------------------------------------------------ ground


def over(elevation):
    """The ground, with the frame's origin at sea level of the tests' ground."""
    return type(elevation)(
        elevation.origin_m, elevation.spacing_m, elevation.heights_msl_m - VALLEY_MSL_M + FRAME.alt_msl_m
    )


def test_a_vehicle_that_flies_into_a_ridge_is_a_wreck_there():
    """The crest is 150 m above the valley, and the route crosses it at 100 m."""
    flown = Flown(item(WAYPOINT, 2000, 100), elevation=over(ridge()))
    flown.until(lambda vehicle: vehicle.is_down)
    vehicle = flown.vehicle
    assert vehicle.autopilot.is_wreck
    assert RIDGE_EAST_M - 100.0 < vehicle.east_m < RIDGE_EAST_M
    assert vehicle.alt_rel_m == pytest.approx(100.0, abs=4.0)


def test_a_vehicle_that_flies_over_the_ridge_is_not():
    items = [item(WAYPOINT, 200, 100), item(WAYPOINT, 900, 190), item(WAYPOINT, 2000, 190)]
    flown = Flown(*items, elevation=over(ridge()))
    flown.until(lambda vehicle: vehicle.east_m > 1500.0)
    assert not flown.vehicle.is_down


def test_home_is_as_high_as_the_ground_there_and_below_it_a_valley_can_be_flown():
    slope = over(ground(lambda east, _: VALLEY_MSL_M + 300.0 - 0.1 * east))
    items = [item(WAYPOINT, 300, 100, 3), item(WAYPOINT, 2200, -100, 3), item(LOITER, 2300, -100, 3)]
    flown = Flown(*items, elevation=slope, home_rel_m=300.0)
    assert flown.vehicle.alt_rel_m == pytest.approx(400.0)
    track = flown.until(lambda vehicle: vehicle.east_m > 2150.0)
    assert not flown.vehicle.is_down
    assert at(track, 2150.0) == pytest.approx(300.0 - 100.0, abs=15.0)
    assert flown.vehicle.autopilot.height_agl_m == pytest.approx(200.0 - 85.0, abs=15.0)


def test_it_takes_off_and_lands_on_sloping_ground():
    slope = over(ground(lambda east, _: VALLEY_MSL_M + 0.01 * east))
    items = [
        Item(TAKEOFF, 3, 15.0, z=80.0),
        item(WAYPOINT, 1200, 130),
        item(WAYPOINT, 1800, 130),
        item(LAND, 900, 0.01 * 900.0, north_m=200.0),
    ]
    flown = Flown(*items, elevation=slope, airborne=False)
    flown.until(lambda vehicle: vehicle.autopilot.flying and vehicle.alt_rel_m > 60.0)
    track = flown.until(lambda vehicle: not vehicle.autopilot.flying)
    assert not flown.vehicle.is_down
    assert not flown.vehicle.autopilot.is_wreck
    assert track[-1, 2] == pytest.approx(0.01 * track[-1, 1], abs=2.0)


def test_without_thrust_it_comes_down_on_the_ground_below():
    slope = over(ground(lambda east, _: VALLEY_MSL_M + 0.04 * east))
    flown = Flown(item(WAYPOINT, 5000, 200), elevation=slope)
    flown.until(lambda vehicle: vehicle.east_m > 500.0)
    flown.vehicle.begin_fault(FaultKind.ENGINE)
    flown.until(lambda vehicle: vehicle.is_down)
    assert not flown.vehicle.autopilot.is_wreck
    assert flown.vehicle.alt_rel_m == pytest.approx(0.04 * flown.vehicle.east_m, abs=2.0)
