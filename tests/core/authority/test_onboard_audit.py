"""A vehicle would circle without a mission for ever, or be tasked again after another station cleared it."""

from collections.abc import Callable

import pytest
from helpers.noticed import noticed
from helpers.ordered_flight import SEED, standing
from helpers.played_vehicle import ARDUPLANE, Stage, airborne
from helpers.staging import mission, suspensions
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.tasking.mission_builder import MissionBuilder
from gcs.core.tasking.records import OnboardMission
from gcs.mavlink.autopilots import profile_of
from gcs.mavlink.frames.codec import decode
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import Effect, NoticeCode, Route, Send, Tick, UploadReport, read_only
from sim_vehicles.autopilots.base import Mode
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


def flown(then: Callable[[VirtualRun], None], *, restarts: bool) -> tuple[VirtualRun, list[Effect]]:
    effects: list[Effect] = []
    run = VirtualRun(standing(), SEED)
    run.run(40.0)
    run.on_effect = lambda _t_ns, effect: effects.append(effect)
    snapshot = run.snapshot()
    then(run)
    if restarts:
        run.restart(4.0, snapshot)
    run.run(80.0)
    return run, [effect for effect in effects if getattr(effect, "vehicle", None) == 3]


@pytest.mark.parametrize("restarts", [False, True])
def test_a_vehicle_that_lost_its_mission_in_a_reboot_is_ours_and_gets_another(restarts: bool) -> None:
    run, effects = flown(lambda run: emptied(run, reboots=True), restarts=restarts)
    assert noticed(effects, NoticeCode.MISSION_LOST)
    assert 3 not in run.engine.untaskable()
    assert any(effect.ok for effect in effects if isinstance(effect, UploadReport))
    assert run.vehicles["vehicle:3"].autopilot.mode is Mode.AUTO


def test_a_vehicle_that_was_cleared_during_an_outage_gets_no_mission() -> None:
    run, effects = flown(lambda run: emptied(run, reboots=False), restarts=True)
    assert noticed(effects, NoticeCode.MISSION_DIFFERS)
    assert suspensions(run.engine) == {3: "found"}
    assert not [effect for effect in effects if isinstance(effect, UploadReport)]


def audited() -> Stage:
    """Return a vehicle whose onboard mission is being read back."""
    stage = airborne(ARDUPLANE, "AUTO")
    route = Route(1, (0, 0), read_only([[0.0, 500.0], [900.0, 0.0]]), 1.0)
    planned, profile = MissionBuilder(mission()).of(route, 1, None), profile_of(ARDUPLANE)
    assert profile is not None
    onboard = OnboardMission(route, build_items(profile, planned, Home(33.0, -87.0, 70.0)), 1)
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
