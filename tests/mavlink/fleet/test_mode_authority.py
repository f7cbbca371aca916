"""An operator would lose the aircraft to a service that takes it out of their hands."""

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import PX4
from gcs.mavlink.fleet.mode_authority import ModeAuthority

PX4_HOLD, PX4_RTL = 4 << 16 | 3 << 24, 4 << 16 | 5 << 24


def after(*steps):
    authority = ModeAuthority()
    for step in steps:
        kind, _, mode = step.partition(" ")
        if kind == "hear":
            authority.observe_mode(mode, 0)
        elif kind == "end":
            authority.observe_mode(mode, 0, at_end=True)
        elif kind == "order":
            authority.note_command(mode)
        else:
            getattr(authority, kind)(0)
    return authority.override


def test_a_loiter_before_the_first_mission_waits_for_it():
    assert after("hear LOITER") == ""
    assert after("hear FBWA", "hear LOITER") == ""


def test_a_loiter_that_we_ordered_is_ours():
    assert after("hear AUTO", "order LOITER", "hear LOITER") == ""


def test_a_loiter_in_the_midst_of_a_mission_is_an_operators():
    assert after("hear AUTO", "hear LOITER") == "LOITER"
    assert after("hear LOITER", "order AUTO", "hear AUTO", "hear LOITER") == "LOITER"


def test_a_loiter_that_we_ordered_once_does_not_excuse_the_next():
    assert (
        after("hear AUTO", "order LOITER", "hear LOITER", "order AUTO", "hear AUTO", "hear LOITER")
        == "LOITER"
    )
    assert after("hear AUTO", "order LOITER", "hear LOITER", "hear FBWA", "hear LOITER") == "LOITER"


def test_other_modes_are_taken_until_auto_or_an_order():
    assert after("hear AUTO", "hear RTL") == "RTL"
    assert after("hear AUTO", "hear RTL", "hear AUTO") == ""
    assert after("hear AUTO", "hear LOITER", "release") == ""
    assert after("hear AUTO", "hear RTL", "release", "hear LOITER") == ""


def test_a_missions_end_in_hold_is_ours():
    assert after("hear AUTO", "end LOITER") == ""


def test_a_px4_that_ends_its_return_in_hold_is_left_alone():
    """Flown: in RTL it follows the landing of its mission, to the last item, and may then hold."""
    assert after("hear AUTO", "hear RTL", "end LOITER") == "LOITER"
    authority = ModeAuthority()
    authority.release(0)  # the mission after an order to resume is not flown yet
    for seconds, custom_mode in enumerate([PX4_HOLD, PX4_RTL, PX4_HOLD]):
        heartbeat = dialect.MAVLink_heartbeat_message(1, dialect.MAV_AUTOPILOT_PX4, 0x81, custom_mode, 4, 3)
        authority.observe_heartbeat(heartbeat, PX4, seconds, at_end=False)
    assert authority.override == "LOITER"


def test_a_reboot_gives_nothing_back():
    assert after("hear AUTO", "hear LOITER", "note_reboot", "hear LOITER") == "LOITER"
    assert after("hear AUTO", "note_reboot", "hear MANUAL") == "MANUAL"
