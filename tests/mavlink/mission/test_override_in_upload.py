"""A user would lose the aircraft to an upload that goes on after a pilot or a failsafe has turned it home.

A PX4 in RTL follows its mission's landing: with its first item selected again it flew 590 m away from home.
"""

import math

import pytest
from helpers.plane_double import (
    AUTO,
    HOME,
    LOITER,
    RTL,
    Channel,
    Joined,
    OfPlane,
    Plane,
    S,
    authority_in,
    upload_task,
)
from helpers.px4_double import AUTO as PX4_AUTO
from helpers.px4_double import HOLD, Px4
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.geo import LocalFrame
from gcs.mavlink.autopilots import ARDUPLANE, PX4
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.mavlink.mission.upload_stages import OnboardState, Stage
from gcs.model import ControlEvent, Mission, Waypoint
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

PLACE = Home(-35.3632621, 149.165237, 584.09)
STEERS = {
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_SET_CURRENT",
    "MISSION_CLEAR_ALL",
    "MISSION_WRITE_PARTIAL_LIST",
    "SET_MODE",
}
RUNNING = [stage for stage in Stage if stage not in (Stage.NEW, Stage.DONE)]
MAX_AGE_S = 0.3


def mission(points, shift_deg=0.0):
    route = tuple(Waypoint(-35.36 + n * 1e-3 + shift_deg, 149.16, 100.0, 10.0) for n in range(points))
    return Mission(1, 1, route)


def steers(message):
    is_command = message.get_type() == "COMMAND_LONG" and message.command not in (511, 512)
    return is_command or message.get_type() in STEERS


class Tapped(Channel):
    """A channel that remembers what was sent through it, and when."""

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self.sent = []

    def put(self, frames, t_ns):
        self.sent += [(t_ns, message) for frame in frames for message in decode(frame)[0]]
        super().put(frames, t_ns)

    def steering(self, from_ns):
        return [(t_ns / S, str(m)) for t_ns, m in self.sent if t_ns > from_ns and steers(m)]

    def kinds(self, from_ns):
        return [m.get_type() for t_ns, m in self.sent if t_ns > from_ns]


def arduplane(stage):
    """An ArduPlane on its mission, so that its next upload passes through a stage."""
    plane = Plane(mode=AUTO, leg_s=2.0 if stage is Stage.PARK else math.inf, home=HOME)
    plane.load(build_items(ARDUPLANE, mission(6, 0.01), PLACE), current=2)
    return plane, ARDUPLANE, OfPlane(plane)


def px4(stage):
    vehicle = Px4(mode=HOLD if stage is Stage.MODE else PX4_AUTO)  # one in AUTO is not commanded to AUTO
    if stage is Stage.DIAGNOSE:
        add_item = vehicle._on_mission_item_int

        def hold_at_the_end(message, sender):
            answers = add_item(message, sender)
            vehicle.mode = HOLD if vehicle.uploads else vehicle.mode
            return answers

        vehicle._on_mission_item_int = hold_at_the_end
    old = build_items(PX4, mission(6, 0.01), PLACE)
    vehicle.store, vehicle.valid = [item.message(seq, 1, 1) for seq, item in enumerate(old)], True
    return vehicle, PX4, None


def upload(vehicle, profile, policy, loss=0.0, seed=1):
    task = upload_task(
        mission(8), PLACE, Encoder(), profile=profile, policy=policy, current=2,
        authority=authority_in("LOITER" if vehicle.mode == HOLD else "AUTO"),
        old=build_items(profile, mission(6, 0.01), PLACE),
    )  # fmt: skip
    way = {"loss": loss, "delay_s": (0.01, 0.03)}
    return Joined(task, vehicle, Tapped(2 * seed, **way), Tapped(2 * seed + 1, **way))


def in_stage(make, stage, **way):
    """An upload that has just come into a stage; None where the firmware needs no such stage."""
    link = upload(*make(stage), **way)
    link.plane.silent = False
    if stage in (Stage.HOLD, Stage.CLEAR):
        link.task.state.verification.is_rejected = True
        link.up.put(link.task.start_clearing(0), 0)
    else:
        link.up.put(link.task.start(0), 0)
    for _ in range(600):
        if link.task.stage is stage:
            return link
        if link.task.result is not None:
            return None
        link.step(0.02)
    return None


def ours(stage):
    """Modes that are ours at a stage: AUTO, and LOITER while it is commanded, waited in, or unexplained."""
    waits = stage in (Stage.PARK, Stage.HOLD, Stage.CLEAR, Stage.MODE, Stage.DIAGNOSE)
    return {"AUTO", "LOITER"} if waits else {"AUTO"}


def custom(profile, numbers):
    return numbers[0] << 16 | numbers[1] << 24 if profile is PX4 else numbers[0]


@pytest.mark.parametrize("stage", RUNNING)
@pytest.mark.parametrize("make", [arduplane, px4])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_nothing_that_steers_is_sent_after_another_mode_was_seen(make, stage, loss):
    """Every stage and every mode of the firmware, seen in a heartbeat."""
    if in_stage(make, stage) is None:
        assert (make, stage) in [(px4, Stage.PARK), (arduplane, Stage.DIAGNOSE)]  # one's uploads are atomic
        return
    profile = PX4 if make is px4 else ARDUPLANE
    for numbers, name in profile.modes.items():
        if name in ours(stage):
            continue
        links = (in_stage(make, stage, loss=loss, seed=seed) for seed in range(1, 20))
        link = next(link for link in links if link is not None)  # by chance, it lasts no step
        for way in (link.up, link.down):
            way._queue.clear()  # what is on its way when the mode is chosen cannot know it
        link.plane.mode, chosen_ns, seen_ns = custom(profile, numbers), link.t_ns, None
        while link.task.result is None:
            link.step(0.02)
            if seen_ns is None and link.task.flight.authority.taken_by:
                seen_ns = link.t_ns
            assert link.t_ns < chosen_ns + 30 * S, (stage, name)
        for _ in range(60):
            link.step(0.02)
        ended_ns = chosen_ns + round(MAX_AGE_S * S)  # at the latest, where the upload was over before
        assert link.up.steering(seen_ns or ended_ns) == [], (stage, name)
        assert link.plane.mode == custom(profile, numbers), (stage, name)
        assert seen_ns is None or not link.task.result.ok
        if not loss and seen_ns:  # heartbeats are asked for: it does not take a second
            assert seen_ns - chosen_ns < 0.7 * S, (stage, name)
        what_steers_at_once = {"MISSION_SET_CURRENT", "SET_MODE"}
        late_ns = chosen_ns + round((MAX_AGE_S + 0.07) * S)
        assert not what_steers_at_once & set(link.up.kinds(late_ns)), (stage, name)


@pytest.mark.parametrize("stage", RUNNING)
@pytest.mark.parametrize("make", [arduplane, px4])
def test_nothing_that_steers_is_sent_after_another_station_commanded_a_mode(make, stage):
    """Its heartbeat shows the mode up to a second later."""
    link = in_stage(make, stage)
    if link is None:
        return
    link.task.flight.authority.note_foreign_command("system 254/190", link.t_ns)
    commanded_ns = link.t_ns
    for _ in range(50):
        link.step(0.02)
    assert link.up.steering(commanded_ns) == []
    if stage is Stage.DIAGNOSE:  # another mode was seen before
        return
    assert not link.task.result.ok
    assert "system 254/190 commands a mode" in link.task.result.detail


LEFT = {
    arduplane: {Stage.PARK: "old", Stage.MODE: "new"},
    px4: dict.fromkeys((Stage.SELECT, Stage.MODE), "new") | {Stage.UPLOAD: "old", Stage.DIAGNOSE: "new"},
}
"""What a vehicle keeps when its upload yields; nothing in other stages."""


@pytest.mark.parametrize("stage", RUNNING)
@pytest.mark.parametrize("make", [arduplane, px4])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_an_upload_yields_to_another_service_and_no_inconsistent_mission_is_left_in_auto(make, stage, loss):
    """It went on to the end: the vehicle flew the new mission while the alarm said that it is not tasked."""
    links = (in_stage(make, stage, loss=loss, seed=seed) for seed in range(1, 4 if loss else 2))
    for link in filter(None, links):
        task, vehicle = link.task, link.plane
        while stage is Stage.UPLOAD and task.state.transfer.sending.sent_count < 3:
            link.step(0.02)
        if make is arduplane:
            vehicle.mean(task.items)
            vehicle.leg_s = (link.t_ns - vehicle._leg_t_ns) / S + 6.0  # it takes its next item soon
        t_ns = link.t_ns
        link.up.put(task.yield_up(t_ns), t_ns)
        result = link.run(60.0, extra_s=10.0)
        assert result is not None
        assert not result.ok
        kept = LEFT[make].get(stage, "none")
        old, new = len(build_items(PX4, mission(6, 0.01), PLACE)), len(build_items(PX4, mission(8), PLACE))
        home = int(make is arduplane)
        assert len(vehicle.store) == {"old": old + home, "new": new + home, "none": 0}[kept]
        assert set(link.up.kinds(t_ns)) & STEERS <= {"MISSION_CLEAR_ALL"}
        modes = [m for sent_ns, m in link.up.sent if sent_ns > t_ns and steers(m)]
        assert all(m.get_type() == "MISSION_CLEAR_ALL" or commands_loiter(m, make) for m in modes), modes
        if kept != "none":
            assert modes == []
        if make is arduplane:
            assert vehicle.mixed_legs == []


def commands_loiter(message, make):
    numbers = (LOITER, 0.0) if make is arduplane else (4, 3)
    return message.get_type() == "COMMAND_LONG" and (message.param2, message.param3) == numbers


def test_a_px4_that_mixes_the_missions_of_two_services_does_not_fly_them():
    """Both have one id: it counts the items of the first, and takes those of both."""
    link = in_stage(px4, Stage.VERIFY)
    link.plane.store[3:5] = [item.message(3, 1, 1) for item in build_items(PX4, mission(2, 0.02), PLACE)]
    link.up.put(link.task.yield_up(link.t_ns), link.t_ns)
    result = link.run()
    assert (result.onboard, link.plane.store) == (OnboardState.CLEARED, [])
    assert link.plane.mode == HOLD


@pytest.mark.parametrize("stage", [Stage.UPLOAD, Stage.VERIFY, Stage.SELECT, Stage.MODE])
def test_a_px4_is_told_that_the_upload_ends_and_keeps_its_whole_mission(stage):
    link = in_stage(px4, stage)
    before = list(link.plane.store)
    link.plane.mode, t_ns = PX4_RTL, link.t_ns
    result = link.run()
    assert result.onboard is (OnboardState.EQUAL if stage in (Stage.SELECT, Stage.MODE) else result.onboard)
    assert not link.task.is_inconsistent
    if stage is Stage.UPLOAD:
        assert (result.onboard, link.plane.store) == (OnboardState.OLD, before)
        assert "RTL was chosen meanwhile: its upload is stopped, and it keeps its mission" in result.detail
    acks = [m.type for sent_ns, m in link.up.sent if sent_ns > t_ns and m.get_type() == "MISSION_ACK"]
    assert acks == ([15] if stage in (Stage.UPLOAD, Stage.VERIFY) else [])


@pytest.mark.parametrize("at_item", range(8))
def test_an_rtl_between_two_heartbeats_is_seen_before_a_px4_gets_the_last_item(at_item):
    """It was ordered 0.7 s before a heartbeat showed it; meanwhile all was sent, and selected eight times."""
    link = upload(*px4(None))
    beat = link.plane._heartbeat
    link.up.put(link.task.start(0), 0)
    while link.task.state.transfer.sending.sent_count < at_item:
        link.step(0.02)
    before = list(link.plane.store)
    link.plane._beat_t_ns = link.t_ns  # the next heartbeat comes by itself in a second
    link.plane.mode = PX4_RTL
    assert beat().custom_mode == PX4_RTL
    result = link.run()
    assert (result.ok, link.plane.store, link.plane.mode) == (False, before, PX4_RTL)
    assert "MISSION_SET_CURRENT" not in link.up.kinds(0)


PX4_RTL = 4 << 16 | 5 << 24


def test_an_arduplane_left_with_an_inconsistent_mission_is_named():
    link = in_stage(arduplane, Stage.UPLOAD)
    while link.task.state.transfer.sending.sent_count < 4:
        link.step(0.02)
    link.plane.mode = RTL
    result = link.run()
    assert link.task.is_inconsistent
    assert "RTL was chosen meanwhile: its onboard mission may be inconsistent" in result.detail
    assert "do not choose AUTO" in result.detail


def test_an_arduplane_left_before_the_selection_is_named():
    """AUTO would continue the new mission at the number of the old one's item."""
    link = in_stage(arduplane, Stage.SELECT)
    link.plane.ignores = {"MISSION_SET_CURRENT"}
    link.plane.mode = RTL
    result = link.run()
    assert (result.onboard, result.selected) == (OnboardState.EQUAL, False)
    assert "its first item not selected; do not choose AUTO" in result.detail


def test_a_hold_before_a_failsafe_is_not_taken_for_a_rejected_mission():
    """A fence failsafe after a re-task was answered with a clearing and another upload."""
    for stage in (Stage.VERIFY, Stage.SELECT):
        link = in_stage(px4, stage)
        link.plane.valid, link.plane.mode, link.plane.status = False, HOLD, 5
        t_ns = link.t_ns
        result = link.run()
        assert "LOITER was chosen meanwhile" in result.detail
        assert link.task.flight.authority.override == "LOITER"
        seen_ns = t_ns + round(0.7 * S)
        assert link.up.steering(seen_ns) == []
        assert link.plane.store


def test_a_hold_at_the_number_of_a_new_missions_end_is_an_operators():
    """It may be the number of an item of the old mission: the vehicle was commanded back to AUTO."""
    link = in_stage(px4, Stage.VERIFY)
    link.plane.current = len(link.task.items) - 1
    link.run(0.05)
    link.plane._on_mission_request_int = lambda message, sender: []
    link.run(1.0)
    link.plane.choose(HOLD)
    assert not link.run().ok
    assert link.task.flight.authority.override == "LOITER"
    assert link.plane.mode == HOLD


def test_a_mission_that_was_read_back_before_a_reboot_is_not_known_after_it():
    """It counted as stored, although the vehicle had lost it."""
    link = in_stage(px4, Stage.SELECT)
    link.plane.store, link.plane.mode = [], 1 << 16  # it boots into MANUAL
    link.up.put(link.task.restart(link.t_ns), link.t_ns)
    result = link.run()
    assert "MANUAL was chosen meanwhile" in result.detail
    assert result.onboard is not OnboardState.EQUAL


SIMULATED = [Mode.MANUAL, Mode.FBWA, Mode.CRUISE, Mode.RTL, Mode.TAKEOFF, Mode.GUIDED, Mode.LOITER]


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@settings(max_examples=25, derandomize=True)
@given(
    mode=st.sampled_from(SIMULATED),
    at_s=st.floats(0.0, 2.0),
    loss=st.floats(0.0, 0.4),
    seed=st.integers(0, 999),
)
def test_simulated_firmware_keeps_the_mode_that_was_chosen_at_any_time(autopilot, mode, at_s, loss, seed):
    spec = VehicleSpec(1, 0.0, 0.0, 0.0, 100.0, 15.0, autopilot=autopilot)
    vehicle = SimVehicle(spec, LocalFrame(*PLACE), 0)
    profile = {"ardupilot": ARDUPLANE, "px4": PX4}[autopilot]
    authority = authority_in("LOITER")
    authority.note_command("AUTO")  # it was in AUTO before: LOITER is no longer the first mode
    task = upload_task(mission(10), PLACE, Encoder(), profile=profile, authority=authority)
    way = {"loss": loss, "delay_s": (0.01, 0.1)}
    up, down = Tapped(2 * seed, **way), Tapped(2 * seed + 1, **way)
    up.put(task.start(0), 0)
    seen_ns = None
    is_ours = {True}
    for step in range(1, 1000):
        t_ns = step * S // 100
        if seen_ns is None and authority.taken_by:
            seen_ns = t_ns
        if t_ns >= at_s * S and is_ours:
            is_ours.clear()
            vehicle.autopilot.set_mode(mode)
        vehicle.advance(t_ns)
        for data in up.get(t_ns):
            vehicle.receive_datagram(data, t_ns)
        down.put(vehicle.datagrams_to_send(t_ns), t_ns)
        for data in down.get(t_ns):
            for message in decode(data)[0]:
                up.put(task.receive(message, t_ns), t_ns)
        if step % 5 == 0:
            up.put(task.poll(t_ns), t_ns)
    if seen_ns is not None:
        assert up.steering(seen_ns) == []
        assert not task.result.ok
    else:  # over before, or commanded right after the mode was chosen
        assert vehicle.autopilot.mode in (Mode.AUTO, Mode.LOITER, mode)


def test_an_end_by_another_station_is_no_claim_for_ever():
    """It may have refused the command: a heartbeat well after it shows AUTO, and it is ours again."""
    authority = authority_in("AUTO")
    authority.note_foreign_command("system 254/190", S)
    authority.observe_heartbeat(heartbeat(AUTO), ARDUPLANE, 2 * S, at_end=False)
    assert authority.taken_by
    authority.observe_heartbeat(heartbeat(AUTO), ARDUPLANE, 4 * S, at_end=False)
    assert not authority.taken_by
    authority.note_foreign_command("system 254/190", 5 * S)
    authority.claims.apply(ControlEvent.RESUME, 6 * S)
    assert not authority.taken_by


def heartbeat(mode):
    return dialect.MAVLink_heartbeat_message(1, 3, 129, mode, dialect.MAV_STATE_ACTIVE, 3)


def test_a_loiter_that_another_station_commands_while_we_hold_is_not_ours():
    authority = authority_in("AUTO")
    authority.note_command("LOITER")
    authority.observe_heartbeat(heartbeat(LOITER), ARDUPLANE, S, at_end=False)
    assert not authority.taken_by
    authority.note_foreign_command("system 254/190", 2 * S)
    authority.observe_heartbeat(heartbeat(LOITER), ARDUPLANE, 5 * S, at_end=False)
    assert authority.override == "LOITER"
