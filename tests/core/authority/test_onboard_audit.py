"""A vehicle would circle without a mission for ever, or be tasked again after another station cleared it."""

import struct
from collections.abc import Callable

import pytest
from helpers.noticed import noticed
from helpers.ordered_flight import flown, standing
from helpers.other_station import AIR
from helpers.played_vehicle import ARDUPLANE, PEER, PX4, Stage, airborne
from helpers.staging import mission, suspensions
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.tasking.mission_builder import MissionBuilder
from gcs.core.tasking.tasking_state import OnboardMission
from gcs.mavlink.autopilots import profile_of
from gcs.mavlink.frames.codec import decode
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import Datagram, Effect, NoticeCode, Route, Send, Tick, UploadReport, read_only
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import VirtualRun

S = 1_000_000_000


def emptied(run: VirtualRun, *, reboots: bool) -> None:
    """Leave vehicle 3 in LOITER without a mission."""
    autopilot = run.vehicles["vehicle:3"].autopilot
    autopilot.set_mode(Mode.LOITER)
    autopilot.mission._items = []
    autopilot.mission_cleared()
    if reboots:
        autopilot.boot_t_ns = run.t_ns


def changed(then: Callable[[VirtualRun], None], *, restarts: bool) -> tuple[VirtualRun, list[Effect]]:
    effects: list[Effect] = []
    run = flown(standing(), 40.0).run
    run.on_effect = lambda _t_ns, effect: effects.append(effect)
    snapshot = run.snapshot()
    then(run)
    if restarts:
        run.restart(4.0, snapshot)
    run.run(80.0)
    return run, [effect for effect in effects if getattr(effect, "vehicle", None) == 3]


@pytest.mark.parametrize("restarts", [False, True])
def test_a_vehicle_that_lost_its_mission_in_a_reboot_is_ours_and_gets_another(restarts: bool) -> None:
    run, effects = changed(lambda run: emptied(run, reboots=True), restarts=restarts)
    assert noticed(effects, NoticeCode.MISSION_LOST)
    assert 3 not in run.engine.untaskable()
    assert any(effect.ok for effect in effects if isinstance(effect, UploadReport))
    assert run.vehicles["vehicle:3"].autopilot.mode is Mode.AUTO


def test_a_vehicle_that_was_cleared_during_an_outage_gets_no_mission() -> None:
    run, effects = changed(lambda run: emptied(run, reboots=False), restarts=True)
    assert noticed(effects, NoticeCode.MISSION_DIFFERS)
    assert suspensions(run.engine) == {3: "found"}
    assert not [effect for effect in effects if isinstance(effect, UploadReport)]


def onboard_of(autopilot: int) -> OnboardMission:
    route = Route(1, (0, 0), read_only([[0.0, 500.0], [900.0, 0.0]]), 1.0)
    planned, profile = MissionBuilder(mission()).of(route, 1, None), profile_of(autopilot)
    assert profile is not None
    return OnboardMission(route, build_items(profile, planned, Home(33.0, -87.0, 70.0)), 1)


def audited() -> Stage:
    """Return a vehicle whose onboard mission is being read back."""
    stage, onboard = airborne(ARDUPLANE, "AUTO"), onboard_of(ARDUPLANE)
    stage.t_ns += S // 20  # its last position is older
    stage.engine.stages.onboard_audit.begin(onboard, stage.t_ns, known_t_ns=stage.t_ns)
    return stage


def test_an_empty_mission_without_a_boot_time_does_not_flood_the_link() -> None:
    """It booted without a GPS fix: each answer was followed by another request at once, for ever."""
    stage = audited()
    requests = 0
    for _ in range(200):
        stage.t_ns += S // 20
        found = stage.step(Tick(stage.t_ns))
        sent = [m.get_type() for e in found if isinstance(e, Send) for m in decode(e.data)[0]]
        if "MISSION_REQUEST_LIST" in sent:
            requests += 1
            stage.hear(dialect.MAVLink_mission_count_message(255, 190, 0, 0))
    assert 5 < requests <= 25
    stage.away_m = 160.0
    stage.wait(1.0)
    stage.hear(dialect.MAVLink_mission_count_message(255, 190, 0, 0))
    assert stage.engine.stages.onboard_audit.awaited == []


def test_a_foreign_mission_of_65535_items_is_named_at_once() -> None:
    """It was downloaded to its end, for an hour; meanwhile the vehicle was said not to answer."""
    stage = audited()
    stage.wait(1.0)
    before = len(stage.effects)
    stage.hear(dialect.MAVLink_mission_count_message(255, 190, 65_535, 0))
    (notice,) = noticed(stage.effects, NoticeCode.MISSION_DIFFERS)
    assert notice.parameters["difference"] == "65535 items instead of 4"
    stage.wait(30.0)
    sent = [m for e in stage.effects[before:] if isinstance(e, Send) for m in decode(e.data)[0]]
    assert [m.get_type() for m in sent if m.get_type().startswith("MISSION")] == ["MISSION_ACK"]
    assert suspensions(stage.engine) == {1: "found"}
    assert not noticed(stage.effects, NoticeCode.MISSION_UNREAD)


def test_an_audit_outlasts_heartbeats_of_a_firmware_that_is_not_known() -> None:
    """The answer to its download ended the service."""
    stage = audited()
    audits = stage.engine.stages.onboard_audit
    stage.hear(dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_QUADROTOR, ARDUPLANE, 129, 10, 4, 3))
    stage.hear(dialect.MAVLink_mission_count_message(255, 190, 0, 0))
    assert audits.awaited == [1]
    stage.wait(1.0)
    stage.hear(dialect.MAVLink_mission_count_message(255, 190, 0, 0))
    assert audits.awaited == []


def mission_current(total: int, mission_id: int) -> bytes:
    """Return a MISSION_CURRENT frame with the extension `mission_id`, which the dialect does not have."""
    payload = struct.pack("<HHBBI", 2, total, dialect.MISSION_STATE_ACTIVE, 1, mission_id)
    header = struct.pack(
        "<BBBBBB", len(payload), 0, 0, 0, 1, 1
    ) + dialect.MAVLINK_MSG_ID_MISSION_CURRENT.to_bytes(3, "little")
    checked = header + payload + bytes([dialect.MAVLink_mission_current_message.crc_extra])
    return b"\xfd" + header + payload + dialect.x25crc(checked).crc.to_bytes(2, "little")


@pytest.mark.parametrize("autopilot", [ARDUPLANE, PX4])
@pytest.mark.parametrize(
    ("longer", "mission_id", "code"),
    [(1, 7, NoticeCode.MISSION_COUNT_CHANGED), (0, 8, NoticeCode.MISSION_CHANGED)],
)
def test_a_mission_that_changes_under_us_is_read_back_and_its_vehicle_is_not_tasked(
    autopilot: int, longer: int, mission_id: int, code: NoticeCode
) -> None:
    """A station with a radio of its own uploaded it: no operator was told, and the route counted as flown."""
    stage, onboard = airborne(autopilot, "AUTO"), onboard_of(autopilot)
    profile = profile_of(autopilot)
    assert profile is not None
    stage.engine.stages.tasking.onboard_missions.note(onboard)
    given = len(onboard.items) - profile.home_items

    def report(total: int, number: int) -> None:
        for _ in range(9):
            stage.step(Datagram(stage.t_ns, AIR, PEER, mission_current(total, number)))
            stage.wait(1.0)

    report(given, 7)
    requests = [m for e in stage.effects if isinstance(e, Send) for m in decode(e.data)[0]]
    assert "MISSION_REQUEST_LIST" not in [m.get_type() for m in requests]
    stage.effects.clear()
    report(given + longer, mission_id)
    (told,) = stage.noticed(code)
    assert told.vehicle == 1
    requests = [m for e in stage.effects if isinstance(e, Send) for m in decode(e.data)[0]]
    assert "MISSION_REQUEST_LIST" in [m.get_type() for m in requests]
    assert stage.engine.stages.onboard_audit.awaited == [1], "nothing is planned meanwhile"
    others = [item.message(seq, 255, 195) for seq, item in enumerate(onboard.items)]
    others[-1].x += 9000
    stage.hear(dialect.MAVLink_mission_count_message(255, 195, len(others), 0))
    for item in others:
        stage.hear(item)
    assert stage.noticed(NoticeCode.MISSION_DIFFERS)
    assert suspensions(stage.engine) == {1: "found"}
