"""A vehicle would circle without a mission for ever, or be tasked again after another station cleared it."""

from collections.abc import Callable

import pytest
from core.test_restart import SEED, standing
from noticed import noticed
from staging import suspensions

from gcs.model import Effect, NoticeCode, UploadReport
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
    assert 3 not in run.command.untaskable()
    assert any(effect.ok for effect in effects if isinstance(effect, UploadReport))
    assert run.vehicles["vehicle:3"].autopilot.mode is Mode.AUTO


def test_a_vehicle_that_was_cleared_during_an_outage_gets_no_mission() -> None:
    run, effects = flown(lambda run: emptied(run, reboots=False), restarts=True)
    assert noticed(effects, NoticeCode.MISSION_DIFFERS)
    assert suspensions(run.command) == {3: "found"}
    assert not [effect for effect in effects if isinstance(effect, UploadReport)]
