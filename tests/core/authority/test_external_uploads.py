"""Other ground stations: their commands are seen, and a vehicle with their mission is overridden."""

from __future__ import annotations

import math

import pytest
from helpers.noticed import noticed
from helpers.other_station import AIR, PEER, SEAT, S, Stage
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Encoder, decode
from gcs.model import (
    Datagram,
    LinkNews,
    Notice,
    NoticeCode,
    Order,
    OrderAnswer,
    Route,
    Send,
    UploadReport,
    read_only,
    vehicle_name,
    vehicle_of,
)

BROKEN = (NoticeCode.STATION_UPLOAD_BROKEN, NoticeCode.STATION_UPLOAD_MIXED)


@pytest.fixture
def stage() -> Stage:
    return Stage()


def notices(effects) -> list[Notice]:
    return [effect for effect in effects if isinstance(effect, Notice)]


def test_a_vehicle_with_a_mission_of_another_station_is_overridden_until_resumed(stage):
    (notice,) = notices(stage.say(SEAT, dialect.MAVLink_mission_count_message(1, 1, 3, 0)))
    assert (notice.code, notice.vehicle) == (NoticeCode.STATION_WRITES, 1)
    assert notice.parameters["station"] == "system 254/190 at 10.0.0.5:50"
    assert "left alone" in stage.engine.untaskable()[1]
    ack = dialect.MAVLink_mission_ack_message(254, 190, 0, 0)
    (notice,) = notices(stage.say(AIR, ack, 1, 1))
    assert notice.code is NoticeCode.STATION_WROTE
    stage.wait(60.0)
    assert not noticed(stage.effects, *BROKEN)
    assert 1 in stage.engine.untaskable()
    assert any(isinstance(e, OrderAnswer) for e in stage.order("resume"))
    assert "mission of" not in stage.engine.untaskable().get(1, "")


def test_an_upload_that_breaks_off_or_is_refused_is_an_alarm(stage):
    stage.say(SEAT, dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    stage.say(SEAT, dialect.MAVLink_mission_item_int_message(1, 1, 0, 3, 16, 0, 1, 0, 0, 0, 0, 0, 0, 0))
    assert not noticed(stage.wait(9.0), *BROKEN)
    (notice,) = noticed(stage.wait(2.0), *BROKEN)
    assert notice.parameters["how"] == "broke off"
    stage.say(SEAT, dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    refused = dialect.MAVLink_mission_ack_message(254, 190, 15, 0)
    (notice,) = notices(stage.say(AIR, refused, 1, 1))
    assert notice.code is NoticeCode.STATION_UPLOAD_MIXED
    assert notice.parameters["how"] == "refused with MAV_MISSION_RESULT 15"


def test_a_fence_and_a_download_override_no_vehicle(stage):
    stage.say(SEAT, dialect.MAVLink_mission_count_message(1, 1, 3, 1))
    stage.say(SEAT, dialect.MAVLink_mission_request_list_message(1, 1, 0))
    assert not any("mission of" in why for why in stage.engine.untaskable().values())


def test_orders_of_another_station_are_noticed_once_in_a_while_and_requests_are_not(stage):
    arm = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    ask = dialect.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)
    (notice,) = notices(stage.say(SEAT, arm))
    assert (notice.code, notice.vehicle) == (NoticeCode.STATION_ARMS, 1)
    assert notice.parameters["message"] == "MAV_CMD_COMPONENT_ARM_DISARM"
    assert notice.parameters["station"] == "system 254/190 at 10.0.0.5:50"
    assert not stage.say(SEAT, arm)
    assert not stage.say(SEAT, ask)
    stage.t_ns += 11 * S
    assert stage.say(SEAT, arm)


def test_garbage_from_another_station_is_nothing(stage):
    assert stage.step(Datagram(S, SEAT, PEER, b"\xfd\xfe" * 300)) == []


def test_the_same_system_id_on_two_networks_is_two_vehicles(stage):
    other = "udpin:0.0.0.0:14560"
    stage.say(other, dialect.MAVLink_heartbeat_message(1, 3, 217, 12, 4, 3), 1, 1, "10.0.2.1:50")
    stage.wait(0.1)
    health = {h.system_id: h.address for h in stage.engine.stages.fleet.health()}
    assert health == {1: (AIR, PEER), 2 * 256 + 1: (other, "10.0.2.1:50")}
    sent = [e for e in stage.effects if isinstance(e, Send) and e.link == other]
    assert sent
    questions = [m for e in sent if (m := _message(e.data)).get_type() == "COMMAND_LONG"]
    assert questions
    assert {m.target_system for m in questions} == {1}


def _message(data: bytes):
    return dialect.MAVLink(None).decode(bytearray(data))


def test_a_vehicle_of_another_network_is_ordered_and_named_by_network_and_system_id(stage):
    assert vehicle_of("2:1") == 513
    assert vehicle_name(513) == "2:1"
    (answer, *_) = stage.step(Order(stage.t_ns, "a", "hold", (513,)))
    assert (answer.state, answer.detail) == ("refused", "never heard")
    (answer, *_) = stage.step(Order(stage.t_ns, "b", "hold", (77,)))
    assert "it has 1, 2:1" in answer.detail


def test_news_of_a_link_is_reported(stage):
    notice = Notice(S, NoticeCode.LINK_FAILED, "tcp:10.0.0.1:5760", {"problem": "connection lost"})
    assert stage.step(LinkNews(notice)) == [notice]


def test_counters_of_each_link_count_received_and_lost_frames(stage):
    encode = Encoder(1, 1)
    beats = [encode(dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3)) for _ in range(6)]
    broken = bytes([*beats[4][:-1], beats[4][-1] ^ 1])
    unknown_system = Encoder(77, 1)(dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3))
    for data in (beats[1], beats[3], broken, unknown_system):
        stage.step(Datagram(stage.t_ns, AIR, PEER, data))
    stage.step(Datagram(stage.t_ns, AIR, "10.6.6.6:1", beats[5]))
    counted = stage.engine.stages.fleet.links[AIR]
    assert (counted.datagrams, counted.frames, counted.crc_errors) == (6, 5, 1)
    assert (counted.lost, counted.unknown_systems, counted.conflicts) == (1, 1, 1)


STEERING = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_SET_CURRENT", "MISSION_CLEAR_ALL")
RTL_COMMANDS = {
    "return": dialect.MAVLink_command_long_message(1, 1, 20, 0, *[0.0] * 7),
    "mode": dialect.MAVLink_command_long_message(1, 1, 176, 0, 1.0, 11.0, *[0.0] * 5),
    "integer": dialect.MAVLink_command_int_message(1, 1, 0, 20, 0, 0, *[0.0] * 4, 0, 0, 0.0),
    "to all": dialect.MAVLink_command_long_message(0, 0, 20, 0, *[0.0] * 7),
    "without a number": dialect.MAVLink_command_long_message(1, 1, 176, 0, 1.0, math.nan, *[0.0] * 5),
    "without a bound": dialect.MAVLink_command_long_message(1, 1, 176, 0, 1.0, 11.0, math.inf, *[0.0] * 4),
    "old message": dialect.MAVLink_set_mode_message(1, 1, 11),
    "guided": dialect.MAVLink_set_position_target_global_int_message(0, 1, 1, 6, 0, 1, 1, 90.0, *[0.0] * 8),
}


@pytest.mark.parametrize("command", RTL_COMMANDS.values(), ids=RTL_COMMANDS)
def test_nothing_is_uploaded_after_another_station_commanded_a_mode(stage, command):
    """The vehicle's heartbeat shows it up to a second later."""
    route = Route(1, (0, 0), read_only([[0.0, 500.0], [500.0, 500.0]]), 1.0)
    stage.effects += stage.engine.stages.tasking.enqueue_upload(route, stage.t_ns)
    stage.engine.state.agents[1].routes.flown = route
    stage.wait(0.1)
    stage.say(AIR, dialect.MAVLink_heartbeat_message(1, 3, 217, 12, 4, 3), 1, 1)  # the LOITER commanded
    kinds = [m.get_type() for e in stage.effects if isinstance(e, Send) for m in decode(e.data)[0]]
    assert "MISSION_COUNT" in kinds
    stage.say(SEAT, command)
    assert "left alone" in stage.engine.untaskable()[1]
    stage.effects.clear()
    for seq in (0, 1):
        stage.say(AIR, dialect.MAVLink_mission_request_message(255, 195, seq, 0), 1, 1)
        stage.wait(0.1)
    sent = [m.get_type() for e in stage.effects if isinstance(e, Send) for m in decode(e.data)[0]]
    assert not set(sent) & set(STEERING)
    (report,) = [e for e in stage.effects if isinstance(e, UploadReport)]
    assert "system 254/190 at 10.0.0.5:50 commands a mode" in report.detail


def test_a_command_that_is_not_obeyed_overrides_no_vehicle_for_long(stage):
    stage.say(SEAT, RTL_COMMANDS["return"])
    for _ in range(4):
        stage.wait(1.0)
        stage.say(AIR, dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3), 1, 1)
    assert 1 not in stage.engine.untaskable()


def test_a_command_to_fly_the_mission_takes_no_vehicle_away(stage):
    stage.say(SEAT, dialect.MAVLink_command_long_message(1, 1, 176, 0, 1.0, 10.0, *[0.0] * 5))
    assert 1 not in stage.engine.untaskable()


def test_the_answer_to_a_command_that_went_another_way_counts_too(stage):
    stage.say(AIR, dialect.MAVLink_command_ack_message(176, 0, 0, 0, 254, 190), 1, 1)
    assert "system 254/190" in stage.engine.untaskable()[1]


def test_the_alarms_of_another_stations_mission_end_with_the_order_to_resume(stage):
    """The vehicle stayed in AUTO all the time: they stayed for ever."""
    stage.say(SEAT, dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    stage.wait(12.0)
    codes = [e.code for e in stage.effects if isinstance(e, Notice)]
    assert {NoticeCode.STATION_WRITES, NoticeCode.STATION_UPLOAD_MIXED} <= set(codes)
    assert NoticeCode.OURS_AGAIN not in codes
    stage.say(AIR, dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3), 1, 1)
    stage.order("resume")
    for _ in range(4):
        stage.wait(1.0)
        stage.say(AIR, dialect.MAVLink_heartbeat_message(1, 3, 217, 12, 4, 3), 1, 1)
    assert stage.engine.untaskable() == {}
    assert [e.code for e in stage.effects if isinstance(e, Notice)].count(NoticeCode.OURS_AGAIN) == 1
