"""Aircraft that are not ours, and that our vehicles receive by ADS-B, came near without a word."""

import numpy as np
import pytest
from helpers.played_vehicle import AIR, ARDUPLANE, PEER, Stage
from helpers.sky import Sky, fly_on
from helpers.staging import S
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Encoder
from gcs.model import Datagram, NoticeCode, Tick
from sim_vehicles.autopilots.autopilot_traits import Mode

GLIDER = 0x4CA2B1
FLAGS = (
    dialect.ADSB_FLAGS_VALID_COORDS
    | dialect.ADSB_FLAGS_VALID_ALTITUDE
    | dialect.ADSB_FLAGS_VALID_HEADING
    | dialect.ADSB_FLAGS_VALID_VELOCITY
)


def report(frame, east_m, north_m, alt_msl_m, *, speed_m_s=30.0, course_deg=0.0, icao=GLIDER, flags=FLAGS):
    lat_deg, lon_deg = frame.to_geodetic(east_m, north_m)
    return dialect.MAVLink_adsb_vehicle_message(
        icao, round(lat_deg * 1e7), round(lon_deg * 1e7), dialect.ADSB_ALTITUDE_TYPE_GEOMETRIC,
        round(alt_msl_m * 1e3), round(course_deg * 100.0), round(speed_m_s * 100.0), 0, b"D-KXYZ",
        dialect.ADSB_EMITTER_TYPE_GLIDER, 0, flags, 0,
    )  # fmt: skip


def pass_by(sky, begin_m, course_deg, for_s, speed_m_s=30.0):
    """Fly on while an aircraft passes at the height of vehicle 1; return its least distance from that."""
    frame, least_m = sky.run_.scenario.config.local_frame, np.inf
    for k in range(round(for_s)):
        east_m = begin_m[0] + speed_m_s * k * np.sin(np.deg2rad(course_deg))
        north_m = begin_m[1] + speed_m_s * k * np.cos(np.deg2rad(course_deg))
        message = report(frame, east_m, north_m, 130.0, course_deg=course_deg, speed_m_s=speed_m_s)
        sky.run_.engine.stages.air_traffic.receive(message, sky.run_.t_ns)
        plane = sky.planes[1]
        least_m = min(least_m, np.hypot(plane.east_m - east_m, plane.north_m - north_m))
        fly_on(sky, 1.0)
    return least_m


def test_an_aircraft_that_crosses_the_route_of_a_vehicle_is_told_and_the_vehicle_holds():
    """Both would be at one place in 40 s, the vehicle on its way north-east."""
    sky = fly_on(Sky((300.0, 300.0, 60.0), courses_deg=[45.0]), 10.0)
    plane = sky.planes[1]
    ahead = np.array((np.sin(plane.airframe.heading_rad), np.cos(plane.airframe.heading_rad)))
    begin_m = np.array((plane.east_m + 40.0 * 30.0, plane.north_m)) + 40.0 * 18.0 * ahead
    least_m = pass_by(sky, begin_m, 270.0, 70.0)
    near = sky.told(NoticeCode.AIRCRAFT_NEAR)
    assert 1 <= len(near) <= 2
    assert near[0][1].parameters["aircraft"] == "aircraft 4CA2B1 (D-KXYZ)"
    assert near[0][1].parameters["after_s"] >= 15.0
    assert sky.told(NoticeCode.AVOIDS)
    assert least_m > 60.0
    ((_, gone),) = sky.told(NoticeCode.AIRCRAFT_GONE)
    assert near[0][1].key in gone.ended
    assert plane.autopilot.mode is Mode.AUTO


def test_an_aircraft_far_above_is_not_told():
    sky = fly_on(Sky((300.0, 300.0, 60.0), courses_deg=[45.0]), 10.0)
    frame, plane = sky.run_.scenario.config.local_frame, sky.planes[1]
    for _ in range(5):
        message = report(frame, plane.east_m + 100.0, plane.north_m, 400.0)
        sky.run_.engine.stages.air_traffic.receive(message, sky.run_.t_ns)
        fly_on(sky, 1.0)
    assert not sky.told(NoticeCode.AIRCRAFT_NEAR)


def aircraft(stage):
    return stage.engine.state.separation.aircraft


def heard(stage, message):
    stage.hear(message)
    return aircraft(stage)


@pytest.fixture
def stage():
    return Stage(ARDUPLANE, "AUTO", armed=True, height_m=100.0, speed_m_s=18.0)


def test_an_aircraft_is_kept_once_and_forgotten_when_it_is_not_received_any_more(stage):
    frame = stage.engine.config.local_frame
    heard(stage, report(frame, 3000.0, 0.0, 200.0))
    (one,) = heard(stage, report(frame, 3000.0, 30.0, 200.0)).values()
    assert one.north_m == pytest.approx(30.0, abs=0.1)
    assert one.callsign == "D-KXYZ"
    for _ in range(17):
        stage.t_ns += S
        stage.step(Tick(stage.t_ns))
    assert not stage.engine.stages.air_traffic.flights(stage.t_ns)
    assert not aircraft(stage)


@pytest.mark.parametrize(
    ("icao", "flags", "east_m"),
    [
        (0xF00012, FLAGS, 3000.0),
        (GLIDER, FLAGS & ~dialect.ADSB_FLAGS_VALID_ALTITUDE, 3000.0),
        (GLIDER, FLAGS, 90_000.0),
    ],
)
def test_our_own_target_tracks_and_what_is_without_a_height_or_far_away_are_no_traffic(
    stage, icao, flags, east_m
):
    frame = stage.engine.config.local_frame
    assert not heard(stage, report(frame, east_m, 0.0, 200.0, icao=icao, flags=flags))


def test_the_transponder_of_one_of_our_vehicles_is_no_traffic(stage):
    state = stage.engine.stages.fleet.state(1)
    course_deg, frame = np.rad2deg(state.course_rad), stage.engine.config.local_frame
    own = report(
        frame, state.east_m + 5.0, state.north_m, state.alt_msl_m + 20.0,
        speed_m_s=state.ground_speed_m_s, course_deg=course_deg,
    )  # fmt: skip
    assert not heard(stage, own)


def test_no_more_than_64_aircraft_are_kept(stage):
    frame = stage.engine.config.local_frame
    for number in range(100):
        heard(stage, report(frame, 3000.0 + 10.0 * number, 0.0, 200.0, icao=GLIDER + number))
    assert len(aircraft(stage)) == 64


MAC = [0x0A, 0x1B, 0x2C, 0x3D, 0x4E, 0x5F] + [0] * 14
AIRBORNE, ON_GROUND = dialect.MAV_ODID_STATUS_AIRBORNE, dialect.MAV_ODID_STATUS_GROUND


def drone(frame, east_m, north_m, *, mac=MAC, status=AIRBORNE, baro_m=-1000.0, hae_m=200.0, speed_cm_s=1200):
    lat_deg, lon_deg = frame.to_geodetic(east_m, north_m)
    return dialect.MAVLink_open_drone_id_location_message(
        0, 0, mac, status, 9000, speed_cm_s, -50, round(lat_deg * 1e7), round(lon_deg * 1e7), baro_m, hae_m,
        0, -1000.0, 0, 0, 0, 0, 0.0, 0,
    )  # fmt: skip


def received(stage, message):
    """Hear a message of the receiver on vehicle 1, and not of its autopilot."""
    encode = Encoder(1, dialect.MAV_COMP_ID_ODID_TXRX_1)
    stage.step(Datagram(stage.t_ns, AIR, PEER, encode(message)))
    return aircraft(stage)


def named(serial, mac=MAC):
    text = list(serial.ljust(20, b"\0"))
    return dialect.MAVLink_open_drone_id_basic_id_message(0, 0, mac, 1, 2, text)


def test_a_drone_received_by_remote_id_is_traffic_with_its_serial_number(stage):
    frame = stage.engine.config.local_frame
    (one,) = received(stage, drone(frame, 3000.0, 50.0)).values()
    assert (one.east_m, one.north_m) == pytest.approx((3000.0, 50.0), abs=0.1)
    assert (one.alt_msl_m, one.height_error_m) == (200.0, 110.0)
    assert (one.speed_m_s, one.climb_m_s) == (12.0, -0.5)
    assert one.course_rad == pytest.approx(np.pi / 2)
    received(stage, named(b"1581F\x1b[2J"))
    ((number, one),) = received(stage, drone(frame, 3012.0, 50.0, baro_m=180.0)).items()
    assert one.callsign == "1581F\N{REPLACEMENT CHARACTER}[2J"
    assert (one.alt_msl_m, one.height_error_m) == (180.0, 100.0)
    name = stage.engine.stages.air_traffic.name(number)
    assert name.startswith("drone ")
    assert name.endswith("(1581F\N{REPLACEMENT CHARACTER}[2J)")
    assert len(aircraft(stage)) == 1


@pytest.mark.parametrize(
    "fields",
    [
        {"mac": [0] * 20},  # a vehicle describes itself to its transmitter
        {"status": ON_GROUND},
        {"hae_m": -1000.0},
        {"hae_m": float("nan")},
        {"east_m": 90_000.0},
    ],
)
def test_what_a_vehicle_says_of_itself_and_what_has_no_height_is_no_traffic(stage, fields):
    given = {"east_m": 3000.0, "north_m": 0.0} | fields
    assert not received(stage, drone(stage.engine.config.local_frame, **given))


def test_what_an_autopilot_says_is_of_its_own_vehicle(stage):
    assert not heard(stage, drone(stage.engine.config.local_frame, 3000.0, 0.0))


def test_unknown_speeds_of_a_drone_are_none(stage):
    (one,) = received(stage, drone(stage.engine.config.local_frame, 3000.0, 0.0, speed_cm_s=25_500)).values()
    assert one.speed_m_s == 0.0


def test_drones_are_bounded_with_the_other_aircraft(stage):
    frame = stage.engine.config.local_frame
    for number in range(100):
        received(stage, drone(frame, 3000.0 + 10.0 * number, 0.0, mac=[number + 1] * 20))
    assert len(aircraft(stage)) == 64


def test_a_drone_on_a_collision_course_is_told_and_the_vehicle_holds():
    """As an aircraft: both would be at one place in 40 s."""
    sky = fly_on(Sky((300.0, 300.0, 60.0), courses_deg=[45.0]), 10.0)
    plane, frame = sky.planes[1], sky.run_.scenario.config.local_frame
    for k in range(30):
        ahead_m = 18.0 * (30.0 - k)
        east_m = plane.east_m + ahead_m * np.sin(plane.airframe.heading_rad)
        north_m = plane.north_m + ahead_m * np.cos(plane.airframe.heading_rad)
        message = drone(frame, east_m, north_m, hae_m=130.0, speed_cm_s=0)
        sky.run_.engine.stages.air_traffic.receive(message, sky.run_.t_ns)
        fly_on(sky, 1.0)
    near = sky.told(NoticeCode.AIRCRAFT_NEAR)
    assert near
    assert near[0][1].parameters["aircraft"].startswith("drone ")
