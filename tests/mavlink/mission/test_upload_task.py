"""A user would lose the aircraft to half a mission, or to a task that says yes when it should say no."""

import math

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
    authority_in,
    upload_task,
)
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import ARDUPLANE
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.mavlink.mission.upload_limits import UploadLimits
from gcs.model import Mission, Waypoint

MODE_NAMES = {AUTO: "AUTO", LOITER: "LOITER", RTL: "RTL"}
HOME = Home(-35.3632621, 149.165237, 584.09)


def mission(points=4, shift_deg=0.0, mission_id=1):
    route = tuple(
        Waypoint(-35.36 + n * 1e-3 + shift_deg, 149.16 + n * 1e-3, 100.0, 10.0) for n in range(points)
    )
    return Mission(mission_id, 1, route)


def flying(points=6, leg_s=math.inf, mode=AUTO):
    """A plane that flies an older mission; and that mission's items."""
    plane = Plane(mode=mode, leg_s=leg_s)
    old = build_items(ARDUPLANE, mission(points, 0.01), HOME)
    plane.load(old, current=2)
    return plane, old


def joined(plane, points=4, *, seed=1, loss=0.0, doubles=0.0, delay_s=(0.005, 0.03), **options):
    known = {
        "authority": authority_in(MODE_NAMES[plane.mode]),
        "policy": OfPlane(plane),
        "current": plane.current,
    }
    task = upload_task(mission(points), HOME, Encoder(), **(known | options))
    plane.mean(task.items)
    both = {"loss": loss, "doubles": doubles, "delay_s": delay_s}
    return Joined(task, plane, Channel(2 * seed, **both), Channel(2 * seed + 1, **both))


def said(sender, message):
    return decode(Encoder(*sender)(message))[0][0]


# ---------------------------------------------------------------- the plain way


def test_a_mission_is_uploaded_read_back_selected_and_flown():
    plane, _ = flying()
    link = joined(plane)
    result = link.run()
    assert result.ok
    assert (result.onboard, result.retries, result.was_held) == ("equal", 0, False)
    assert plane.holds(link.task.items)
    assert (plane.mode, plane.current) == (AUTO, 1)
    assert plane.cached == plane.store[1]
    assert link.task.report().ok


def test_it_never_arms():
    plane = Plane(armed=False)
    assert joined(plane).run().ok
    assert dialect.MAV_CMD_COMPONENT_ARM_DISARM not in plane.commands
    assert not plane.armed


def test_a_plane_that_already_flies_its_first_item_restarts_at_the_new_one():
    """MISSION_CURRENT says 1 before and after: the vehicle repeats the 0 that selects its first item."""
    for seed in range(8):
        plane, old = flying()
        plane.load(old, current=1)
        link = joined(plane, seed=seed, loss=0.3)
        assert link.run().ok
        assert plane.cached == plane.store[1]
        assert plane.leg_starts_here


@pytest.mark.parametrize("current", [1, 2])
def test_the_first_leg_starts_where_the_plane_is(current):
    """ArduPlane flew 300 to 1349 m off, along the line from the waypoint of the mission before."""
    plane, old = flying()
    plane.load(old, current=current)
    link = joined(plane)
    assert link.run().ok
    assert (plane.current, plane.leg_starts_here) == (1, True)
    assert dialect.MAV_CMD_DO_SET_MISSION_CURRENT not in plane.commands


def test_a_plane_that_flew_nothing_yet_is_selected_all_the_same():
    """It says 0 by itself then, which is no answer to a selection."""
    plane, _ = flying()
    plane.load(build_items(ARDUPLANE, mission(4, 0.01), HOME), current=1)
    plane.current, plane.mode, plane.cached = 0, LOITER, None
    plane.ignores = {"MISSION_SET_CURRENT"}
    link = joined(plane)
    link.each_step = lambda now: setattr(plane, "ignores", set() if now.t_ns > 3 * S else plane.ignores)
    assert link.run().ok
    assert plane.cached == plane.store[1]


# ---------------------------------------------------------------- loss


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
def test_thirty_items_arrive_whole_over_a_bad_radio(loss):
    for seed in range(4):
        plane, _ = flying(leg_s=40.0)
        link = joined(plane, 28, seed=seed, loss=loss, doubles=0.1, delay_s=(0.01, 0.25))
        result = link.run()
        assert result.ok, (seed, result)
        assert plane.holds(link.task.items)
        assert plane.mode == AUTO


@pytest.mark.slow
def test_a_hundred_of_a_hundred_uploads_of_thirty_items_at_30_percent_loss_each_way():
    for seed in range(100):
        plane, _ = flying(leg_s=40.0)
        link = joined(plane, 28, seed=1000 + seed, loss=0.3, doubles=0.05, delay_s=(0.01, 0.1))
        result = link.run(600)
        assert result.ok, (seed, result)
        assert plane.holds(link.task.items)


@pytest.mark.parametrize("seed", range(6))
def test_at_half_loss_it_is_equal_or_reported_and_no_inconsistent_mission_is_flown(seed):
    plane, old = flying(leg_s=20.0)
    link = joined(plane, 28, seed=seed, loss=0.5, doubles=0.1, delay_s=(0.01, 0.3), old=old)
    result = link.run(1000)
    assert result is not None
    assert result.ok == (result.onboard == "equal")
    legs_before = len(plane.mixed_legs)
    if result.ok:
        assert plane.holds(link.task.items)
    else:
        assert result.detail
        assert not (plane.mixed() and plane.mode == AUTO)
        assert result.onboard != "cleared" or plane.store == []
    for _ in range(1200):
        link.step()
    assert len(plane.mixed_legs) == legs_before


@pytest.mark.parametrize("name", ["MISSION_ACK", "MISSION_COUNT", "COMMAND_ACK"])
def test_one_kind_of_answer_that_never_comes_does_not_hide_the_truth(name):
    """Lost final ACK: the read-back decides. Nothing to read back: never reported as equal."""
    plane, _ = flying()
    link = joined(plane)
    receive = link.task.receive
    link.task.receive = lambda message, t_ns: [] if message.get_type() == name else receive(message, t_ns)
    result = link.run(900)
    if name == "MISSION_COUNT":
        assert not result.ok
        assert plane.mode == LOITER
    else:
        assert result.ok
        assert plane.holds(link.task.items)


# ---------------------------------------------------------------- vehicles that refuse, lie or vanish


def test_a_refused_item_ends_in_loiter_with_nothing_stored_and_a_reason():
    plane, _ = flying()
    plane.accepts = lambda seq: 3 if seq == 2 else 0
    result = joined(plane, limits=UploadLimits(max_uploads=2)).run()
    assert (result.ok, result.onboard, result.was_held) == (False, "cleared", True)
    assert "UNSUPPORTED" in result.detail
    assert (plane.mode, plane.store) == (LOITER, [])


def test_one_failure_ack_in_mid_transfer_is_not_the_end():
    plane, _ = flying()
    link = joined(plane)
    failed = []

    def fail_once(seq):
        if seq == 3 and not failed:
            failed.append(seq)
            return 1
        return 0

    plane.accepts = fail_once
    result = link.run()
    assert failed
    assert result.ok
    assert result.retries >= 1


def test_a_store_that_reads_back_differently_is_repaired_or_cleared():
    plane, _ = flying()
    store = plane._on_mission_item_int

    def damages(message, sender, t_ns):
        if message.seq == 2:
            message.x += 5
        return store(message, sender, t_ns)

    plane._on_mission_item_int = damages
    result = joined(plane, limits=UploadLimits(max_uploads=3)).run()
    assert not result.ok
    assert "read-back differs: item 2: x" in result.detail
    assert plane.store == []


def test_a_vehicle_that_keeps_its_old_mission_on_failure_keeps_flying_it():
    plane, old = flying()

    def refuses(message, sender, t_ns):
        return [dialect.MAVLink_mission_ack_message(*sender, dialect.MAV_MISSION_DENIED, 0)]

    plane._on_mission_count = refuses
    result = joined(plane, limits=UploadLimits(max_uploads=2), old=old).run()
    assert (result.ok, result.onboard, result.was_held) == (False, "old", False)
    assert plane.mode == AUTO
    assert plane.holds(old)


def test_a_lost_vehicle_is_reported_within_bounds():
    plane, _ = flying()
    plane.silent = True
    result = joined(plane).run(300)
    assert (result.ok, result.onboard) == (False, "old")
    assert "no heartbeat" in result.detail
    assert plane.requests == []


@pytest.mark.parametrize("at_s", [0.05, 0.2, 0.4, 0.7])
def test_a_reboot_into_a_pilots_mode_in_mid_transfer_ends_it(at_s):
    plane, _ = flying()
    authority = authority_in("AUTO")
    link = joined(plane, 10, authority=authority)
    rebooted = []

    def reboot(now):
        if now.t_ns >= at_s * S and not rebooted:
            rebooted.append(now.t_ns)
            plane.reboot(now.t_ns)
            authority.note_reboot(0)
            now.up.put(now.task.restart(now.t_ns), now.t_ns)

    link.each_step = reboot
    result = link.run()
    assert rebooted
    assert (result.ok, plane.mode) == (False, MANUAL)
    assert "MANUAL was chosen" in result.detail
    assert link.task.is_inconsistent or not plane.mixed()


@pytest.mark.parametrize("at_s", [0.2, 0.3, 0.4, 0.7])
def test_a_reboot_in_mid_transfer_starts_it_again(at_s):
    plane, _ = flying()
    authority = authority_in("AUTO")
    link = joined(plane, 10, authority=authority)
    rebooted = []

    def reboot(now):
        if now.t_ns >= at_s * S and not rebooted:
            rebooted.append(now.t_ns)
            plane.reboot(now.t_ns)
            plane.mode = LOITER
            authority.note_reboot(0)
            now.up.put(now.task.restart(now.t_ns), now.t_ns)

    link.each_step = reboot
    assert link.run().ok
    assert rebooted
    assert plane.holds(link.task.items)


def test_a_plane_that_reaches_its_waypoint_in_mid_transfer_is_held_then_sent_on():
    plane, _ = flying(leg_s=4.0)
    link = joined(plane, 12)
    request = plane._on_mission_item_int
    link.each_step = lambda now: setattr(now.up, "loss", 1.0 if 0.2 * S < now.t_ns < 6.0 * S else 0.0)
    result = link.run()
    assert request
    assert result.ok
    assert result.was_held
    assert plane.mode == AUTO
    assert plane.mixed_legs == [] or plane.mixed_legs[-1] < 9 * S


def test_a_task_that_is_abandoned_midway_leaves_no_inconsistent_mission():
    plane, _ = flying(leg_s=5.0)
    link = joined(plane, 20)
    for _ in range(8):
        if link.task.stage == "new":
            link.up.put(link.task.start(0), 0)
        link.step()
    assert plane.mixed()
    link.up.put(link.task.abandon("ordered to", link.t_ns), link.t_ns)
    result = link.run(extra_s=60.0)
    assert (result.ok, result.onboard, result.detail) == (False, "cleared", "ordered to")
    assert plane.store == []
    assert plane.mode in (LOITER, RTL)


# ---------------------------------------------------------------- others on the link, and ourselves before


@pytest.mark.parametrize("seed", range(5))
def test_a_superseding_mission_wins_over_the_leftovers_of_the_old_transfer(seed):
    plane, _ = flying()
    link = joined(plane, 20, seed=seed, doubles=0.3, delay_s=(0.01, 0.6))
    link.up.put(link.task.start(0), 0)
    for _ in range(10 + 7 * seed):
        link.step()
    first = link.task
    first.supersede(link.t_ns)
    assert (first.result.ok, first.result.detail) == (False, "superseded")
    link.task = upload_task(mission(9, shift_deg=-0.02, mission_id=2), HOME, Encoder())
    plane.mean(link.task.items)
    assert link.run().ok
    assert plane.holds(link.task.items)


def test_another_stations_messages_change_nothing():
    """Its REQUEST and ACK on the same link, addressed to it, and those of other vehicles to us."""
    other = (254, 190)
    noise = [
        ((1, 1), dialect.MAVLink_mission_request_message(*other, 3, 0)),
        ((1, 1), dialect.MAVLink_mission_ack_message(*other, 1, 0)),
        ((1, 1), dialect.MAVLink_mission_ack_message(*other, 0, 0)),
        ((1, 1), dialect.MAVLink_mission_count_message(*other, 3, 0)),
        ((1, 1), dialect.MAVLink_mission_request_message(*GCS, 0, 1)),
        ((1, 1), dialect.MAVLink_mission_ack_message(*GCS, 2, 2)),
        ((2, 1), dialect.MAVLink_mission_request_message(*GCS, 2, 0)),
        ((2, 1), dialect.MAVLink_mission_ack_message(*GCS, 1, 0)),
        ((1, 100), dialect.MAVLink_mission_ack_message(*GCS, 1, 0)),
        ((254, 190), dialect.MAVLink_mission_ack_message(*GCS, 15, 0)),
    ]
    plane, _ = flying()
    link = joined(plane, 10)

    def disturb(now):
        for sender, message in noise:
            assert now.task.receive(said(sender, message), now.t_ns) == []

    link.each_step = disturb
    result = link.run()
    assert result.ok
    assert result.retries == 0


def test_another_station_in_the_middle_of_its_own_upload_is_waited_for():
    plane, _ = flying()
    plane.receive(Encoder(254, 190)(dialect.MAVLink_mission_count_message(1, 1, 5, 0)), 0)
    link = joined(plane)
    assert link.run().ok
    assert plane.holds(link.task.items)


def test_a_request_that_runs_ahead_is_not_answered():
    task = upload_task(mission(6), HOME, Encoder(), authority=authority_in("LOITER"))
    task.start(0)
    beat = dialect.MAVLink_heartbeat_message(1, 3, 129, LOITER, 4, 3)
    assert [decode(f)[0][0].get_type() for f in task.receive(said((1, 1), beat), 1)] == ["MISSION_COUNT"]
    assert task.receive(said((1, 1), dialect.MAVLink_mission_request_message(*GCS, 4, 0)), 1) == []
    answered = task.receive(said((1, 1), dialect.MAVLink_mission_request_message(*GCS, 0, 0)), 2)
    again = task.receive(said((1, 1), dialect.MAVLink_mission_request_int_message(*GCS, 0, 0)), 3)
    assert [decode(f)[0][0].seq for f in answered + again] == [0, 0]


def test_nothing_is_ever_sent_without_a_target():
    plane, _ = flying()
    link = joined(plane)
    put, sent = link.up.put, []
    link.up.put = lambda frames, t_ns: (sent.extend(frames), put(frames, t_ns))
    assert link.run().ok
    messages = [decode(frame)[0][0] for frame in sent]
    assert {(m.target_system, m.target_component) for m in messages} == {(1, 1)}
    assert {f.system_id for frame in sent for f in decode(frame)[1].frames} == {255}


# ---------------------------------------------------------------- operators, and the next waypoint


def test_a_vehicle_near_its_next_waypoint_waits_before_anything_is_changed():
    plane, _old = flying(leg_s=2.0)
    link = joined(plane, 10)
    stored_while_in_auto = []
    link.each_step = lambda now: stored_while_in_auto.append(plane.mode == AUTO and plane.mixed())
    result = link.run()
    assert result.ok
    assert result.was_held
    assert not any(stored_while_in_auto)


def test_a_vehicle_never_counts_on_into_a_mission_of_which_nothing_was_selected():
    """It would be past the end of a shorter one, and return to launch."""
    plane, old = flying(points=12, leg_s=8.0)
    plane._fly_to(9)
    link = joined(plane, 3, old=old)
    plane.ignores = {"MISSION_SET_CURRENT"}
    modes = set()

    def hear_later(now):
        modes.add(plane.mode)
        plane.ignores = set() if now.t_ns > 20 * S else plane.ignores

    link.each_step = hear_later
    result = link.run()
    assert (result.ok, result.was_held, result.selected) == (True, True, True)
    assert modes == {AUTO, LOITER}
    assert (plane.mode, plane.current) == (AUTO, 1)


def test_a_task_that_is_superseded_before_selection_reports_it():
    plane, old = flying(points=12)
    plane._fly_to(9)
    plane.ignores = {"MISSION_SET_CURRENT"}
    link = joined(plane, 3, old=old)
    link.up.put(link.task.start(0), 0)
    while link.task.stage != "select":
        link.step()
    link.task.supersede(link.t_ns)
    assert (link.task.result.onboard, link.task.result.selected) == ("equal", False)


def test_a_vehicle_that_cannot_wait_keeps_its_mission():
    plane, old = flying(leg_s=2.0)
    plane.ignores.add("COMMAND_LONG")
    result = joined(plane, 10).run()
    assert (result.ok, result.onboard) == (False, "old")
    assert plane.holds(old)


def test_a_vehicle_that_waited_in_vain_goes_on_with_its_old_mission():
    plane, old = flying(leg_s=2.0)
    plane._on_mission_count = lambda _m, sender, _t: [dialect.MAVLink_mission_ack_message(*sender, 14, 0)]
    result = joined(plane, 10, old=old, limits=UploadLimits(max_uploads=2)).run()
    assert (result.ok, result.onboard, result.was_held) == (False, "old", False)
    assert plane.holds(old)
    assert plane.mode == AUTO


@pytest.mark.parametrize("loss", [0.2, 0.3])
def test_no_inconsistent_mission_is_flown_over_a_bad_radio(loss):
    for seed in range(4):
        plane, old = flying(points=40, leg_s=9.0)
        link = joined(plane, 20, seed=50 + seed, loss=loss, doubles=0.05, old=old)
        assert link.run(600.0).ok
        assert plane.mixed_legs == []


# ---------------------------------------------------------------- waits that have not begun


def test_no_current_item_answers_a_selection_that_was_not_sent():
    """No heartbeat came, the number was that of the old item: the vehicle flew on to its old waypoint."""
    plane, old = flying()
    plane.load(old, current=1)
    link = joined(plane)
    link.up.put(link.task.start(0), 0)
    while link.task.stage != "verify":
        link.step(0.02)
    plane.ignores = {"COMMAND_LONG"}
    plane._heartbeat = lambda: plane.mission_current(1)
    link.run(5.0)
    assert link.task.stage == "select"
    assert not link.task.state.activation.is_selected


@pytest.mark.parametrize("stage", ["park", "clear"])
def test_an_outage_of_the_service_is_no_wait_for_the_vehicle(stage):
    plane, _ = flying(leg_s=2.0 if stage == "park" else math.inf)
    link = joined(plane, inconsistent=stage == "clear")
    plane.ignores = {"COMMAND_LONG"} if stage == "park" else {"MISSION_CLEAR_ALL"}
    link.up.put(link.task.start(0) if stage == "park" else link.task.start_clearing(0), 0)
    for _ in range(40):
        if link.task.stage == stage:
            break
        link.step()
    link.t_ns += 60 * S
    link.task.resume(link.t_ns)
    link.task.poll(link.t_ns)
    assert link.task.stage == stage
