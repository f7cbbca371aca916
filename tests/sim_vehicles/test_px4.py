"""A user would lose a PX4 to what only an ArduPlane forgives; so there is one to practise on."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.model import AgentStatus, UploadReport
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import load

AUTO, LOITER = 4 << 16 | 4 << 24, 4 << 16 | 3 << 24
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE, SET_CURRENT = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT


@pytest.fixture
def px4(ground):
    return ground(autopilot="px4")


def last(heard, kind):
    return [m for m in heard if m.get_type() == kind][-1]


def put(g, *items):
    """Upload; return the kinds of the answers, and the ACK's result."""
    heard = g.send(mavlink.MAVLink_mission_count_message(7, 1, len(items), 0))
    kinds = [heard[-1].get_type()]
    while heard[-1].get_type() == "MISSION_REQUEST_INT":
        heard = g.send(items[heard[-1].seq])
        kinds.append(heard[-1].get_type())
    return kinds, last(heard, "MISSION_ACK").type


def test_its_heartbeat_is_a_px4s(px4):
    beat = last(px4.fly(1.1), "HEARTBEAT")
    assert (beat.autopilot, beat.type, beat.custom_mode) == (12, 1, LOITER)


def test_it_has_no_home_item_and_returns_the_uploaded_items(px4, item):
    kinds, result = put(px4, item(0, 200.0, 0.0, param2=7.5, frame=3), item(1, 400.0, 0.0))
    assert (kinds, result) == (["MISSION_REQUEST_INT"] * 2 + ["MISSION_ACK"], 0)
    back = px4.download()
    assert [m.x for m in back] == [item(0, 200.0, 0.0).x, item(1, 400.0, 0.0).x]
    assert (back[0].param2, back[0].frame, math.isnan(back[0].param4)) == (7.5, 6, True)


def test_an_upload_is_whole_or_nothing(px4, item):
    put(px4, item(0, 200.0, 0.0), item(1, 400.0, 0.0))
    px4.send(mavlink.MAVLink_mission_count_message(7, 1, 3, 0))
    px4.send(item(0, 0.0, 300.0))
    assert px4.send(item(2, 0.0, 500.0)) == []  # not its turn: ignored
    heard = px4.fly(6.0)
    assert not any(m.get_type() == "MISSION_ACK" for m in heard)  # it gives up without a word
    assert len([m for m in heard if m.get_type() == "MISSION_REQUEST_INT"]) > 15
    assert [m.x for m in px4.download()] == [item(0, 200.0, 0.0).x, item(1, 400.0, 0.0).x]


def test_a_last_item_that_comes_twice_is_acknowledged_twice(px4, item):
    put(px4, item(0, 200.0, 0.0), item(1, 400.0, 0.0))
    assert px4.send(item(1, 400.0, 0.0))[-1].type == 0


def test_it_accepts_no_new_mission_before_the_old_upload_is_over(px4, item):
    px4.send(mavlink.MAVLink_mission_count_message(7, 1, 3, 0))
    px4.send(item(0, 0.0, 300.0))
    assert px4.send(mavlink.MAVLink_mission_count_message(7, 1, 2, 0))[-1].type == mavlink.MAV_MISSION_ERROR
    px4.send(mavlink.MAVLink_mission_ack_message(7, 1, mavlink.MAV_MISSION_OPERATION_CANCELLED, 0))
    assert put(px4, item(0, 200.0, 0.0), item(1, 400.0, 0.0))[1] == mavlink.MAV_MISSION_ACCEPTED


def test_a_read_back_goes_in_order_or_ends(px4, item):
    put(px4, *[item(n, 200.0 + n, 0.0) for n in range(4)])
    ask = mavlink.MAVLink_mission_request_int_message
    px4.send(mavlink.MAVLink_mission_request_list_message(7, 1, 0))
    assert [px4.send(ask(7, 1, seq, 0))[-1].seq for seq in (0, 1, 1, 2)] == [0, 1, 1, 2]
    px4.send(mavlink.MAVLink_mission_set_current_message(7, 1, 2))
    assert px4.vehicle.autopilot.seq == 0, "not heard during a download"
    assert px4.send(ask(7, 1, 0, 0))[-1].type == mavlink.MAV_MISSION_ERROR
    assert px4.send(ask(7, 1, 1, 0)) == []
    px4.send(mavlink.MAVLink_mission_set_current_message(7, 1, 2))
    assert px4.vehicle.autopilot.seq == 2


def test_a_mission_begins_at_its_current_item_and_ends_in_hold(px4, item):
    assert px4.command(SET_MODE, 1, 4, 4)[0] == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    put(px4, item(0, 900.0, 0.0), item(1, 60.0, 0.0, current=1))
    assert px4.command(SET_CURRENT, 1)[0] == mavlink.MAV_RESULT_UNSUPPORTED
    assert px4.command(SET_MODE, 1, 4, 4)[0] == 0
    assert last(px4.fly(1.1), "HEARTBEAT").custom_mode == AUTO
    heard = px4.until(lambda: px4.vehicle.autopilot.mode.name == "LOITER", 60.0)
    assert [m.seq for m in heard if m.get_type() == "MISSION_ITEM_REACHED"] == [1]


def test_a_new_mission_is_flown_at_once(px4, item):
    put(px4, item(0, 900.0, 0.0))
    px4.command(SET_MODE, 1, 4, 4)
    put(px4, item(0, -900.0, 0.0), item(1, -900.0, 300.0))
    px4.fly(30.0)
    assert px4.vehicle.east_m < -100.0


def takeoff(item, **fields):
    return item(0, 0.0, 200.0, 60.0, command=mavlink.MAV_CMD_NAV_TAKEOFF, **fields)


def test_of_a_take_off_it_keeps_the_heading_and_not_the_pitch(px4, item):
    put(px4, takeoff(item, param1=15.0, param4=math.nan), item(1, 400.0, 0.0, param3=9.0))
    back = px4.download()
    assert [m.param1 for m in back] == [0.0, 0.0]
    assert math.isnan(back[0].param4)
    assert back[1].param3 == 0.0


def test_armed_on_the_ground_in_auto_it_takes_off_with_its_old_mission(ground, item):
    px4 = ground(autopilot="px4", airborne=False, arming_delay_s=0.0)
    land = item(2, 300.0, 0.0, 0.0, command=mavlink.MAV_CMD_NAV_LAND)
    put(px4, takeoff(item), item(1, 300.0, 300.0), land)
    px4.command(SET_MODE, 1, 4, 4)
    px4.command(ARM, 1)
    px4.until(lambda: px4.vehicle.alt_rel_m > 50.0)
    px4.until(lambda: not px4.vehicle.autopilot.armed)
    px4.fly(20.0)
    assert px4.vehicle.alt_rel_m < 1.0
    assert last(px4.fly(1.1), "HEARTBEAT").custom_mode == AUTO
    assert px4.command(ARM, 1)[0] == 0
    px4.fly(10.0)
    assert (px4.vehicle.autopilot.seq, px4.vehicle.autopilot.flying) == (0, True)
    assert px4.vehicle.alt_rel_m > 20.0


def test_its_take_off_flies_towards_its_place(ground, item):
    px4 = ground(autopilot="px4", airborne=False, arming_delay_s=0.0)  # heading east
    put(px4, takeoff(item), item(1, 300.0, 300.0))
    px4.command(SET_MODE, 1, 4, 4)
    px4.command(ARM, 1)
    px4.fly(10.0)
    assert px4.vehicle.north_m > 50.0


@pytest.mark.parametrize(
    ("wants", "lands", "is_flown"),
    [(0, False, True), (1, False, False), (1, True, False), (2, False, False), (2, True, True)],
)
def test_a_mission_in_the_air_needs_its_required_items(ground, item, wants, lands, is_flown):
    """1 rejects every re-task in flight; the ACK is 0 all the same."""
    px4 = ground(autopilot="px4")
    put(px4, item(0, 900.0, 0.0))
    px4.command(SET_MODE, 1, 4, 4)
    px4.vehicle.autopilot.parameters.store("MIS_TKO_LAND_REQ", wants)
    command = mavlink.MAV_CMD_NAV_LAND if lands else mavlink.MAV_CMD_NAV_WAYPOINT
    _, result = put(px4, item(0, -900.0, 0.0), item(1, -900.0, 300.0, command=command))
    assert result == mavlink.MAV_MISSION_ACCEPTED
    heard = px4.fly(1.1)
    assert (last(heard, "HEARTBEAT").custom_mode == AUTO) is is_flown
    assert last(heard, "MISSION_CURRENT").mission_state == (3 if is_flown else 1)
    if not is_flown:
        texts = "".join(m.text for m in px4.heard if m.get_type() == "STATUSTEXT")
        assert "No valid mission available, loitering" in texts
        assert px4.command(SET_MODE, 1, 4, 4)[0] == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def test_a_long_text_comes_in_chunks_that_bear_one_id(px4):
    px4.vehicle.autopilot.notify(6, "Airspeed sensor Nr. 1 ASPD_SCALE updated: 1.0000 --> 1.0020")
    px4.vehicle.autopilot.notify(6, "Takeoff detected")
    texts = [m for m in px4.fly(0.1) if m.get_type() == "STATUSTEXT"]
    assert [(m.id, m.chunk_seq) for m in texts] == [(1, 0), (1, 1), (2, 0)]
    assert [len(m.text) for m in texts] == [50, 10, 17]


def test_it_returns_at_its_return_altitude_above_the_rally_point(px4, item):
    px4.vehicle.autopilot.parameters.store("RTL_RETURN_ALT", 100.0)
    rally = item(0, 500.0, 0.0, 90.0, command=mavlink.MAV_CMD_NAV_RALLY_POINT, mission_type=2)
    px4.send(mavlink.MAVLink_mission_count_message(7, 1, 1, 2))
    px4.send(rally)
    px4.command(SET_MODE, 1, 4, 5)
    px4.fly(25.0)
    assert px4.vehicle.alt_rel_m == pytest.approx(190.0, abs=1.0)


def test_a_return_ends_in_a_circle_at_its_descend_altitude(px4, item):
    px4.vehicle.autopilot.parameters.store("RTL_DESCEND_ALT", 45.0)
    put(px4, item(0, 900.0, 0.0))
    px4.command(SET_MODE, 1, 4, 4)
    px4.fly(20.0)
    px4.command(SET_MODE, 1, 4, 5)
    px4.fly(10.0)
    assert px4.vehicle.alt_rel_m > 59.0
    px4.fly(90.0)
    assert px4.vehicle.alt_rel_m == pytest.approx(45.0, abs=1.0)


def test_a_return_through_the_fence_s_ceiling_ends_in_hold(px4):
    px4.vehicle.autopilot.parameters.store("RTL_RETURN_ALT", 190.0)
    px4.vehicle.autopilot.parameters.store("GF_MAX_VER_DIST", 140.0)
    px4.command(SET_MODE, 1, 4, 5)
    assert last(px4.fly(30.0), "HEARTBEAT").custom_mode == LOITER


@pytest.mark.parametrize(("timeout_s", "hold_s", "return_s"), [(5, 7.2, 12.3), (10, 12.6, 17.7)])
def test_without_a_ground_station_it_holds_then_returns_even_if_the_link_is_back(
    px4, item, timeout_s, hold_s, return_s
):
    parameters = px4.vehicle.autopilot.parameters
    parameters.store("NAV_DLL_ACT", 2)
    parameters.store("COM_DL_LOSS_T", timeout_s)
    put(px4, item(0, 9000.0, 0.0))
    px4.command(SET_MODE, 1, 4, 4)
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    px4.send(beat)
    modes = []
    for _ in range(200):
        px4.fly(0.1)
        modes.append(px4.vehicle.autopilot.mode.name)
        if len(modes) == round(hold_s * 10) + 10:
            px4.send(beat)
    assert modes.index("LOITER") / 10 == pytest.approx(hold_s, abs=0.5)
    assert modes.index("RTL") / 10 == pytest.approx(return_s, abs=0.5)


def test_its_mission_current_comes_once_a_second_and_at_no_other_rate(px4, item):
    put(px4, item(0, 900.0, 0.0))
    interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    assert px4.command(interval, 42, 250_000)[0] == mavlink.MAV_RESULT_FAILED
    assert len([m for m in px4.fly(5.0) if m.get_type() == "MISSION_CURRENT"]) == 5


def test_a_mixed_swarm_flies_its_mission_over_a_lossy_link():
    scenario = load("deterministic")
    scenario = replace(scenario, simulation=_with_px4(scenario.simulation, [1, 3]))
    reports, statuses = [], []

    def keep(_t_ns, effect):
        if isinstance(effect, UploadReport):
            reports.append(effect)
        elif isinstance(effect, AgentStatus):
            statuses.append(effect)

    VirtualRun(scenario, 1, on_effect=keep, loss=0.1).run()
    assert {(f.vehicle, f.status) for f in statuses} == {(v, "arrived") for v in (1, 2, 3, 4)}
    assert all(report.ok for report in reports)
    assert {report.items for report in reports if report.vehicle in (1, 3)}


def _with_px4(simulation, system_ids):
    import msgspec

    return msgspec.structs.replace(simulation, px4=system_ids)


def test_it_climbs_in_a_circle_to_the_first_point_of_a_mission_and_goes_on_in_hold(px4, item):
    """As in flights of PX4 1.17: Hold does not end that climb."""
    put(px4, item(0, 2000.0, 0.0, 140.0))
    begin = (px4.vehicle.east_m, px4.vehicle.north_m)
    px4.command(SET_MODE, 1, 4, 4)
    px4.fly(4.0)
    assert 105.0 < px4.vehicle.alt_rel_m < 125.0
    px4.command(SET_MODE, 1, 4, 3)
    px4.fly(20.0)
    assert px4.vehicle.alt_rel_m == pytest.approx(140.0, abs=1.0)
    assert math.dist(begin, (px4.vehicle.east_m, px4.vehicle.north_m)) < 200.0
