"""A user would lose the true picture of the fleet: to unknown systems, spoofers, late frames or link loss."""

import math

import numpy as np
import pytest
from helpers.noticed import alarms, noticed
from helpers.plane_double import AUTO, LOITER, Channel, Plane, S, upload_task
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link, parse_endpoint
from gcs.geo import LocalFrame
from gcs.mavlink.fleet.fleet import TRAFFIC, Fleet, FleetSettings
from gcs.mavlink.fleet.notice_queue import RepeatLimit
from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Encoder, decode
from gcs.mavlink.mission.items import Home
from gcs.model import Datagram, Mission, NoticeCode, Waypoint

FRAME = LocalFrame(-35.3632621, 149.165237, 584.0)
HERE, THERE = "127.0.0.1:5001", "127.0.0.1:6666"


def beat(mode=AUTO, *, armed=True, autopilot=3, kind=1):
    return dialect.MAVLink_heartbeat_message(kind, autopilot, 1 | (128 if armed else 0), mode, 4, 3)


def position(boot_s, east_m=0.0, north_m=0.0, v_east=0.0, v_north=0.0, hdg=65535):
    lat, lon = FRAME.to_geodetic(east_m, north_m)
    fields = (
        round(lat * 1e7),
        round(lon * 1e7),
        684_000,
        100_000,
        round(v_north * 100),
        round(v_east * 100),
        0,
    )
    return dialect.MAVLink_global_position_int_message(round(boot_s * 1000), *fields, hdg)


class Air:
    """Senders on one link, by system id, into a fleet."""

    def __init__(self, *expected, settings=None):
        self.fleet = Fleet(expected or (1, 2), FRAME, settings)
        self._encoders = {}

    def hear(self, t_s, *messages, system_id=1, component_id=1, peer=HERE):
        encode = self._encoders.setdefault((system_id, component_id, peer), Encoder(system_id, component_id))
        data = b"".join(encode(m) for m in messages)
        return self.fleet.receive(Datagram(round(t_s * S), "udp", peer, data))

    def poll(self, t_s):
        return [(send.peer, decode(send.data)[0][0]) for send in self.fleet.poll(round(t_s * S))]

    def told(self, level=None):
        """Return code and vehicle of each new notice."""
        return [(one.code, one.vehicle) for one in self.fleet.notices() if level in (None, one.level)]

    def health(self, system_id=1):
        return next(h for h in self.fleet.health() if h.system_id == system_id)


# ---------------------------------------------------------------- what a vehicle says


def test_a_vehicles_reports_become_its_state_in_the_local_frame():
    air = Air()
    accepted = air.hear(
        10, beat(), position(1, 250, -400, v_east=3, v_north=-4), dialect.MAVLink_mission_current_message(5)
    )
    state = air.fleet.state(1)
    assert [(system_id, m.get_type()) for system_id, m in accepted] == [
        (1, "HEARTBEAT"),
        (1, "MISSION_CURRENT"),
    ]
    assert (state.east_m, state.north_m) == pytest.approx((250, -400), abs=0.02)
    assert (state.alt_msl_m, state.ground_speed_m_s) == pytest.approx((684, 5))
    assert state.course_rad == pytest.approx(math.atan2(3, -4))
    assert (state.t_ns, state.mode, state.armed, state.mission_seq) == (10 * S, "AUTO", True, 5)
    assert air.fleet.states() == (state,)
    assert air.fleet.state(2) is None


def test_mode_and_arming_changes_are_reported():
    air = Air()
    air.hear(0, beat(0, armed=False))
    air.told()
    air.hear(1, beat(AUTO, armed=True))
    mode, armed = air.fleet.notices()
    assert (mode.code, mode.parameters) == (NoticeCode.MODE_CHANGED, {"before": "MANUAL", "mode": "AUTO"})
    assert (armed.code, armed.vehicle) == (NoticeCode.ARMED, 1)


def test_a_vehicle_that_arms_and_disarms_all_the_time_does_not_flood_the_operator():
    air, limit, told = Air(1), RepeatLimit(), []
    for step in range(1200):
        air.hear(0.05 * step, beat(armed=step % 2 == 0))
        told += filter(limit.admit, air.fleet.notices())
        told += limit.summaries(round(0.05 * step * S))
    flickers = [n for n in told if n.code in (NoticeCode.ARMED, NoticeCode.DISARMED)]
    assert len(flickers) <= 2 * (5 + 6)
    assert [n.code for n in flickers[:2]] == [NoticeCode.DISARMED, NoticeCode.ARMED]
    assert any(90 <= n.parameters.get("more_count", 0) <= 99 for n in flickers)
    for step in range(1200, 1700):
        limit.summaries(round(0.05 * step * S))
    air.hear(85.0, beat(armed=False))
    air.hear(85.1, beat(armed=True))
    (*_, last) = filter(limit.admit, air.fleet.notices())
    assert (last.code, last.parameters) == (NoticeCode.ARMED, {})


def test_a_vehicle_that_changes_its_type_is_an_alarm_and_a_copter_is_not_tasked():
    air = Air(1)
    air.hear(0.0, beat())
    air.poll(0.0)
    assert not noticed(air.fleet.notices(), NoticeCode.TYPE_CHANGED)
    air.hear(1.0, beat(kind=2))
    changed, *others = alarms(air.fleet.notices())
    assert changed.code is NoticeCode.TYPE_CHANGED
    assert changed.parameters == {
        "autopilot": 3, "vehicle_type": 2, "autopilot_before": 3, "vehicle_type_before": 1,
    }  # fmt: skip
    assert noticed(others, NoticeCode.FIRMWARE_UNKNOWN)
    assert air.fleet.profile(1) is None
    air.hear(2.0, beat())
    assert air.fleet.profile(1) is not None


@pytest.mark.parametrize("v_east", [-20.0, 20.0])
def test_a_vehicle_whose_velocity_contradicts_its_positions_is_an_alarm(v_east):
    air, codes = Air(1), set()
    air.hear(0.0, beat())
    for k in range(60):
        air.hear(0.25 * k, position(0.25 * k, 5.0 * k, v_east=v_east))
        air.poll(0.25 * k)
        codes |= {code for code, _ in air.told("alarm")}
    assert codes == ({NoticeCode.VELOCITY_WRONG} if v_east < 0.0 else set())


def test_px4_modes_have_the_same_names():
    air = Air()
    air.hear(0, beat(4 << 16 | 4 << 24, autopilot=12), position(1))
    assert air.fleet.state(1).mode == "AUTO"


def test_a_vehicle_that_stands_still_has_its_compass_heading():
    air = Air()
    air.hear(0, beat(), position(1, hdg=27000))
    assert air.fleet.state(1).course_rad == pytest.approx(-math.pi / 2)


def test_status_texts_reach_the_operator_but_cannot_flood_him():
    air = Air()
    air.hear(0, beat())
    air.told()
    air.hear(1, *(dialect.MAVLink_statustext_message(2, b"Engine failure") for _ in range(500)))
    said = noticed(air.fleet.notices(), NoticeCode.AUTOPILOT_ALARM)
    assert [(one.vehicle, one.parameters["said"]) for one in said] == [(1, "Engine failure")] * 5


def told(times_s, *texts, armed=False, v_east=0.0):
    """Return the alarms about a vehicle that says these texts in turn."""
    air = Air()
    air.hear(0, beat(armed=armed), position(0, v_east=v_east))
    air.told()
    for number, t_s in enumerate(times_s):
        text = texts[number % len(texts)].encode()
        report = position(t_s, east_m=v_east * t_s, v_east=v_east)
        air.hear(t_s, beat(armed=armed), report, dialect.MAVLink_statustext_message(2, text))
    said = [one.parameters["said"] for one in noticed(air.fleet.notices(), NoticeCode.AUTOPILOT_ALARM)]
    return [text for text in said if text in texts]


def test_a_wreck_that_repeats_why_it_cannot_fly_is_told_once():
    """The alarm of a vehicle in the air would be lost among those of one that lies in a field."""
    pitch, heading = "Preflight Fail: Attitude failure (pitch)", "Preflight Fail: heading estimate not stable"
    assert told(range(3, 900, 3), pitch, heading) == [pitch, heading]
    leaning = [f"PreArm: AHRS: EKF3 Roll/Pitch inconsistent {angle} deg" for angle in (31, 32, 35)]
    assert told(range(30, 900, 30), *leaning) == leaning[:1]


def test_another_sensor_and_a_reason_that_comes_again_are_told_on_the_ground():
    first, second = "Preflight Fail: Accel 0 uncalibrated", "Preflight Fail: Accel 1 uncalibrated"
    assert told((10, 11), first, second) == [first, second]
    assert told((10, 200), first) == [first, first]


def test_a_text_that_comes_again_in_the_air_is_told():
    assert told((10, 20, 30), "Low battery", armed=True, v_east=15.0) == ["Low battery"] * 3


# ---------------------------------------------------------------- whom to believe


def test_the_report_of_a_radio_is_noted_and_is_no_unknown_system():
    """Before, a radio with SiK firmware was the unknown system 51, and its signal was not shown."""
    air = Air(1, 51)
    report = dialect.MAVLink_radio_status_message(180, 170, 98, 40, 45, 3, 0)
    air.hear(1.0, report, system_id=51, component_id=68)
    assert air.fleet.counters.unknown_systems == 0
    assert air.told() == []
    (radio,) = air.fleet.radios.values()
    assert (radio.signal, radio.noise, radio.remote_signal, radio.remote_noise) == (180, 40, 170, 45)
    assert (radio.free_percent, radio.errors) == (98, 3)
    assert air.health(51).liveness == "waiting"
    air.hear(2.0, report, system_id=51)
    assert air.fleet.radios["udp"].t_ns == S, "an autopilot is no radio"


def test_reports_that_wait_longer_and_longer_in_a_radio_are_told():
    air = Air()
    for k in range(120):
        delay_s = min(0.2 * max(k - 40, 0), 3.0)
        air.hear(10.0 + 0.5 * k + delay_s, beat(), position(0.5 * k))
        air.poll(10.0 + 0.5 * k + delay_s)
    assert [code for code, _ in air.told("warning")] == [NoticeCode.REPORTS_LATE]


def test_unknown_systems_are_counted_and_shown_but_never_acted_on():
    air = Air(settings=FleetSettings(max_unknown_systems=8))
    for system in range(10, 60):
        assert air.hear(0, beat(), position(1), system_id=system, peer=f"10.0.0.{system}:1") == []
    assert air.fleet.states() == ()
    assert air.fleet.counters.unknown_systems == 100
    assert len(air.fleet.unknown_systems()) == 8
    assert air.poll(1) == []


def test_a_ground_station_with_a_vehicles_id_is_not_the_vehicle():
    air = Air()
    air.hear(0, beat(kind=dialect.MAV_TYPE_GCS, autopilot=8), position(1))
    assert air.health().liveness == "waiting"
    assert air.fleet.state(1) is None


def test_a_payload_of_the_vehicle_does_not_speak_for_it():
    air = Air()
    air.hear(0, beat(), position(1, 10, 0))
    assert air.hear(1, beat(LOITER), position(2, 500, 0), component_id=154) == []
    assert air.fleet.state(1).east_m == pytest.approx(10, abs=0.02)
    assert air.fleet.state(1).mode == "AUTO"


def test_another_address_that_claims_a_living_vehicle_is_a_conflict():
    air = Air()
    air.hear(0, beat(), position(1, 10, 0))
    assert air.hear(3, beat(LOITER), position(4, 900, 0), peer=THERE) == []
    assert air.fleet.state(1).east_m == pytest.approx(10, abs=0.02)
    assert air.health().conflicts == 2
    assert [one.vehicle for one in noticed(air.fleet.notices(), NoticeCode.ID_CONFLICT)] == [1]
    assert {peer for peer, _ in air.poll(3.1)} == {HERE}


def test_after_a_link_loss_a_vehicle_may_come_back_from_another_address():
    air = Air()
    air.hear(0, beat(), position(1, 10, 0))
    air.poll(0)
    assert air.hear(6, position(7, 20, 0), peer=THERE) == []
    air.hear(6.1, beat(), position(7.1, 30, 0), peer=THERE)
    assert air.fleet.state(1).east_m == pytest.approx(30, abs=0.02)
    assert {peer for peer, _ in air.poll(6.2)} == {THERE}


@settings(max_examples=300, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_damaged_or_random_datagrams_never_move_a_vehicle(seed, random_bytes):
    rng = np.random.default_rng(seed)
    air = Air()
    air.hear(0, beat(), position(1, 10, 0))
    before = air.fleet.state(1)
    if random_bytes:
        data = rng.bytes(int(rng.integers(0, 400)))
    else:
        data = bytearray(Encoder(1, 1)(position(2, 700, 0)))
        data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 256))
        data = bytes(data[: int(rng.integers(1, len(data) + 1))])
    air.fleet.receive(Datagram(S, "udp", HERE, data))
    assert air.fleet.state(1) == before
    assert air.fleet.counters.bad_bytes + air.fleet.counters.unknown_ids > 0 or not data


# ---------------------------------------------------------------- positions not to believe


@pytest.mark.parametrize(
    ("report", "reason"),
    [
        ({"lat": 1000, "lon": -300}, "null"),
        ({"lat": 910_000_000}, "range"),
        ({"lon": -1_810_000_000}, "range"),
        ({"alt": 2_000_000_000}, "range"),
        ({"lat": -343_632_621}, "far"),
        ({"lat": 353_632_621, "lon": -308_347_630}, "far"),
    ],
)
def test_a_position_that_cannot_be_true_is_refused_and_counted(report, reason):
    """The last one is the other side of the Earth, which is at (0, 0) on the tangent plane."""
    air = Air()
    message = position(1)
    for field, value in report.items():
        setattr(message, field, value)
    air.hear(0, beat(), message)
    assert air.fleet.state(1) is None
    assert air.health().refused == {reason: 1}


def test_before_its_first_fix_a_vehicle_is_nowhere_but_later_gaps_are_bridged():
    air = Air()

    def gps(fix):
        return dialect.MAVLink_gps_raw_int_message(0, fix, 0, 0, 0, 0, 0, 0, 0, 10)

    air.hear(0, beat(), gps(1), position(1, 10, 0))
    assert air.fleet.state(1) is None
    air.hear(1, gps(3), position(2, 20, 0))
    air.hear(2, gps(1), position(3, 30, 0))
    assert air.fleet.state(1).east_m == pytest.approx(30, abs=0.02)
    assert air.health().refused == {"no fix": 1}


def test_late_reports_do_not_move_a_vehicle_back():
    air = Air()
    air.hear(0, beat(), position(100, 10, 0))
    for n in range(40):
        air.hear(0.25 * n, position(100 + 0.25 * n, 10 + n, 0))
        air.hear(0.25 * n + 0.01, position(70 + 0.25 * n, -900, 0))
        assert air.fleet.state(1).east_m == pytest.approx(10 + n, abs=0.02)
    assert air.health().boots == 0
    assert air.health().refused["late"] == 41


def test_a_burst_of_delayed_reports_is_not_a_reboot():
    air = Air()
    air.hear(0, beat(), position(100, 10, 0))
    for n in range(30):
        air.hear(0.01 * n, position(80 + 0.5 * n, -900, 0))
    assert air.health().boots == 0


def test_a_reboot_is_recognised_and_everything_is_asked_for_again():
    air = Air()
    air.hear(0, beat(), position(1000, 10, 0), dialect.MAVLink_mission_current_message(4))
    air.told()
    for n in range(16):
        air.hear(3 + 0.25 * n, beat(0), position(2 + 0.25 * n, 50 + n, 0))
    state = air.fleet.state(1)
    assert state.east_m == pytest.approx(65, abs=0.02)
    assert state.mission_seq == -1
    assert air.health().boots == 1
    assert (NoticeCode.REBOOTED, 1) in air.told()


def test_one_report_from_the_future_does_not_freeze_a_vehicle():
    air = Air()
    air.hear(0, beat(), position(10, 0, 0), position(90_000, 5, 0))
    for n in range(20):
        air.hear(0.25 * n, position(10 + 0.25 * n, n, 0))
    assert air.fleet.state(1).east_m == pytest.approx(19, abs=0.02)


# ---------------------------------------------------------------- link loss


def test_gaps_count_as_loss_and_late_frames_do_not():
    air = Air()
    encode = Encoder(1, 1)
    frames = [encode(beat()) for _ in range(300)]
    for n in [0, 1, 3, 2, 6, 6, *range(7, 299)]:
        air.fleet.receive(Datagram(n, "udp", HERE, frames[n]))
    assert air.health().lost == 2


def test_a_link_loss_is_reported_once_and_so_is_the_return():
    air = Air()
    for n in range(3):
        air.hear(n, beat(), system_id=1)
        air.hear(n, beat(), system_id=2, peer=THERE)
    air.told()
    for n in range(3, 20):
        air.hear(n, dialect.MAVLink_mission_current_message(1), system_id=2, peer=THERE)
        air.poll(n)
        if n == 6:
            assert air.health().liveness == "stale"
    found = [(one.code, one.vehicle, one.parameters["silence_s"]) for one in air.fleet.notices()]
    assert found == [(NoticeCode.LINK_STALE, 1, 3.0), (NoticeCode.LINK_DOWN, 1, 6.0)]
    assert [h.liveness for h in air.fleet.health()] == ["down", "alive"]
    air.hear(20, beat())
    (again,) = noticed(air.fleet.notices(), NoticeCode.HEARD_AGAIN)
    assert (again.vehicle, again.parameters["silence_s"]) == (1, 18.0)
    assert air.health().liveness == "alive"


# ---------------------------------------------------------------- what is sent


def test_a_low_battery_in_flight_is_reported_once_for_each_limit():
    air = Air()
    low, critical = NoticeCode.BATTERY_LOW, NoticeCode.BATTERY_CRITICAL
    risen = NoticeCode.BATTERY_RISEN

    def notices(t_s, percent, *, armed=True):
        status = dialect.MAVLink_sys_status_message(0, 0, 0, 180, 11_000, 0, percent, 0, 0, 0, 0, 0, 0)
        air.hear(t_s, beat(armed=armed), status)
        air.poll(t_s)
        told = noticed(air.fleet.notices(), low, critical, risen)
        return [(notice.code, notice.parameters["charge_percent"]) for notice in told]

    assert notices(1, 31) == []
    assert notices(2, 29) == [(low, 29)]
    assert notices(3, 31) == notices(4, 29) == [], "a load on the battery is no news"
    assert notices(5, -1) == [], "unknown"
    assert notices(6, 14) == [(critical, 14)]
    assert notices(7, 20) == notices(8, 14) == []
    assert notices(9, 95) == [(risen, 95)]
    assert notices(10, 10) == [(critical, 10)]
    assert notices(11, 10, armed=False) == [], "on the ground the preflight check tells"
    assert notices(12, 28) == [(low, 28)]


def test_each_known_address_gets_four_heartbeats_a_second_so_that_losses_start_no_failsafe():
    air = Air(1, 2, 3)
    for system_id, peer in ((1, HERE), (2, HERE), (3, THERE)):
        air.hear(0, beat(), system_id=system_id, peer=peer)
    beats = [peer for n in range(200) for peer, m in air.poll(0.05 * n) if m.get_type() == "HEARTBEAT"]
    assert (beats.count(HERE), beats.count(THERE)) == (40, 40)


def together(air, plane, loss, seconds, on_message=None, each_step=None):
    """Join a fleet and a plane over two channels; the two functions return frames for the plane."""
    up, down = Channel(1, loss=loss), Channel(2, loss=loss)
    for n in range(seconds * 20):
        t_ns = n * S // 20
        for frame in up.get(t_ns):
            down.put(plane.receive(frame, t_ns), t_ns)
        down.put(plane.poll(t_ns), t_ns)
        for frame in down.get(t_ns):
            for _, message in air.fleet.receive(Datagram(t_ns, "udp", HERE, frame)):
                up.put(on_message(message, t_ns) if on_message else [], t_ns)
        if n % 5 == 0:
            air.fleet.receive(Datagram(t_ns, "udp", HERE, plane._encode(position(n / 20))))
        up.put([send.data for send in air.fleet.poll(t_ns)], t_ns)
        up.put(each_step(t_ns) if each_step else [], t_ns)


@pytest.mark.parametrize("loss", [0.0, 0.4])
def test_on_contact_it_asks_for_rates_version_and_home_until_it_has_them(loss):
    plane, air, asked = Plane(1), Air(), []
    command_long = plane._on_command_long

    def listens(message, sender, t_ns):
        asked.append((message.command, message.param1, message.param2))
        return command_long(message, sender, t_ns)

    plane._on_command_long = listens
    together(air, plane, loss, 40)
    assert {(511, 33, 250_000), (511, 42, 1_000_000), (512, 148, 0), (512, 242, 0)} <= set(asked)
    assert air.fleet.home(1) == pytest.approx(Home(-35.3632621, 149.165237, 584.09))
    assert {(511, 1, 1_000_000), (511, 24, 1_000_000), (511, 245, 1_000_000)} <= set(asked)
    assert loss > 0 or len(asked) == 8


def test_a_vehicle_that_does_not_answer_is_asked_at_a_bounded_rate():
    air = Air()
    sent = 0
    for n in range(1200):
        if n % 20 == 0:
            air.hear(n / 20, beat())
        sent += sum(m.get_type() == "COMMAND_LONG" for _, m in air.poll(n / 20))
    assert 10 < sent < 60


def test_a_stream_that_dries_up_is_asked_for_again():
    air = Air()
    air.hear(0, beat(), position(0))
    air.poll(0)
    ack = dialect.MAVLink_command_ack_message(511, 0, 0, 0, GCS_SYSTEM_ID, GCS_COMPONENT_ID)
    for n in range(100):
        air.hear(0.1 * n, ack, position(0.1 * n), dialect.MAVLink_mission_current_message(1))
        air.poll(0.1 * n)
    asked = []
    for n in range(100, 200):
        air.hear(0.1 * n, beat(), dialect.MAVLink_mission_current_message(1))
        asked += [
            m.param1 for _, m in air.poll(0.1 * n) if m.get_type() == "COMMAND_LONG" and m.command == 511
        ]
    assert asked
    assert set(asked) == {33}


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_fleet_carries_a_mission_task(loss):
    plane, air = Plane(1), Air()
    points = (Waypoint(-35.36, 149.16, 100.0, 10.0), Waypoint(-35.35, 149.16, 100.0, 10.0))
    task = None

    def each_step(t_ns):
        nonlocal task
        air.fleet.forward_next_heartbeat(1)  # a task waits for modes
        if task is not None:
            return task.poll(t_ns)
        if air.fleet.home(1) is None:
            return []
        task = upload_task(Mission(1, 1, points), air.fleet.home(1), air.fleet.encoder(1))
        return task.start(t_ns)

    together(
        air, plane, loss, 60, lambda message, t_ns: task.receive(message, t_ns) if task else [], each_step
    )
    assert task.result.ok
    assert plane.holds(task.items)
    assert air.fleet.state(1).mode == "AUTO"


def test_a_wind_that_is_no_number_leaves_a_state_that_a_restart_can_read():
    air = Air()
    air.hear(0.0, beat(), position(1.0))
    link = air.fleet._vehicles[1].link
    air.hear(0.5, dialect.MAVLink_wind_message(270.0, 6.0, 0.0))
    assert link.wind_m_s == pytest.approx((6.0, 0.0))
    for direction, speed in ((270.0, math.nan), (270.0, math.inf), (math.inf, 6.0), (math.nan, 6.0)):
        air.hear(1.0, dialect.MAVLink_wind_message(direction, speed, 0.0))
        assert link.wind_m_s is None
    air.hear(1.2, dialect.MAVLink_wind_cov_message(0, 2.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert link.wind_m_s == pytest.approx((5.0, 2.0))
    air.hear(1.5, dialect.MAVLink_wind_cov_message(0, math.nan, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert link.wind_m_s is None


# ---------------------------------------------------------------- receivers of aircraft

GROUND = Link(parse_endpoint("udpin:0.0.0.0:14570"), traffic=True)
ADSB = dialect.MAVLink_adsb_vehicle_message(1, 0, 0, 0, 0, 0, 0, 0, b"X", 0, 0, 0, 0)
DRONE = dialect.MAVLink_open_drone_id_location_message(
    0, 0, [1] * 20, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
)  # fmt: skip


def told_by(system_id, component_id, link, *, heard_first=True):
    """Message ids that a fleet returns of a sender, who may be vehicle 1 at its address."""
    fleet = Fleet((1,), FRAME, FleetSettings(extra_ids=TRAFFIC), links=[RADIO, GROUND])
    if heard_first:
        beats = b"".join(Encoder(1, 1)(message) for message in (beat(), position(1)))
        fleet.receive(Datagram(S, RADIO.name, HERE, beats))
    data = b"".join(Encoder(system_id, component_id)(message) for message in (ADSB, DRONE))
    return [message.get_type() for _, message in fleet.receive(Datagram(2 * S, link.name, HERE, data))]


RADIO = Link(parse_endpoint("udpin:0.0.0.0:14550"))
BOTH = ["ADSB_VEHICLE", "OPEN_DRONE_ID_LOCATION"]
RECEIVER = dialect.MAV_COMP_ID_ODID_TXRX_1


@pytest.mark.parametrize(
    ("system_id", "component_id", "link", "expected"),
    [
        (1, RECEIVER, RADIO, BOTH),  # on a vehicle
        (1, 1, RADIO, ["ADSB_VEHICLE"]),  # an autopilot: Remote ID of its own vehicle
        (51, RECEIVER, GROUND, BOTH),
        (51, RECEIVER, RADIO, []),  # a receiver that is not allowed
    ],
)
def test_aircraft_are_heard_from_receivers_on_vehicles_and_where_a_link_allows_them(
    system_id, component_id, link, expected
):
    assert told_by(system_id, component_id, link) == expected


def test_nobody_poses_as_the_receiver_on_a_vehicle_from_elsewhere():
    assert told_by(1, RECEIVER, RADIO, heard_first=False) == []
    assert told_by(1, RECEIVER, GROUND) == []  # the vehicle is heard on the other link
