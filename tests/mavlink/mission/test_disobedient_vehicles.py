"""A user would lose a vehicle, or the link, to an upload that goes on without end or word."""

import math

import pytest
from helpers.plane_double import AUTO, LOITER, Channel, Joined, OfPlane, Plane, S, authority_in, upload_task
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import ARDUPLANE
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import Mission, Waypoint

HOME = Home(-35.3632621, 149.165237, 584.09)


def mission(points, shift_deg=0.0):
    route = tuple(Waypoint(-35.36 + n * 1e-3 + shift_deg, 149.16, 100.0, 10.0) for n in range(points))
    return Mission(1, 1, route)


class Talk(Joined):
    """An upload to a plane, with what was sent and what the operator was told."""

    def __init__(self, plane, *, clearing=False):
        old = build_items(ARDUPLANE, mission(6, 0.01), HOME)
        plane.load(old, current=2)
        authority = authority_in({AUTO: "AUTO", LOITER: "LOITER"}[plane.mode])
        task = upload_task(
            mission(8),
            HOME,
            Encoder(),
            authority=authority,
            policy=OfPlane(plane),
            current=2,
            inconsistent=clearing,
        )
        super().__init__(task, plane, Channel(1), Channel(2))
        self.sent, self.told = [], []
        put = self.up.put
        self.up.put = lambda frames, t_ns: (self.sent.extend(frames), put(frames, t_ns))
        self.each_step = lambda now: self.told.append((now.t_ns / S, now.task.slowness(now.t_ns)))
        if clearing:
            self.up.put(task.start_clearing(0), 0)

    def end(self):
        result = self.run(600.0)
        self.told = [(t_s, text) for t_s, text in self.told if text]
        return result

    def count(self, kind):
        return [decode(frame)[0][0].get_type() for frame in self.sent].count(kind)


def test_a_clearing_that_is_acknowledged_and_not_done_is_given_up():
    """MISSION_CLEAR_ALL was sent ten times a second without end."""
    plane = Plane(mode=LOITER)
    plane._on_mission_clear_all = lambda _m, sender, _t: [plane._ack(0, sender)]
    talk = Talk(plane, clearing=True)
    result = talk.end()
    assert (result.ok, result.onboard) == (False, "unknown")
    assert "7 items left by 4 acknowledged clearings: the vehicle does not obey" in result.detail
    assert result.duration_s < 20.0
    assert talk.count("MISSION_CLEAR_ALL") <= 8


def test_a_read_back_with_one_item_missing_ends_with_a_word():
    """It kept the vehicle in LOITER for 300 s, in silence."""
    plane = Plane(mode=AUTO, leg_s=math.inf)
    send = plane._on_mission_request_int
    plane._on_mission_request_int = lambda m, sender, t: [] if m.seq == 5 else send(m, sender, t)
    talk = Talk(plane)
    result = talk.end()
    assert not result.ok
    assert "its read-back goes on at 9 of 10 items for 25 s: the vehicle does not obey" in result.detail
    assert result.duration_s < 75.0
    assert 9.0 < talk.told[0][0] < 11.0
    assert talk.told[0][1]["waits_for"] == "9 of 10 items read back"
    assert len(talk.told) <= 3
    assert plane.store == []


@pytest.mark.parametrize("wrong", [-2, 3])
def test_a_wrong_count_ends_with_a_word(wrong):
    """It kept the vehicle busy for 170 s."""
    plane = Plane(mode=AUTO, leg_s=math.inf)
    plane._on_mission_request_list = lambda _m, sender, _t: [
        dialect.MAVLink_mission_count_message(*sender, max(0, len(plane.store) + wrong), 0)
    ]
    talk = Talk(plane)
    result = talk.end()
    assert not result.ok
    assert "does not obey" in result.detail
    assert result.duration_s < 120.0
    assert talk.count("MISSION_COUNT") <= 12
    assert result.duration_s < 10.0 or talk.told


def test_an_item_that_is_requested_again_and_again_ends_with_a_word():
    plane = Plane(mode=AUTO, leg_s=math.inf)

    def first(_message, sender, _t_ns):
        return [dialect.MAVLink_mission_request_message(*sender, 0, 0)]

    plane._on_mission_count = plane._on_mission_item_int = first
    talk = Talk(plane)
    result = talk.end()
    assert not result.ok
    assert (
        "it requests items again and again at 1 of 10 items for 25 s: the vehicle does not obey"
        in result.detail
    )
    assert result.duration_s < 120.0
    assert talk.told


@pytest.mark.parametrize(
    "ignored", ["COMMAND_LONG", "MISSION_SET_CURRENT", "MISSION_COUNT", "MISSION_CLEAR_ALL"]
)
def test_whatever_a_vehicle_does_not_hear_the_operator_is_told_within_ten_seconds(ignored):
    plane = Plane(mode=LOITER)
    plane.ignores = {ignored}
    talk = Talk(plane, clearing=ignored == "MISSION_CLEAR_ALL")
    result = talk.end()
    assert result is not None
    assert not result.ok
    assert 9.0 < talk.told[0][0] < 11.0
    assert result.duration_s < 150.0
    assert len(talk.sent) < 800
