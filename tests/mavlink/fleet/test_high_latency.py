"""A user would lose a vehicle whose radio is gone while its satellite link still works."""

import math

import numpy as np
import pytest
from helpers.noticed import noticed
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link, parse_endpoint
from gcs.geo import LocalFrame
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.router.router import Router
from gcs.model import NS_PER_S as S
from gcs.model import Datagram, NoticeCode
from sim_vehicles.vehicle.telemetry import Telemetry
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

FRAME = LocalFrame(-35.3632621, 149.165237, 584.0)
AIR_LINK = Link(parse_endpoint("udpin:0.0.0.0:1"))
RADIO, SATELLITE = "10.0.0.1:5001", "10.0.9.9:7001"
AP, PX4 = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_AUTOPILOT_PX4


def beat(mode=10):
    return dialect.MAVLink_heartbeat_message(1, AP, 1 | 128, mode, 4, 3)


def position(boot_s, east_m=0.0):
    lat, lon = FRAME.to_geodetic(east_m, 0.0)
    return dialect.MAVLink_global_position_int_message(
        round(boot_s * 1000), round(lat * 1e7), round(lon * 1e7), 684_000, 100_000, 0, 1500, 0, 9000
    )


def report(boot_s, east_m=0.0, *, autopilot=AP, mode=10, base=129 - 256, flags=0, eph=0, battery=70):
    lat, lon = FRAME.to_geodetic(east_m, 0.0)
    return dialect.MAVLink_high_latency2_message(
        round(boot_s * 1000), 1, autopilot, mode, round(lat * 1e7), round(lon * 1e7), 684, 684, 45, 45, 10,
        55, 75, 75, 75, 0, 0, eph, 0, 20, 0, battery, 3, flags, base, 0, 0,
    )  # fmt: skip


class Air:
    """One vehicle, heard at two addresses."""

    def __init__(self, *, kernel=True):
        self.fleet = Fleet([1], FRAME, kernel=kernel)
        self._encoders = {}
        self.notices = []

    def hear(self, t_s, *messages, peer=SATELLITE):
        encode = self._encoders.setdefault(peer, Encoder(1, 1))
        data = b"".join(encode(message) for message in messages)
        found = self.fleet.receive(Datagram(round(t_s * S), "udp", peer, data))
        self.notices += self.fleet.notices()
        return [message for _, message in found]

    def poll(self, t_s):
        sent = self.fleet.poll(round(t_s * S))
        self.notices += self.fleet.notices()
        return sent

    def told(self, *codes):
        return [one.code for one in noticed(self.notices, *codes)]

    @property
    def liveness(self):
        return self.fleet.health_of(1).liveness


def test_a_high_latency_report_alone_gives_position_mode_battery_and_item():
    air = Air()
    (heartbeat,) = air.hear(10, report(5, 250))
    state = air.fleet.state(1)
    assert (state.east_m, state.north_m) == pytest.approx((250, 0), abs=0.02)
    assert (state.alt_msl_m, state.ground_speed_m_s) == pytest.approx((684, 15))
    assert state.course_rad == pytest.approx(math.pi / 2)
    assert (state.mode, state.armed, state.mission_seq) == ("AUTO", True, 3)
    assert state.period_s > 0
    assert state.std_m > 50
    assert (heartbeat.get_type(), heartbeat.custom_mode) == ("HEARTBEAT", 10)
    readings = air.fleet.readings(1)
    assert (readings.battery_percent, readings.throttle_percent) == (70, 55)
    assert air.told(NoticeCode.IN_CONTACT, NoticeCode.HIGH_LATENCY) == ["in-contact", "high-latency"]


@pytest.mark.parametrize(
    ("speed_m_s", "throttle", "armed"), [(15, 55, True), (0, 55, True), (15, 0, True), (1, 0, False)]
)
def test_px4_does_not_say_whether_it_is_armed_and_counts_so_once_it_moves_or_has_throttle(
    speed_m_s, throttle, armed
):
    air = Air()
    for t_s, speed, percent in ((10, 0, 0), (76, speed_m_s, throttle), (142, 0, 0)):
        one = report(t_s, autopilot=PX4, mode=4 | 4 << 8, base=-128, eph=30)
        one.groundspeed, one.throttle = 5 * speed, percent
        air.hear(t_s, one)
        assert (air.fleet.state(1).mode, air.fleet.state(1).armed) == ("AUTO", armed and t_s > 10)


def test_failure_flags_are_those_of_sensors_that_the_vehicle_has():
    flags = (
        dialect.HL_FAILURE_FLAG_RC_RECEIVER | dialect.HL_FAILURE_FLAG_ESTIMATOR | dialect.HL_FAILURE_FLAG_GPS
    )
    estimate, rc = dialect.MAV_SYS_STATUS_AHRS, dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    air = Air()
    air.hear(10, report(5, flags=flags))
    assert air.fleet.readings(1).sensors_failed == estimate | dialect.MAV_SYS_STATUS_SENSOR_GPS
    assert air.fleet.readings(1).fix_type == dialect.GPS_FIX_TYPE_NO_FIX
    had_rc = dialect.MAVLink_sys_status_message(rc, rc, rc, 0, 12000, 0, 80, *[0] * 6)
    air = Air()
    air.hear(1, beat(), position(1), had_rc, peer=RADIO)
    air.hear(10, report(10, flags=flags))
    assert air.fleet.readings(1).sensors_failed == rc


@pytest.mark.parametrize("period_s", [5, 66])
def test_a_vehicle_is_alive_at_its_slow_rate_and_gets_no_requests_and_no_heartbeats(period_s):
    air = Air()
    for number in range(6):
        t_s = 100 + period_s * number
        air.hear(t_s, report(t_s, 15 * t_s - 1500))
        for later_s in range(1, period_s):
            assert air.poll(t_s + later_s) == []
            assert air.liveness == "alive"
    for later_s in range(1, 6 * period_s):
        air.poll(t_s + later_s)
    assert air.told(NoticeCode.LINK_STALE, NoticeCode.LINK_DOWN) == ["link-stale", "link-down"]
    assert not air.told(NoticeCode.HEARD_AGAIN, NoticeCode.NO_POSITION)


@pytest.mark.parametrize("kernel", [True, False])
def test_after_a_radio_loss_the_satellite_link_goes_on_and_the_radio_takes_over_again(kernel):
    air = Air(kernel=kernel)
    for tenth in range(100):
        air.hear(tenth / 10, beat(), position(tenth / 10, 1.5 * tenth), peer=RADIO)
    air.hear(9.95, report(9.95), peer=RADIO)
    assert not air.fleet.state(1).period_s, "usual telemetry says more"
    for t_s in (16, 21, 26):
        air.poll(t_s - 0.1)
        air.hear(t_s, report(t_s, 15 * t_s))
    assert air.fleet.state(1).east_m == pytest.approx(390, abs=0.1)
    assert air.fleet.state(1).period_s == 5
    air.hear(27, beat(), position(27, 405), peer=RADIO)
    state = air.fleet.state(1)
    assert (state.period_s, state.std_m) == (0, 0)
    assert air.fleet.health_of(1).address == ("udp", RADIO)
    assert air.told(NoticeCode.HIGH_LATENCY, NoticeCode.HIGH_LATENCY_OVER) == [
        "high-latency",
        "high-latency-over",
    ]
    assert not air.told(NoticeCode.ID_CONFLICT, NoticeCode.REBOOTED, NoticeCode.POSITION_JUMP)
    assert air.poll(27.1), "requests and heartbeats again"


def test_reports_elsewhere_do_not_take_a_vehicle_from_its_radio():
    air = Air()
    air.hear(1, beat(), position(1), peer=RADIO)
    air.hear(2, report(2, 90_000))
    assert air.fleet.health_of(1).address == ("udp", RADIO)
    assert air.told(NoticeCode.ID_CONFLICT) == ["id-conflict"]


def test_the_router_follows_from_radio_to_satellite_and_back():
    router = Router([AIR_LINK], [1])
    encode = Encoder(1, 1)

    def refusal(t_s, message, peer):
        return router.route_frame(
            round(t_s * S), (AIR_LINK.name, peer), scan(encode(message)).frame(0)
        ).refusal

    assert refusal(0, beat(), RADIO) == ""
    assert refusal(1, report(1), SATELLITE) == "heard elsewhere"
    assert refusal(6, report(6), SATELLITE) == ""
    assert refusal(7, beat(), RADIO) == ""
    assert refusal(8, report(8), SATELLITE) == "heard elsewhere"


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_simulated_vehicle_sends_what_its_usual_telemetry_says(autopilot):
    vehicle = SimVehicle(
        VehicleSpec(1, 300.0, -200.0, 1.0, 100.0, 15.0, autopilot=autopilot, gps_noise_std_m=0.0), FRAME, 0
    )
    telemetry = Telemetry(vehicle.autopilot, 0.0, np.random.default_rng(1))
    air, usual = Air(), Air()
    air.hear(30, telemetry.build(dialect.MAVLINK_MSG_ID_HIGH_LATENCY2, 30 * S))
    ids = dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
    usual.hear(30, *(telemetry.build(one, 30 * S) for one in ids))
    slow, fast = air.fleet.state(1), usual.fleet.state(1)
    assert (slow.east_m, slow.north_m) == pytest.approx((fast.east_m, fast.north_m))
    assert slow.alt_msl_m == pytest.approx(fast.alt_msl_m, abs=0.5)
    assert slow.ground_speed_m_s == pytest.approx(fast.ground_speed_m_s, abs=0.1)
    assert (slow.mode, slow.mission_seq) == (fast.mode, 0)
