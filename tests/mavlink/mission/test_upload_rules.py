"""A user would lose the aircraft to an order of messages that no engineer thought of."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest
from helpers.plane_double import (
    AUTO,
    GCS,
    LOITER,
    MANUAL,
    RTL,
    Channel,
    Joined,
    OfPlane,
    Plane,
    S,
    UploadTask,
    authority_in,
    upload_task,
)
from helpers.upload_diagram import diagram
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import ARDUPLANE, PX4
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.mavlink.mission import _upload_guards as when
from gcs.mavlink.mission import upload_rules
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.mavlink.mission.upload_rules import LIST_RULES, MISSION_RULES
from gcs.mavlink.mission.upload_stages import Choice, Event, OnboardState, Stage
from gcs.model import Mission, Waypoint

HOME = Home(-35.3632621, 149.165237, 584.09)
MODES = {AUTO: "AUTO", LOITER: "LOITER", RTL: "RTL", MANUAL: "MANUAL"}
OLD_POINTS = 8


def mission(points, shift_deg=0.0):
    places = [(-35.36 + n * 1e-3 + shift_deg, 149.16) for n in range(points)]
    return Mission(1, 1, tuple(Waypoint(*place, 100.0, 10.0) for place in places))


OLD = build_items(ARDUPLANE, mission(OLD_POINTS, 0.01), HOME)


STEERS = {
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_SET_CURRENT",
    "MISSION_CLEAR_ALL",
    "MISSION_WRITE_PARTIAL_LIST",
    "SET_MODE",
}


def steers(message):
    """Whether a message can change what a vehicle does: all but requests for messages, and ACKs."""
    is_command = message.get_type() == "COMMAND_LONG" and message.command not in (511, 512)
    return is_command or message.get_type() in STEERS


def commands(message, mode):
    """Whether a message commands a mode of an ArduPlane or a PX4."""
    numbers = {"AUTO": [(10, 0), (4, 4)]}[mode]
    is_mode = message.get_type() == "COMMAND_LONG" and message.command == dialect.MAV_CMD_DO_SET_MODE
    return is_mode and (message.param2, message.param3) in numbers


class Recorded(UploadTask):
    """A task whose stages are recorded, and whose frames are checked as they leave."""

    stores = staticmethod(lambda: None)
    """Says whether its vehicle stores an inconsistent mission; None if nobody knows."""

    def __init__(self, *args, **options):
        self.recorded = [(Stage.NEW, Stage.NEW)]
        super().__init__(*args, **options)

    def _enter(self, stage, t_ns):
        self.recorded.append((self.stage, stage))
        super()._enter(stage, t_ns)

    def _take_frames(self, t_ns):
        frames = super()._take_frames(t_ns)
        for message in [decode(frame)[0][0] for frame in frames]:
            assert not (steers(message) and self.flight.authority.taken_by), (self.stage, message)
            if commands(message, "AUTO"):
                known = self.state.verification.onboard
                assert known in (OnboardState.EQUAL, OnboardState.OLD), known
                assert self.stores() is not True
        return frames

    def check(self):
        """No stage was entered but through the rules, and the result agrees with itself."""
        assert all(a[1] is b[0] for a, b in pairwise(self.recorded))
        assert self.recorded[-1][1] is self.stage
        assert (self.result is not None) == (self.stage is Stage.DONE)
        if self.result is not None:
            assert isinstance(self.result.onboard, OnboardState)
            assert self.result.onboard is OnboardState.EQUAL or not self.result.ok
            assert self.result.detail


def said(message, sender=(1, 1)):
    return decode(Encoder(*sender)(message))[0][0]


def built(name, *strategies):
    return st.tuples(*strategies).map(lambda values: getattr(dialect, f"MAVLink_{name}_message")(*values))


numbers = st.integers(0, 9) | st.integers(0, 65535)
systems, components = st.sampled_from([GCS[0]] * 5 + [0, 254]), st.sampled_from([GCS[1]] * 5 + [0, 190])
kinds = st.sampled_from([0] * 5 + [1, 2])
modes = st.sampled_from([AUTO, LOITER, RTL, 4 << 16 | 4 << 24, 3 << 24 | 4 << 16]) | st.integers(0, 2**32 - 1)
zero = st.just(0)
MESSAGES = st.one_of(
    built("mission_request", systems, components, numbers, kinds),
    built("mission_request_int", systems, components, numbers, kinds),
    built("mission_ack", systems, components, zero | st.integers(0, 255), kinds),
    built("mission_count", systems, components, numbers, kinds),
    built("mission_item_int", systems, components, numbers, *[zero] * 8, *[st.integers(-9, 9)] * 3, kinds),
    built("mission_current", numbers, numbers, st.integers(0, 6)),
    built("command_ack", st.sampled_from([176, 512]), st.integers(0, 9), zero, zero, systems, components),
    built("heartbeat", st.just(1), st.just(3), st.just(129), modes, st.just(4), st.just(3)),
)
ORDERS = st.sampled_from(
    ["reboot", "restart", "abandon", "yield", "supersede", "no answer", AUTO, LOITER, RTL, MANUAL]
)


def order(link, what, authority):
    task, plane, t_ns = link.task, link.plane, link.t_ns
    match what:
        case "reboot":
            plane.reboot(t_ns)
            authority.note_reboot(t_ns)
            link.up.put(task.restart(t_ns), t_ns)
        case "restart":
            link.up.put(task.resume(t_ns), t_ns)
        case "abandon":
            link.up.put(task.abandon("ordered to", t_ns), t_ns)
        case "yield":
            link.up.put(task.yield_up(t_ns), t_ns)
        case "supersede":
            link.up.put(task.supersede(t_ns), t_ns)
        case "no answer":
            plane.silent = not plane.silent
        case _:
            plane.mode = what


def flown(data, hostile):
    """Run a drawn upload over a bad link to its end."""
    draw = data.draw
    plane = Plane(mode=draw(st.sampled_from([AUTO, AUTO, LOITER])), leg_s=draw(st.floats(1.0, 60.0)))
    plane.load(OLD, current=draw(st.integers(1, OLD_POINTS)))
    authority, clears = authority_in(MODES[plane.mode]), draw(st.integers(0, 5)) == 0
    task = upload_task(
        mission(draw(st.integers(1, 12))),
        HOME,
        Encoder(),
        kind=Recorded,
        authority=authority,
        policy=OfPlane(plane),
        current=plane.current,
        old=draw(st.sampled_from([OLD, None])),
        inconsistent=clears,
    )
    plane.mean(task.items)
    task.stores = (lambda: None) if hostile else plane.mixed
    seed = draw(st.integers(0, 999))
    bad = {
        "loss": draw(st.floats(0.0, 0.7)),
        "doubles": draw(st.floats(0.0, 0.4)),
        "delay_s": (0.005, draw(st.floats(0.02, 0.6))),
    }
    link = Joined(task, plane, Channel(seed, **bad), Channel(seed + 1, **bad))
    orders = draw(st.dictionaries(st.integers(0, 120), ORDERS, max_size=3))
    forged = draw(st.dictionaries(st.integers(0, 120), MESSAGES, max_size=12)) if hostile else {}
    link.up.put(task.start_clearing(0) if clears else task.start(0), 0)
    for step in range(14_000):
        if task.result is not None:
            break
        link.step()
        if step in orders:
            order(link, orders[step], authority)
        if step in forged:
            link.up.put(task.receive(said(forged[step]), link.t_ns), link.t_ns)
    task.check()
    return task, plane


@settings(max_examples=60, derandomize=True)
@given(data=st.data())
def test_every_end_names_what_the_vehicle_stores(data):
    """Messages are lost, late and doubled; pilots, reboots and operators interfere."""
    task, plane = flown(data, hostile=False)
    assert task.result is not None
    whole = {
        OnboardState.EQUAL: plane.holds(task.items),
        OnboardState.OLD: plane.holds(OLD),
        OnboardState.WHOLE: plane.holds(task.items) or plane.holds(OLD),
        OnboardState.CLEARED: plane.store == [],
        OnboardState.UNKNOWN: True,
    }
    assert whole[task.result.onboard], (task.result, len(plane.store))
    assert task.is_inconsistent or not plane.mixed()


@settings(max_examples=40, derandomize=True)
@given(data=st.data())
def test_forged_messages_of_the_vehicle_cause_no_other_transition(data):
    task, _ = flown(data, hostile=True)
    assert task.result is not None


@settings(max_examples=150, derandomize=True)
@given(
    st.sampled_from([ARDUPLANE, PX4]),
    st.sampled_from(["", "AUTO", "LOITER", "MANUAL"]),
    st.lists(st.tuples(st.floats(0.0, 30.0), MESSAGES | st.integers(0, 6)), max_size=60),
)
def test_messages_in_any_order_cause_no_other_transition(profile, mode, steps):
    task = upload_task(
        mission(3), HOME, Encoder(), kind=Recorded, profile=profile, authority=authority_in(mode)
    )
    t_ns, calls = 0, Counter()
    task.start(0)
    for wait_s, what in steps:
        t_ns += round(wait_s * S)
        had_ended = task.result is not None
        match what:
            case 0:
                frames = task.restart(t_ns)
            case 1:
                frames = task.abandon("ordered to", t_ns)
            case int() if what < 5:
                frames = []
            case 5:
                frames = [f for m in task.items for f in task.receive(said(m.message(0, *GCS)), t_ns)]
            case 6:
                frames = task.resume(t_ns)
            case _:
                frames = task.receive(said(what), t_ns)
        frames += task.poll(t_ns)
        calls[what if isinstance(what, int) else -1] += 1
        assert not (had_ended and frames)
        task.check()


# ---------------------------------------------------------------- the table itself

STAGES_OF_LISTS = {Stage.NEW, Stage.UPLOAD, Stage.VERIFY, Stage.CLEAR, Stage.DONE}
RUNNING = [stage for stage in Stage if stage not in (Stage.NEW, Stage.DONE)]
TABLES = pytest.mark.parametrize(
    ("table", "stages"), [(MISSION_RULES.table, set(Stage)), (LIST_RULES.table, STAGES_OF_LISTS)]
)


def leading_to(target):
    """Return the rules of missions that lead to a stage or choice, as (source, event, name of the guard)."""
    return {
        (source, event, rule.guard and rule.guard.__name__)
        for (source, event), rules in MISSION_RULES.table.items()
        for rule in rules
        if rule.target is target
    }


@TABLES
def test_every_stage_has_a_rule_for_every_event_and_every_choice_one_that_always_holds(table, stages):
    choices = {(rule.target, None) for rows in table.values() for rule in rows if rule.target in list(Choice)}
    assert {(stage, event) for stage in stages for event in Event} | choices == set(table)
    for rows in table.values():
        assert [rule.guard is None for rule in rows] == [False] * (len(rows) - 1) + [True]


@TABLES
def test_every_stage_is_reached_and_every_reason_can_be_told(table, stages):
    rules = [rule for rows in table.values() for rule in rows]
    assert {rule.target for rule in rules} - set(Choice) == stages - {Stage.NEW} | {None}
    task = upload_task(mission(3), HOME, Encoder())
    for rule in rules:
        assert "{" not in task.reason_of(rule.why)


def test_names_in_the_table_are_those_of_the_stages_choices_and_events():
    for member in (*Stage, *Choice, *Event):
        assert getattr(upload_rules, member.name) is member


def ends(stage, event):
    """Whether an event always leads out of a stage, or into its next attempt."""
    return all(rule.target is not None for rule in MISSION_RULES.table[stage, event])


def test_every_stage_that_waits_has_a_bound():
    """`diagnose` ends by its guard in time; every other one when the tries of its request are used up."""
    for stage in RUNNING:
        assert ends(stage, Event.UNANSWERED) or stage is Stage.DIAGNOSE
        *early, last = MISSION_RULES.table[stage, Event.OVERRIDE]
        assert last.target is Choice.OVERRIDDEN
        assert {rule.guard for rule in early} <= {when.may_be_rejection, when.may_still_be_rejection}
    assert ends(Stage.DIAGNOSE, Event.TICK)
    for stage in (Stage.UPLOAD, Stage.VERIFY):
        assert ends(stage, Event.OVERTIME)
        assert ends(stage, Event.STALLED)
    assert ends(Stage.UPLOAD, Event.OVERDUE)
    assert ends(Stage.UPLOAD, Event.FAILED)


def test_auto_follows_only_on_a_mission_that_was_read_back_or_on_the_old_one():
    assert {source for source, _, _ in leading_to(Stage.MODE)} == {Choice.ACTIVATE}
    assert leading_to(Choice.ACTIVATE) == {
        (Stage.SELECT, Event.MISSION_CURRENT, "is_selected"),
        (Choice.RESUME, None, "may_resume"),  # the old mission
    }
    assert leading_to(Stage.SELECT) == {
        (Choice.COMPARE, None, "is_equal"),
        (Stage.PARK, Event.HEARTBEAT, "is_verified"),
    }


def test_an_inconsistent_mission_is_removed_before_the_end_unless_the_vehicle_is_anothers():
    """From a transfer the end comes only by way of `remove`, or because others command the vehicle."""
    outward = {
        (rule.event, rule.guard and rule.guard.__name__)
        for stage in (Stage.UPLOAD, Stage.VERIFY)
        for event in Event
        for rule in MISSION_RULES.table[stage, event]
        if rule.target in (Stage.DONE, Choice.OVERRIDDEN)
    }
    assert outward == {
        (Event.STOP, None),
        (Event.ABANDON, "is_whole"),
        (Event.YIELD, None),  # where it may be inconsistent, it is removed
        (Event.OVERRIDE, None),
    }
    for stage in (Stage.UPLOAD, Stage.VERIFY):
        first = MISSION_RULES.table[stage, Event.YIELD][0]
        assert (first.guard, first.target) == (when.must_be_removed, Choice.REMOVE)
    assert leading_to(Choice.RESUME) == {
        (Choice.REMOVE, None, "is_whole"),
        (Choice.COMPARE, None, "is_old_at_last"),
    }
    assert {rule.target for rule in MISSION_RULES.table[Choice.REMOVE, None]} == {
        Choice.RESUME,
        Stage.CLEAR,
        Stage.HOLD,
    }
    for stage in (Stage.UPLOAD, Stage.VERIFY, Stage.SELECT, Stage.CLEAR):  # before the next item: LOITER
        assert MISSION_RULES.table[stage, Event.IN_AUTO][0].guard in (when.is_loiter_due, when.would_jump)


def test_an_override_leads_to_the_end_and_to_nothing_that_steers():
    """What PX4's `diagnose` asks for is MISSION_CURRENT; it goes on when the vehicle is ours, or rejects."""
    for stage in RUNNING:
        targets = {rule.target for rule in MISSION_RULES.table[stage, Event.OVERRIDE]}
        assert targets <= {Choice.OVERRIDDEN, Stage.DIAGNOSE, None}
    assert {rule.target for rule in MISSION_RULES.table[Choice.OVERRIDDEN, None]} == {Stage.DONE}
    assert MISSION_RULES.stages[Stage.DIAGNOSE].enter.__name__ == "request_state"
    going_on = {
        (event, rule.guard and rule.guard.__name__)
        for event in (Event.HEARTBEAT, Event.MISSION_CURRENT, Event.TICK)
        for rule in MISSION_RULES.table[Stage.DIAGNOSE, event]
        if rule.target not in (None, Choice.OVERRIDDEN)
    }
    assert going_on == {
        (Event.HEARTBEAT, None),
        (Event.TICK, None),
        (Event.MISSION_CURRENT, "has_no_mission"),
    }


def test_the_page_draws_the_table():
    page = (Path(__file__).parents[3] / "docs" / "missions.md").read_text(encoding="utf-8")
    drawn = [block.strip().splitlines() for block in page.split("```mermaid\n")[1:]]
    for lines, rules in zip(drawn, (MISSION_RULES, LIST_RULES), strict=True):
        expected = diagram(rules.table)
        assert lines[: lines.index("```")] == expected, "python tests/helpers/upload_diagram.py"
