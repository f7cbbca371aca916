"""An operator would lose the aircraft to a service that takes it out of their hands."""

from gcs.mavlink.fleet.mode_authority import ModeAuthority


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


def test_a_reboot_gives_nothing_back():
    assert after("hear AUTO", "hear LOITER", "note_reboot", "hear LOITER") == "LOITER"
    assert after("hear AUTO", "note_reboot", "hear MANUAL") == "MANUAL"
