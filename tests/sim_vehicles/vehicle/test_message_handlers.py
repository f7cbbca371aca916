"""What ground stations ask of a vehicle, and what an ArduPlane answers."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
LOITER, AUTO, RTL, GUIDED, MANUAL = 12, 10, 11, 15, 0


def of(messages, kind):
    return [m for m in messages if m.get_type() == kind]


def test_a_heartbeat_each_second_is_of_an_armed_fixed_wing_ardupilot(ground):
    g = ground()
    beats = of(g.fly(10), "HEARTBEAT")
    assert len(beats) == 10
    beat = beats[0]
    assert (beat.type, beat.autopilot, beat.custom_mode) == (1, 3, LOITER)
    assert (beat.get_srcSystem(), beat.get_srcComponent()) == (7, 1)
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def test_default_streams_are_there_once_a_second(ground):
    heard = ground().fly(10)
    for kind in (
        "SYS_STATUS", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "ATTITUDE", "VFR_HUD", "MISSION_CURRENT",
        "BATTERY_STATUS", "SYSTEM_TIME", "EKF_STATUS_REPORT",
    ):  # fmt: skip
        assert len(of(heard, kind)) == 10, kind


def test_frames_are_numbered_without_gaps(ground):
    heard = ground().fly(30)
    numbers = [m.get_seq() for m in heard]
    assert all((b - a) % 256 == 1 for a, b in pairwise(numbers))


def test_position_report_is_the_truth_to_a_centimetre_without_noise(ground, item):
    g = ground(course_rad=0.3)
    g.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 33, 100_000)
    report = of(g.fly(20, tick_s=0.1), "GLOBAL_POSITION_INT")[-1]
    there = item(0, g.vehicle.east_m, g.vehicle.north_m)
    assert abs(report.lat - there.x) <= 1
    assert abs(report.lon - there.y) <= 1
    assert math.hypot(report.vx, report.vy) == pytest.approx(1500, abs=3)
    assert math.atan2(report.vy, report.vx) % math.tau == pytest.approx(g.vehicle.course_rad, abs=0.01)
    assert (report.alt, report.relative_alt) == (170_000, 100_000)


def test_reported_positions_scatter_by_the_noise(ground):
    g = ground(gps_noise_std_m=3.0, forward_speed_m_s=0.01)
    g.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 33, 20_000)
    north_m = [(m.lat / 1e7 - 33.2) * 110_920 for m in of(g.fly(20), "GLOBAL_POSITION_INT")]
    mean = sum(north_m) / len(north_m)
    std = math.sqrt(sum((x - mean) ** 2 for x in north_m) / len(north_m))
    assert len(north_m) == 1000
    assert std == pytest.approx(3.0, rel=0.15)


@pytest.mark.parametrize("as_request", [True, False])
def test_version_and_capabilities(ground, as_request):
    g = ground()
    command = (512, 148) if as_request else (520, 1)
    result, replies = g.command(*command)
    version = of(replies, "AUTOPILOT_VERSION")[0]
    assert result == ACCEPTED
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    assert not version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_FTP
    assert version.flight_sw_version >> 24 == 4


def test_intervals_are_set_asked_for_stopped_and_reset(ground):
    g = ground()
    assert g.command(511, 33, 250_000)[0] == ACCEPTED
    assert len(of(g.fly(10), "GLOBAL_POSITION_INT")) == 40
    assert of(g.command(510, 33)[1], "MESSAGE_INTERVAL")[0].interval_us == 250_000
    g.command(511, 33, -1)
    assert of(g.fly(5), "GLOBAL_POSITION_INT") == []
    assert of(g.command(510, 33)[1], "MESSAGE_INTERVAL")[0].interval_us == -1
    g.command(511, 33, 0)
    assert len(of(g.fly(5), "GLOBAL_POSITION_INT")) == 5
    assert g.command(511, 12345, 1000)[0] == FAILED


def test_data_stream_request_sets_a_group(ground):
    g = ground()
    g.send(mavlink.MAVLink_request_data_stream_message(7, 1, mavlink.MAV_DATA_STREAM_POSITION, 5, 1))
    assert len(of(g.fly(4), "GLOBAL_POSITION_INT")) == 20
    g.send(mavlink.MAVLink_request_data_stream_message(7, 1, mavlink.MAV_DATA_STREAM_ALL, 2, 1))
    heard = g.fly(4)
    assert len(of(heard, "GLOBAL_POSITION_INT")) == len(of(heard, "ATTITUDE")) == 8
    assert len(of(heard, "HEARTBEAT")) == 4


def test_parameters_are_listed_whole_and_not_in_a_burst(ground):
    g = ground()
    burst = of(g.send(mavlink.MAVLink_param_request_list_message(7, 1)), "PARAM_VALUE")
    burst += of(g.fly(0.03, tick_s=0.01), "PARAM_VALUE")
    assert len(burst) <= 8
    values = of(g.fly(3), "PARAM_VALUE") + burst
    assert {v.param_index for v in values} == set(range(values[0].param_count))
    assert len(values) == values[0].param_count
    named = {v.param_id: v.param_value for v in values}
    assert (named["SYSID_THISMAV"], named["WP_RADIUS"], named["FS_LONG_TIMEOUT"]) == (7, 10, 5)


def test_a_parameter_is_read_set_and_kept_within_its_type(ground):
    g = ground()
    read = g.send(mavlink.MAVLink_param_request_read_message(7, 1, b"WP_LOITER_RAD", -1))[0]
    assert (read.param_value, read.param_type) == (60, mavlink.MAV_PARAM_TYPE_INT16)
    set_to = g.send(mavlink.MAVLink_param_set_message(7, 1, b"WP_LOITER_RAD", 80.4, 4))[0]
    assert (set_to.param_value, set_to.param_index) == (80, read.param_index)
    by_index = g.send(mavlink.MAVLink_param_request_read_message(7, 1, b"", read.param_index))[0]
    assert (by_index.param_id, by_index.param_value) == ("WP_LOITER_RAD", 80)
    assert g.send(mavlink.MAVLink_param_set_message(7, 1, b"SYSID_THISMAV", 9, 4))[0].param_value == 7
    assert g.send(mavlink.MAVLink_param_set_message(7, 1, b"WP_RADIUS", math.nan, 4))[0].param_value == 10
    assert g.send(mavlink.MAVLink_param_request_read_message(7, 1, b"NO_SUCH", -1)) == []
    assert g.send(mavlink.MAVLink_param_request_read_message(7, 1, b"", 999)) == []


def test_mode_by_command_by_set_mode_and_by_command_int(ground):
    g = ground()
    assert g.command(176, 1, GUIDED)[0] == ACCEPTED
    assert g.mode == GUIDED
    ack = of(g.send(mavlink.MAVLink_set_mode_message(7, 1, LOITER)), "COMMAND_ACK")[0]
    assert (ack.result, g.mode) == (ACCEPTED, LOITER)
    replies = g.send(mavlink.MAVLink_command_int_message(7, 1, 0, 176, 0, 0, 1, RTL, 0, 0, 0, 0, 0))
    assert (of(replies, "COMMAND_ACK")[0].result, g.mode) == (ACCEPTED, RTL)


def test_a_mode_it_does_not_have_is_refused(ground):
    g = ground()
    assert g.command(176, 1, 99)[0] == FAILED
    assert g.command(176, 0, AUTO)[0] == DENIED
    assert g.command(176, math.nan, AUTO)[0] == DENIED
    assert g.mode == LOITER


def test_set_current_command_denies_items_out_of_range(ground, item):
    g = ground()
    g.upload(*(item(k, 1000 * k, 0) for k in range(3)))
    result, replies = g.command(224, 2)
    assert (result, of(replies, "MISSION_CURRENT")[0].seq) == (ACCEPTED, 2)
    assert g.command(224, 3)[0] == DENIED
    result, replies = g.command(224, 0)
    assert (result, of(replies, "MISSION_CURRENT")[0].seq) == (ACCEPTED, 1)


def test_arming_is_refused_after_boot_with_a_reason_then_granted(ground):
    g = ground(airborne=False, arming_delay_s=20.0)
    result, replies = g.command(400, 1)
    assert result == FAILED
    assert "PreArm" in of(replies, "STATUSTEXT")[0].text
    health = of(g.fly(1), "SYS_STATUS")[0].onboard_control_sensors_health
    assert not health & mavlink.MAV_SYS_STATUS_PREARM_CHECK
    g.fly(20)
    health = of(g.fly(1), "SYS_STATUS")[0].onboard_control_sensors_health
    assert health & mavlink.MAV_SYS_STATUS_PREARM_CHECK
    assert g.command(400, 1)[0] == ACCEPTED
    assert of(g.fly(1), "HEARTBEAT")[0].base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    assert g.command(400, 0)[0] == ACCEPTED


def test_before_the_origin_positions_are_near_zero_and_there_is_no_home(ground):
    g = ground(airborne=False)
    heard = g.fly(2)
    position = of(heard, "GLOBAL_POSITION_INT")[-1]
    assert (position.lat, position.lon) == (1000, -300)
    assert of(heard, "GPS_RAW_INT")[-1].fix_type < 3
    assert g.command(512, 242)[0] == FAILED
    g.fly(10)
    result, replies = g.command(512, 242)
    assert result == ACCEPTED
    assert of(replies, "HOME_POSITION")[0].latitude == 332_000_000
    assert of(g.fly(1), "GPS_RAW_INT")[-1].fix_type == 3


def test_home_can_be_moved(ground, item):
    g = ground()
    there = item(0, 300, 400)
    g.send(mavlink.MAVLink_command_int_message(7, 1, 0, 179, 0, 0, 0, 0, 0, 0, there.x, there.y, 80.0))
    home = of(g.command(410)[1], "HOME_POSITION")[0]
    assert (home.latitude, home.longitude, home.altitude) == (there.x, there.y, 80_000)


@pytest.mark.parametrize("how", ["reposition", "item", "position target"])
def test_guided_goes_where_it_is_sent(ground, item, how):
    g = ground()
    there = item(0, 400, 300, current=2, frame=3)
    if how == "reposition":
        move = mavlink.MAVLink_command_int_message(
            7, 1, 3, 192, 0, 0, -1, 1, 0, math.nan, there.x, there.y, 100.0
        )
        assert of(g.send(move), "COMMAND_ACK")[0].result == ACCEPTED
    else:
        g.command(176, 1, GUIDED)
        target = mavlink.MAVLink_set_position_target_global_int_message(
            0, 7, 1, 6, 0x0FF8, there.x, there.y, 100.0, 0, 0, 0, 0, 0, 0, 0, 0
        )
        g.send(there if how == "item" else target)
    assert g.mode == GUIDED
    g.fly(120)
    assert math.dist((g.vehicle.east_m, g.vehicle.north_m), (400, 300)) == pytest.approx(60, abs=3)


def test_a_guided_item_outside_guided_is_refused(ground, item):
    g = ground()
    assert of(g.send(item(0, 400, 300, current=2)), "MISSION_ACK")[0].type == mavlink.MAV_MISSION_ERROR


def test_unknown_commands_are_unsupported_and_acks_name_their_receiver(ground):
    g = ground()
    result, replies = g.command(31000, sender=42, component=99)
    ack = of(replies, "COMMAND_ACK")[0]
    assert (result, ack.target_system, ack.target_component) == (UNSUPPORTED, 42, 99)


def test_messages_for_others_are_ignored(ground):
    g = ground()
    message = mavlink.MAVLink_command_long_message(8, 1, 176, 0, 1, RTL, 0, 0, 0, 0, 0)
    assert g.send(message) == []
    message = mavlink.MAVLink_command_long_message(7, 42, 176, 0, 1, RTL, 0, 0, 0, 0, 0)
    assert g.send(message) == []
    assert g.send(mavlink.MAVLink_ping_message(1, 2, 0, 0), sender=7, component=1) == []
    assert g.mode == LOITER


def test_ping_time_sync_and_file_transfer_are_answered(ground):
    g = ground()
    ping = of(g.send(mavlink.MAVLink_ping_message(123, 4, 0, 0)), "PING")[0]
    assert (ping.time_usec, ping.seq, ping.target_system) == (123, 4, 255)
    g.fly(2)
    sync = of(g.send(mavlink.MAVLink_timesync_message(0, 555)), "TIMESYNC")[0]
    assert (sync.tc1, sync.ts1) == (2_000_000_000, 555)
    request = [9, 0, 3, 4, *[0] * 247]
    nak = of(
        g.send(mavlink.MAVLink_file_transfer_protocol_message(0, 7, 1, request)), "FILE_TRANSFER_PROTOCOL"
    )[0]
    assert (nak.payload[0], nak.payload[3], nak.payload[5], nak.payload[12]) == (10, 129, 4, 10)


def test_several_frames_in_one_datagram_are_all_heard_and_a_broken_one_is_stepped_over(ground):
    g = ground()
    guided = mavlink.MAVLink_command_long_message(7, 1, 176, 0, 1, GUIDED, 0, 0, 0, 0, 0).pack(g.pen)
    loiter = mavlink.MAVLink_command_long_message(7, 1, 511, 0, 33, 250000, 0, 0, 0, 0, 0).pack(g.pen)
    broken = bytearray(guided)
    broken[20] ^= 0xFF
    g.vehicle.receive_datagram(b"\xfd\x00junk" + bytes(broken) + guided + loiter + guided[:15], g.t_ns)
    assert len(of(g.fly(0), "COMMAND_ACK")) == 2
    assert g.mode == GUIDED


def test_mavlink_1_is_understood(ground):
    g = ground()
    old = mavlink.MAVLink_command_long_message(7, 1, 176, 0, 1, GUIDED, 0, 0, 0, 0, 0).pack(
        g.pen, force_mavlink1=True
    )
    g.vehicle.receive_datagram(old, g.t_ns)
    assert g.mode == GUIDED


def frames():
    pen = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    plain = [
        mavlink.MAVLink_mission_count_message(7, 1, 3, 0),
        mavlink.MAVLink_param_set_message(7, 1, b"WP_RADIUS", 1e30, 9),
        mavlink.MAVLink_command_long_message(7, 1, 192, 0, *[math.nan] * 7),
        mavlink.MAVLink_command_long_message(7, 1, 179, 0, *[math.inf] * 7),
        mavlink.MAVLink_command_long_message(7, 1, 511, 0, 33, -1e30, 0, 0, 0, 0, 0),
        mavlink.MAVLink_set_position_target_global_int_message(
            0, 7, 1, 6, 0, 2**31 - 1, 0, math.nan, *[0] * 8
        ),
        mavlink.MAVLink_request_data_stream_message(7, 1, 0, 65535, 1),
        mavlink.MAVLink_param_request_read_message(7, 1, b"\xff\xfe\x80", -1),
        mavlink.MAVLink_file_transfer_protocol_message(0, 7, 1, [255] * 251),
    ]
    return [m.pack(pen) for m in plain]


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.one_of(st.binary(max_size=60), st.sampled_from(frames())), max_size=8), st.data())
def test_whatever_arrives_the_vehicle_flies_on(ground, pieces, data):
    datagram = bytearray(b"".join(pieces))
    for _ in range(data.draw(st.integers(0, 3)) if datagram else 0):
        datagram[data.draw(st.integers(0, len(datagram) - 1))] = data.draw(st.integers(0, 255))
    g = ground()
    g.vehicle.receive_datagram(bytes(datagram), g.t_ns)
    assert of(g.fly(1.5), "HEARTBEAT")


def test_the_health_of_the_fence_is_good_without_one_and_bad_beyond_one(ground):
    """Without the bit MAVProxy says "fence breach" of every vehicle."""
    fence = mavlink.MAV_SYS_STATUS_GEOFENCE
    g = ground()
    status = [m for m in g.fly(1.1) if m.get_type() == "SYS_STATUS"][-1]
    assert status.onboard_control_sensors_health & fence
    assert not status.onboard_control_sensors_enabled & fence
    g.vehicle.autopilot.parameters.store("FENCE_ENABLE", 1)
    g.vehicle.autopilot.parameters.store("FENCE_TYPE", 1)
    g.vehicle.autopilot.parameters.store("FENCE_ALT_MAX", 50)
    status = [m for m in g.fly(1.1) if m.get_type() == "SYS_STATUS"][-1]
    assert status.onboard_control_sensors_enabled & fence
    assert not status.onboard_control_sensors_health & fence


def test_the_current_item_comes_once_a_second_and_at_once_when_asked_for(ground, item):
    g = ground()
    g.upload(item(0, 0.0, 0.0), item(1, 500.0, 0.0))
    assert len([m for m in g.fly(5.0) if m.get_type() == "MISSION_CURRENT"]) == 5
    g.fly(0.3)
    result, replies = g.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 42)
    assert result == mavlink.MAV_RESULT_ACCEPTED
    assert [m.get_type() for m in replies] == ["COMMAND_ACK", "MISSION_CURRENT"]


@pytest.mark.parametrize(("by_message", "off_m"), [(False, -1000.0), (True, 0.0)])
def test_the_cross_track_error_of_a_first_leg_is_reported_as_the_firmware_does(
    ground, item, by_message, off_m
):
    g = ground(course_rad=0.0)
    g.upload(item(0, 0.0, 0.0), item(1, 0.0, 1500.0))
    g.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 10)
    g.fly(1.0)
    g.upload(item(0, 0.0, 0.0), item(1, 800.0, 1200.0))
    if by_message:
        g.send(mavlink.MAVLink_mission_set_current_message(7, 1, 1))
    else:
        assert g.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 1)[0] == mavlink.MAV_RESULT_ACCEPTED
    nav = [m for m in g.fly(1.1) if m.get_type() == "NAV_CONTROLLER_OUTPUT"][-1]
    assert nav.xtrack_error < off_m if off_m else nav.xtrack_error == 0.0
    assert nav.wp_dist == pytest.approx(math.dist((g.vehicle.east_m, g.vehicle.north_m), (800, 1200)), abs=20)
