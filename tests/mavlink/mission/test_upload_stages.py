"""A user would lose the aircraft to an order of messages that no engineer thought of."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plane_double import (
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
    authority_in,
    upload_task,
)
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import ARDUPLANE, PX4
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.mavlink.mission.upload_stages import TRANSITIONS, OnboardState, Stage, TransitionError
from gcs.mavlink.mission.upload_task import UploadTask
from gcs.model import Mission, Waypoint

HOME = Home(-35.3632621, 149.165237, 584.09)
MODES = {AUTO: "AUTO", LOITER: "LOITER", RTL: "RTL", MANUAL: "MANUAL"}
OLD_POINTS = 8


def mission(points, shift_deg=0.0):
    places = [(-35.36 + n * 1e-3 + shift_deg, 149.16) for n in range(points)]
    return Mission(1, 1, tuple(Waypoint(*place, 100.0, 10.0) for place in places))


OLD = build_items(ARDUPLANE, mission(OLD_POINTS, 0.01), HOME)


class Recorded(UploadTask):
    """A task whose transitions are recorded."""

    def __init__(self, *args, **options):
        self.recorded = [(Stage.NEW, Stage.NEW)]
        super().__init__(*args, **options)

    def _set_stage(self, stage):
        before = self.stage
        super()._set_stage(stage)
        self.recorded.append((before, stage))

    def check(self):
        """No stage was entered but through the table, and the result agrees with itself."""
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
    ["reboot", "restart", "abandon", "supersede", "no answer", AUTO, LOITER, RTL, MANUAL]
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


def test_a_transition_that_the_table_lacks_is_an_error():
    for before in Stage:
        for after in set(Stage) - TRANSITIONS[before]:
            task = upload_task(mission(3), HOME, Encoder(), kind=Recorded)
            task.state.stage = before
            with pytest.raises(TransitionError, match=f"{before} to {after}"):
                task._enter_stage(after, 0)
            assert task.stage is before


def test_every_stage_can_be_superseded_and_every_stage_is_reached():
    assert all(Stage.DONE in TRANSITIONS[stage] for stage in set(Stage) - {Stage.DONE})
    assert {after for following in TRANSITIONS.values() for after in following} == set(Stage) - {Stage.NEW}


def test_the_page_shows_the_table():
    page = (Path(__file__).parents[3] / "docs" / "missions.md").read_text(encoding="utf-8")
    rows = [line.split() for line in page.split("```")[1].splitlines() if line]
    shown = {Stage(first): {Stage(stage) for stage in following} | {Stage.DONE} for first, *following in rows}
    assert shown | {Stage.DONE: set()} == TRANSITIONS
