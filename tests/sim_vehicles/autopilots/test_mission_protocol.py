"""Mission transfer as ArduPlane does it: a ground station that copes with this copes with the real one."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink


def kinds(messages):
    return [m.get_type() for m in messages]


def last_ack(messages):
    acks = [m for m in messages if m.get_type() == "MISSION_ACK"]
    return acks[-1].type if acks else None


def count(n, **fields):
    return mavlink.MAVLink_mission_count_message(fields.get("target", 7), 1, n, fields.get("mission_type", 0))


def test_what_is_uploaded_comes_back_normalised(ground, item):
    g = ground()
    sent = [
        item(0, 0, 0),
        item(1, 100, 0, param1=5.0, param2=20.0),
        item(2, 200, 50, 101.234, param2=400.0, frame=3, autocontinue=0),
        item(3, 300, 50, command=17, param3=-90.0),
    ]
    assert g.upload(*sent) == mavlink.MAV_MISSION_ACCEPTED
    back = g.download()
    assert [m.seq for m in back] == [0, 1, 2, 3]
    for mine, theirs in zip(sent[1:], back[1:], strict=True):
        assert (theirs.frame, theirs.autocontinue, theirs.param4) == (3, 1, 0.0)
        assert (theirs.command, theirs.x, theirs.y) == (mine.command, mine.x, mine.y)
    assert (back[1].param1, back[1].param2) == (0.0, 20.0)
    assert (back[2].param2, back[2].z) == (255.0, pytest.approx(101.23))
    assert back[3].param3 == -90.0


def test_item_zero_is_home_whatever_was_sent(ground, item):
    g = ground()
    g.upload(item(0, 700, 700), item(1, 100, 0))
    home = g.download()[0]
    at_home = item(0, 0, 0)
    assert (home.frame, home.x, home.y, home.z) == (0, at_home.x, at_home.y, 70.0)


def test_without_a_home_item_the_first_item_is_lost(ground, item):
    g = ground()
    assert g.upload(item(0, 0, 0, command=22)) == mavlink.MAV_MISSION_ACCEPTED
    assert [m.command for m in g.download()] == [16]


def test_it_asks_with_mission_request_and_again_after_a_second(ground, item):
    g = ground()
    g.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 33, 50_000)  # timers of another kind are no reason to ask
    replies = g.send(count(2))
    assert (kinds(replies), replies[0].seq) == (["MISSION_REQUEST"], 0)
    assert "MISSION_REQUEST" not in kinds(g.fly(0.9))
    again = [m for m in g.fly(0.2) if m.get_type() == "MISSION_REQUEST"]
    assert [m.seq for m in again] == [0]


def test_it_gives_up_after_eight_seconds_with_ack_15(ground):
    g = ground()
    g.send(count(2))
    assert last_ack(g.fly(7.8)) is None
    assert last_ack(g.fly(0.4)) == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert "MISSION_REQUEST" not in kinds(g.fly(5))


def test_an_abandoned_upload_leaves_an_inconsistent_mission(ground, item):
    g = ground()
    g.upload(*(item(k, 100 * k, 0) for k in range(5)))
    g.send(count(4))
    g.send(item(0, 0, 0))
    g.send(item(1, 0, 900))
    g.fly(10)
    back = g.download()
    assert len(back) == 4
    assert [m.x for m in back[1:]] == [item(0, 0, 900).x, item(0, 200, 0).x, item(0, 300, 0).x]


def test_a_duplicate_item_gets_ack_13_and_the_transfer_goes_on(ground, item):
    g = ground()
    g.send(count(3))
    g.send(item(0, 0, 0))
    replies = g.send(item(0, 0, 0))
    assert last_ack(replies) == mavlink.MAV_MISSION_INVALID_SEQUENCE
    g.send(item(1, 100, 0))
    assert last_ack(g.send(item(2, 200, 0))) == mavlink.MAV_MISSION_ACCEPTED


def test_the_item_whose_turn_it_is_is_taken_though_its_request_was_lost(ground, item):
    g = ground()
    g.send(count(3))
    assert kinds(g.send(item(0, 0, 0))) == ["MISSION_REQUEST"]
    assert last_ack(g.send(item(2, 200, 0))) == mavlink.MAV_MISSION_INVALID_SEQUENCE
    assert g.send(item(1, 100, 0))[-1].seq == 2
    assert last_ack(g.send(item(2, 200, 0))) == mavlink.MAV_MISSION_ACCEPTED
    assert last_ack(g.send(item(2, 200, 0))) == mavlink.MAV_MISSION_ERROR


def test_nothing_is_read_or_cleared_during_an_upload(ground, item):
    g = ground()
    g.upload(item(0, 0, 0), item(1, 100, 0))
    g.send(count(2))
    for question, result in (
        (mavlink.MAVLink_mission_request_list_message(7, 1, 0), mavlink.MAV_MISSION_DENIED),
        (mavlink.MAVLink_mission_request_int_message(7, 1, 1, 0), mavlink.MAV_MISSION_DENIED),
        (mavlink.MAVLink_mission_clear_all_message(7, 1, 0), mavlink.MAV_MISSION_ERROR),
    ):
        assert last_ack(g.send(question)) == result
    assert len(g.vehicle.autopilot.mission) == 2


def test_another_ground_station_is_denied_during_an_upload(ground, item):
    g = ground()
    g.send(count(2))
    assert last_ack(g.send(count(5), sender=254)) == mavlink.MAV_MISSION_DENIED
    assert last_ack(g.send(item(0, 0, 0), sender=254)) == mavlink.MAV_MISSION_DENIED
    g.send(item(0, 0, 0))
    assert last_ack(g.send(item(1, 100, 0))) == mavlink.MAV_MISSION_ACCEPTED
    assert len(g.download()) == 2


@pytest.mark.parametrize(
    ("fields", "result"),
    [
        ({"frame": 1}, mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        ({"command": 177}, mavlink.MAV_MISSION_UNSUPPORTED),
        ({"param2": math.nan}, mavlink.MAV_MISSION_INVALID_PARAM2),
        ({"x": 910_000_000}, mavlink.MAV_MISSION_INVALID_PARAM5_X),
        ({"z": math.nan}, mavlink.MAV_MISSION_INVALID_PARAM7),
    ],
)
def test_an_item_it_cannot_fly_ends_the_upload_and_keeps_the_old_mission(ground, item, fields, result):
    g = ground()
    g.upload(*(item(k, 100 * k, 0) for k in range(4)))
    g.send(count(3))
    g.send(item(0, 0, 0))
    assert last_ack(g.send(item(1, 0, 0, **fields))) == result
    assert [m.x for m in g.download()[1:]] == [item(0, 100, 0).x, item(0, 200, 0).x]


def test_count_zero_clears_and_clear_all_clears(ground, item):
    g = ground()
    g.upload(item(0, 0, 0), item(1, 100, 0))
    assert last_ack(g.send(count(0))) == mavlink.MAV_MISSION_ACCEPTED
    assert g.download() == []
    g.upload(item(0, 0, 0), item(1, 100, 0))
    assert (
        last_ack(g.send(mavlink.MAVLink_mission_clear_all_message(7, 1, 0))) == mavlink.MAV_MISSION_ACCEPTED
    )
    assert g.download() == []


def test_clear_all_is_refused_while_the_mission_is_flown(ground, item):
    g = ground()
    g.upload(item(0, 0, 0), item(1, 5000, 0))
    g.command(mavlink.MAV_CMD_MISSION_START)
    assert last_ack(g.send(mavlink.MAVLink_mission_clear_all_message(7, 1, 0))) == mavlink.MAV_MISSION_ERROR
    assert len(g.download()) == 2


def test_a_count_to_everybody_is_taken_and_one_to_another_is_not(ground):
    g = ground()
    assert g.send(count(2, target=8)) == []
    assert kinds(g.send(count(2, target=0))) == ["MISSION_REQUEST"]


def test_fence_and_rally_are_stored_apart_from_the_mission(ground, item):
    g = ground()
    g.upload(item(0, 0, 0), item(1, 100, 0))
    fence = [item(k, 100 * k, k * k, command=5001, param1=3.0, mission_type=1) for k in range(3)]
    rally = [item(0, 50, 50, command=5100, mission_type=2)]
    assert g.upload(*fence, mission_type=1) == 0
    assert g.upload(*rally, mission_type=2) == 0
    assert [(m.command, m.x, m.param1, m.mission_type) for m in g.download(1)] == [
        (5001, f.x, 3.0, 1) for f in fence
    ]
    assert [(m.command, m.x) for m in g.download(2)] == [(5100, rally[0].x)]
    assert [m.command for m in g.download()] == [16, 16]
    assert g.upload(item(0, 0, 0, mission_type=1), mission_type=1) == mavlink.MAV_MISSION_UNSUPPORTED


def test_a_request_beyond_the_end_is_answered_with_the_size_and_an_error(ground, item):
    g = ground()
    g.upload(item(0, 0, 0), item(1, 100, 0))
    replies = g.send(mavlink.MAVLink_mission_request_int_message(7, 1, 9, 0))
    assert kinds(replies) == ["MISSION_COUNT", "MISSION_ACK"]
    assert (replies[0].count, replies[1].type) == (2, mavlink.MAV_MISSION_ERROR)


def test_the_older_float_items_work_both_ways(ground, item):
    g = ground()
    as_int = item(1, 123, 456)
    g.send(count(2))
    g.send(item(0, 0, 0))
    lat, lon = as_int.x * 1e-7, as_int.y * 1e-7
    old = mavlink.MAVLink_mission_item_message(7, 1, 1, 3, 16, 0, 1, 0, 0, 0, 0, lat, lon, 100, 0)
    assert last_ack(g.send(old)) == mavlink.MAV_MISSION_ACCEPTED
    back = g.send(mavlink.MAVLink_mission_request_message(7, 1, 1, 0))[-1]
    assert back.get_type() == "MISSION_ITEM"
    assert back.x == pytest.approx(lat, abs=1e-5)


def test_a_partial_upload_replaces_only_its_items(ground, item):
    g = ground()
    g.upload(*(item(k, 100 * k, 0) for k in range(4)))
    replies = g.send(mavlink.MAVLink_mission_write_partial_list_message(7, 1, 2, 2, 0))
    assert [m.seq for m in replies] == [2]
    assert last_ack(g.send(item(2, 0, 700))) == mavlink.MAV_MISSION_ACCEPTED
    assert [m.x for m in g.download()[1:]] == [item(0, e, n).x for e, n in ((100, 0), (0, 700), (300, 0))]


def test_progress_is_reported_as_it_happens(ground, item):
    g = ground()
    g.upload(item(0, 0, 0), item(1, 150, 0), item(2, 400, 0))
    g.command(mavlink.MAV_CMD_MISSION_START)
    heard = g.until(lambda: g.mode == 11)
    assert [m.seq for m in heard if m.get_type() == "MISSION_ITEM_REACHED"] == [1, 2]
    current = [m for m in heard if m.get_type() == "MISSION_CURRENT"]
    assert {m.total for m in current} == {2}
    assert [m.seq for m in current] == sorted(m.seq for m in current)
    assert current[-1].mission_state == mavlink.MISSION_STATE_COMPLETE


def test_set_current_message_has_no_ack_and_fails_silently(ground, item):
    g = ground()
    g.upload(*(item(k, 1000 * k, 0) for k in range(4)))
    replies = g.send(mavlink.MAVLink_mission_set_current_message(7, 1, 2))
    assert [(m.get_type(), m.seq) for m in replies] == [("MISSION_CURRENT", 2)]
    assert g.send(mavlink.MAVLink_mission_set_current_message(7, 1, 9)) == []
