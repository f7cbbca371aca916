"""A PX4 would stay armed with a mission that was refused, or be given up as an operator's."""

import pytest
from helpers.plane_double import GCS, Channel, Joined, authority_in, upload_task
from helpers.px4_double import AUTO, HOLD, Px4
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import PX4
from gcs.mavlink.frames.codec import Encoder
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import Mission, Waypoint

HOME = Home(-35.3632621, 149.165237, 584.09)
MISSION = Mission(1, 1, tuple(Waypoint(-35.36 + n * 1e-3, 149.16, 100.0, 10.0) for n in range(4)))
NAMES = {AUTO: "AUTO", HOLD: "LOITER"}


def joined(px4, *, loss=0.0, **options):
    options.setdefault("authority", authority_in(NAMES[px4.mode]))
    task = upload_task(MISSION, HOME, Encoder(), profile=PX4, **options)
    way = {"loss": loss, "delay_s": (0.02, 0.02)}
    return Joined(task, px4, Channel(1, **way), Channel(2, **way))


def test_a_take_off_reads_back_equal_though_px4_keeps_no_pitch():
    """All eight uploads were refused, and no PX4 got off the ground."""
    px4 = Px4()
    link = joined(px4, from_ground=True)
    result = link.run()
    assert (result.ok, px4.uploads) == (True, 1)
    assert px4.store[0].command == 22


@pytest.mark.parametrize("mode", [AUTO, HOLD])
def test_a_mission_that_reads_back_differently_is_held_and_cleared(mode):
    px4 = Px4(mode=mode, tamper=lambda fields: (*fields[:5], fields[5] + 1.0, *fields[6:]))
    result = joined(px4).run()
    assert (result.ok, result.onboard) == (False, "cleared")
    assert "param2 is 11 instead of 10" in result.detail
    assert px4.store == []
    assert px4.mode == HOLD


def test_an_old_mission_that_is_still_there_is_kept():
    px4 = Px4(mode=AUTO)
    old = build_items(PX4, Mission(2, 1, MISSION.waypoints[:2]), HOME)
    px4.store, px4.valid = [item.message(seq, 1, 1) for seq, item in enumerate(old)], True
    px4._on_mission_count = lambda _message, sender: [px4_refusal(sender)]
    result = joined(px4, old=old).run()
    assert (result.ok, result.onboard) == (False, "old")
    assert len(px4.store) == len(old)
    assert px4.mode == AUTO


def px4_refusal(sender):
    return dialect.MAVLink_mission_ack_message(*sender, dialect.MAV_MISSION_DENIED, 0)


@pytest.mark.parametrize("mode", [AUTO, HOLD])
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_mission_that_the_navigator_rejects_is_no_operators_doing(mode, loss):
    """It was acknowledged; then the vehicle is in Hold, as if another station had chosen it."""
    px4, authority = Px4(mode=mode, rejects=True), authority_in(NAMES[mode])
    result = joined(px4, authority=authority, loss=loss).run()
    assert not result.ok
    assert "navigator rejects the mission" in result.detail
    assert authority.override == ""
    assert (result.onboard, px4.store) == ("cleared", [])


def test_a_hold_that_another_station_chooses_is_still_an_override():
    px4, authority = Px4(mode=AUTO), authority_in("AUTO")
    link = joined(px4, authority=authority)
    select = px4._on_mission_set_current

    def taken(message, sender):
        px4.choose(HOLD)
        return [*select(message, sender), px4._heartbeat()]

    px4._on_mission_set_current = taken
    result = link.run()
    assert (result.ok, authority.override, result.onboard) == (False, "LOITER", "equal")
    assert px4.store


def test_an_upload_without_loss_counts_no_retries_while_the_item_is_shown_at_1_hz(monkeypatch):
    """An operator would suspect the link, and fewer vehicles would be served at a time."""
    px4 = Px4(mode=AUTO)
    answer = px4._on_command_long

    def without_current(message, sender):
        is_current = (message.command, message.param1) == (512, 42)  # the firmware denies it
        return answer(message, sender)[: 1 if is_current else None]

    monkeypatch.setattr(px4, "_on_command_long", without_current)
    result = joined(px4).run()
    assert (result.ok, result.retries) == (True, 0)


def test_a_mission_that_is_rejected_on_the_ground_is_not_verified():
    """PX4 goes to AUTO all the same there, and is refused at arming: for 165 s nobody knew why."""
    px4 = Px4(rejects=True)
    px4.armed = False
    obey = px4._on_command_long

    def to_any_mode(message, sender):
        px4.valid, was_valid = message.command == 176 or px4.valid, px4.valid
        answers = obey(message, sender)
        px4.valid = was_valid
        return answers

    px4._on_command_long = to_any_mode
    link = joined(px4)
    result = link.run()
    assert (result.ok, link.task.state.activation.is_unflyable, px4.store) == (False, True, [])
    assert "navigator rejects the mission" in result.detail


def test_a_late_request_for_the_last_item_does_not_disturb_a_clearing():
    """8.5 s later the read-back began, and the upload ended by a program error."""
    px4 = Px4(mode=HOLD, tamper=lambda fields: (*fields[:5], fields[5] + 1.0, *fields[6:]))
    px4._on_mission_clear_all = lambda _message, _sender: []
    link = joined(px4)
    link.up.put(link.task.start(0), 0)
    while link.task.stage != "clear":
        link.step()
    last = dialect.MAVLink_mission_request_int_message(*GCS, len(link.task.items) - 1, 0)
    px4._heartbeat, beat = lambda: last, px4._heartbeat
    for _ in range(40):
        link.step()
    px4._heartbeat = beat
    result = link.run()
    assert (result.ok, result.onboard) == (False, "unknown")
    assert "the clearing was not confirmed" in result.detail
