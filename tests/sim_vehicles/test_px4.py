"""A user would lose a PX4 to what only an ArduPlane forgives; so there is one to practise on."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.model import Fate, UploadReport
from sim_vehicles.scenario import load
from sim_vehicles.virtual import VirtualRun

AUTO, LOITER = 4 << 16 | 4 << 24, 4 << 16 | 3 << 24
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


def test_it_has_no_home_item_and_gives_back_what_it_got(px4, item):
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


def test_it_takes_no_new_mission_before_it_is_told_that_the_old_one_is_over(px4, item):
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
    assert px4.vehicle.autopilot.seq == 0, "not heard while somebody reads"
    assert px4.send(ask(7, 1, 0, 0))[-1].type == mavlink.MAV_MISSION_ERROR
    assert px4.send(ask(7, 1, 1, 0)) == []
    px4.send(mavlink.MAVLink_mission_set_current_message(7, 1, 2))
    assert px4.vehicle.autopilot.seq == 2


def test_a_mission_begins_where_current_says_and_ends_in_hold(px4, item):
    assert px4.command(SET_MODE, 1, 4, 4)[0] == mavlink.MAV_RESULT_DENIED
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


@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_a_mixed_swarm_flies_its_mission(loss):
    scenario = load("deterministic")
    scenario = replace(scenario, simulation=_with_px4(scenario.simulation, [1, 3]))
    reports, fates = [], []

    def keep(_t_ns, effect):
        if isinstance(effect, UploadReport):
            reports.append(effect)
        elif isinstance(effect, Fate):
            fates.append(effect)

    VirtualRun(scenario, 1, on_effect=keep, loss=loss).run()
    assert {(f.vehicle, f.fate) for f in fates} == {(v, "arrived") for v in (1, 2, 3, 4)}
    assert all(report.ok for report in reports)
    assert {report.items for report in reports if report.vehicle in (1, 3)}


def _with_px4(simulation, system_ids):
    import msgspec

    return msgspec.structs.replace(simulation, px4=system_ids)
