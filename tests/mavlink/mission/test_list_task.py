"""A user would fly behind a fence that the vehicle does not have, or return to a rally point of yesterday."""

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.fence import Area, Fence, Rally
from gcs.geo import LocalFrame
from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Encoder, decode
from gcs.mavlink.mission.geofence_rally import (
    FENCE,
    RALLY,
    fence_from_items,
    fence_items,
    list_difference,
    rally_items,
)
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_kinds import list_upload
from gcs.mavlink.mission.upload_rules import LIST_RULES
from gcs.mavlink.mission.upload_stages import Event, Stage
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

S = 1_000_000_000
FRAME = LocalFrame(33.2, -87.6, 70.0)
SQUARE = ((33.19, -87.61), (33.23, -87.61), (33.23, -87.57), (33.19, -87.57))
ITEMS = fence_items(Fence((Area(True, SQUARE), Area(False, (), (33.21, -87.59), 80.0))))
END_AFTER_ERROR = Upload.end_after_error
POINTS = rally_items([Rally(33.205, -87.595, 90), Rally(33.206, -87.594, 120)])


def vehicle(autopilot="ardupilot"):
    return SimVehicle(VehicleSpec(7, 0.0, 0.0, 0.0, 100.0, 15.0, autopilot=autopilot), FRAME, 0)


def talk(task, plane, *, loss=0.0, seed=0, end_s=200.0, change=lambda messages: messages):
    """Let both talk, a step of 50 ms late each way, until the task has ended."""
    rng, t_ns, to_plane = np.random.default_rng(seed), plane._stepped_ns + S, deque()
    while task.result is None and t_ns < end_s * S:
        for data in [to_plane.popleft() for _ in range(len(to_plane))]:
            plane.receive_datagram(data, t_ns)
        heard = [m for data in plane.datagrams_to_send(t_ns) for m in decode(data)[0]]
        frames = [f for m in change(heard) if rng.random() >= loss for f in task.receive(m, t_ns)]
        to_plane += [frame for frame in frames + task.poll(t_ns) if rng.random() >= loss]
        t_ns += S // 20
    assert task.result is not None, "it never ended"
    return task.result


def begin(plane, mission_type, items):
    return list_upload(7, mission_type, items, Encoder(), plane._stepped_ns + S)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize(("mission_type", "items"), [(FENCE, ITEMS), (RALLY, POINTS)])
def test_uploaded_items_are_stored_and_cleared_ones_are_gone(autopilot, mission_type, items):
    plane = vehicle(autopilot)
    done = talk(begin(plane, mission_type, items), plane)
    assert (done.ok, done.detail, done.retries) == (True, "read back equal", 0)
    held = talk(begin(plane, mission_type, None), plane).items
    assert not list_difference(mission_type, items, held)
    assert len(plane.autopilot.mission) == 0
    assert talk(begin(plane, mission_type, ()), plane).ok
    assert talk(begin(plane, mission_type, None), plane).items == ()


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("seed", range(6))
def test_success_over_a_radio_that_loses_a_third_means_that_the_vehicle_holds_it(autopilot, seed):
    plane = vehicle(autopilot)
    result = talk(begin(plane, FENCE, ITEMS), plane, loss=0.3, seed=seed)
    held = talk(begin(plane, FENCE, None), plane).items
    assert result.ok
    assert not list_difference(FENCE, ITEMS, held)


def test_a_fence_that_the_vehicle_changed_on_the_way_is_not_called_uploaded():
    plane = vehicle()

    def moved(messages):
        for message in messages:
            if message.get_type() == "MISSION_ITEM_INT" and message.seq == 2:
                message.x += 500
        return messages

    result = talk(begin(plane, FENCE, ITEMS), plane, change=moved)
    assert not result.ok
    assert "read-back differs: item 2" in result.detail


def test_another_ground_stations_words_and_another_list_are_not_taken_for_ours():
    plane = vehicle()
    wrong = [
        dialect.MAVLink_mission_ack_message(255, 190, dialect.MAV_MISSION_ERROR, FENCE),
        dialect.MAVLink_mission_ack_message(0, 0, dialect.MAV_MISSION_ERROR, RALLY),
    ]

    def disturbed(messages):
        own = Encoder(7, 1)
        return [*(decode(own(message))[0][0] for message in wrong), *messages]

    result = talk(begin(plane, FENCE, ITEMS), plane, change=disturbed)
    assert (result.ok, result.retries) == (True, 0)


def test_a_vehicle_without_fences_and_one_without_an_answer_differ():
    plane, own = vehicle(), Encoder(7, 1)
    refusal = dialect.MAVLink_mission_ack_message(0, 0, dialect.MAV_MISSION_UNSUPPORTED, FENCE)
    task = begin(plane, FENCE, ITEMS)
    result = talk(task, plane, change=lambda _: [decode(own(refusal))[0][0]])
    assert (result.ok, result.detail) == (False, "the vehicle does not support it: UNSUPPORTED")
    silent = talk(begin(plane, FENCE, ITEMS), plane, change=lambda _: [])
    assert not silent.ok
    assert "no answer" in silent.detail


def test_items_mean_the_fence_that_they_were_made_from():
    fence = fence_from_items(ITEMS)
    assert [area.stay_in for area in fence.areas] == [True, False]
    assert fence.areas[1].radius_m == 80.0
    for got, want in zip(fence.areas[0].corners_deg, SQUARE, strict=True):
        assert math.dist(got, want) < 1e-7
    assert fence_from_items(ITEMS[1:]) is None


MESSAGES = st.sampled_from(["REQUEST", "ACK", "COUNT", "ITEM"])


@settings(max_examples=150, derandomize=True)
@given(
    st.sampled_from([ITEMS, (), None]),
    st.lists(
        st.tuples(st.floats(0.0, 20.0), MESSAGES, st.integers(0, 8), st.sampled_from([0, 0, 1, 3, 13, 15]))
    ),
)
def test_messages_in_any_order_end_it_at_most_once_and_never_with_a_false_success(items, steps):
    task, t_ns, to = list_upload(7, FENCE, items, Encoder(), 0), 0, (GCS_SYSTEM_ID, GCS_COMPONENT_ID)
    for wait_s, kind, n, answer in steps:
        t_ns += round(wait_s * S)
        before = task.result
        message = {
            "REQUEST": dialect.MAVLink_mission_request_int_message(*to, n, FENCE),
            "ACK": dialect.MAVLink_mission_ack_message(*to, answer, FENCE),
            "COUNT": dialect.MAVLink_mission_count_message(*to, n, FENCE),
            "ITEM": ITEMS[n % len(ITEMS)].message(n, *to, mission_type=FENCE),
        }[kind]
        frames = task.poll(t_ns) + task.receive(decode(Encoder(7, 1)(message))[0][0], t_ns)
        assert before is None or (task.result is before and not frames)
    if task.result is not None and task.result.ok and items is not None:
        assert not list_difference(FENCE, items, task.result.items)


def test_messages_about_another_list_change_nothing():
    """A request for a mission item was answered with an item of the fence."""
    task, to = list_upload(7, FENCE, ITEMS, Encoder(), 0), (GCS_SYSTEM_ID, GCS_COMPONENT_ID)
    task.poll(0)
    request = dialect.MAVLink_mission_request_int_message(*to, 0, 0)
    assert task.receive(decode(Encoder(7, 1)(request))[0][0], 1) == []


@pytest.mark.parametrize(("stage", "items"), [(Stage.UPLOAD, ITEMS), (Stage.CLEAR, ())])
def test_a_program_error_ends_it_as_failed_and_not_the_program(monkeypatch, stage, items):
    """The error left the event loop: the fences of all other vehicles were not uploaded either."""
    plane = vehicle()
    task = begin(plane, FENCE, items)
    without = {key: rules for key, rules in LIST_RULES.table.items() if key != (stage, Event.MISSION_ACK)}
    task.rules = LIST_RULES._replace(table=without)
    monkeypatch.setattr(Upload, "end_after_error", END_AFTER_ERROR)
    result = talk(task, plane)
    assert (result.ok, result.items) == (False, None)
    assert f"(no rule for MISSION_ACK in {stage}); what is stored is unknown" in result.detail
    assert task.poll(10**12) == []
