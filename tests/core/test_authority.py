"""An operator would lose the aircraft: one that takes off unasked, or is turned back at tree height.

A vehicle is played message by message, as ArduPlane or as PX4.
"""

from __future__ import annotations

import numpy as np
import pytest
from helpers.noticed import noticed
from helpers.other_station import AIR, MISSION, S
from helpers.played_vehicle import ARDUPLANE, ARM, BOTH, PEER, PX4, SET_MODE, airborne, landed
from helpers.staging import RADAR, at, mission
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import parse
from gcs.core.engine import Engine
from gcs.core.snapshot import decode_state, encode_state
from gcs.core.tasking.mission_builder import MissionBuilder
from gcs.core.tasking.onboard_missions import OnboardMission
from gcs.core.tasking.tasking_state import QueuedRoute
from gcs.mavlink.autopilots import profile_of
from gcs.mavlink.frames.codec import Encoder
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import (
    Authority,
    Datagram,
    MissionEnded,
    NoticeCode,
    Order,
    OrderAnswer,
    Resumed,
    Route,
    Scan,
    Tick,
    read_only,
)

# ---------------------------------------------------------------- arming


@BOTH
def test_a_landed_vehicle_in_auto_is_not_armed_into_its_old_mission(autopilot: int) -> None:
    stage = landed(autopilot)
    (answer,) = stage.order("arm")
    assert answer.state == "refused"
    assert "take off at once" in answer.detail
    stage.wait(5.0)
    assert not stage.commands(ARM)


@BOTH
def test_a_landed_vehicle_in_auto_is_put_into_hold_and_can_be_armed_there(autopilot: int) -> None:
    stage = landed(autopilot)
    assert stage.commands(SET_MODE)
    assert stage.noticed(NoticeCode.LOITER_ON_GROUND)
    stage.mode = "LOITER"
    stage.wait(3.0)
    assert stage.engine.untaskable() == {}, "it stays ours to task"
    (answer,) = stage.order("arm")
    assert answer.state == "accepted"
    assert stage.commands(ARM)


def test_a_landed_vehicle_that_stays_in_auto_is_one_alarm() -> None:
    stage = landed(PX4)
    stage.wait(120.0)
    assert len(stage.noticed(NoticeCode.AUTO_ON_GROUND)) == 1
    assert len(stage.commands(SET_MODE)) <= 10


def test_a_vehicle_that_is_not_heard_is_not_put_into_hold() -> None:
    """It was seen disarmed in AUTO; it may have been armed and have taken off since."""
    stage = landed(ARDUPLANE, "LOITER")
    queue, agent = stage.engine.state.tasking.queue, stage.engine.state.agents[1]
    queue[1] = QueuedRoute(Route(1, (0, 0), read_only([[0.0, 500.0]]), 1.0), 0, 0, False, None)
    agent.routes.flown, agent.tasking.retry.paused_until_t_ns = queue[1].route, 60 * S
    stage.mode = "AUTO"
    stage.show()
    for _ in range(40):
        stage.t_ns += S // 2
        stage.step(Tick(stage.t_ns))
        if agent.link.liveness == "down":
            agent.routes.drop()
    assert not queue
    assert not stage.commands(SET_MODE)


def test_a_vehicle_that_flies_its_mission_is_not_stopped() -> None:
    stage = airborne(ARDUPLANE, "AUTO")
    stage.wait(5.0)
    assert not stage.commands(SET_MODE)


def test_a_vehicle_that_takes_off_by_its_mode_is_not_armed_in_it() -> None:
    stage = landed(ARDUPLANE, "TAKEOFF")
    assert stage.order("arm")[0].state == "refused"


def test_a_vehicle_that_has_fallen_silent_is_not_armed() -> None:
    stage = landed(PX4, "LOITER")
    stage.t_ns += 4 * S
    stage.step(Tick(stage.t_ns))
    (answer,) = stage.order("arm")
    assert (answer.state, answer.detail) == ("refused", "is not heard: its mode is not known")


# ---------------------------------------------------------------- resuming


@BOTH
def test_resume_takes_a_vehicle_back_from_an_operators_loiter(autopilot: int) -> None:
    stage = airborne(autopilot, "AUTO")
    stage.mode = "LOITER"
    stage.wait(2.0)
    assert stage.engine.untaskable() == {1: "is in LOITER and left alone"}
    assert stage.order("resume")[0].state == "accepted"
    stage.wait(3.0)
    assert stage.engine.untaskable() == {}
    (answer,) = [e for e in stage.effects if isinstance(e, OrderAnswer) and e.state == "done"]
    assert answer.detail == "LOITER, armed: waits for its next mission"


def test_orders_that_change_nothing_say_so_and_are_refused() -> None:
    stage = airborne(ARDUPLANE, "AUTO")
    (answer,) = stage.order("resume")
    assert (answer.state, answer.detail) == (
        "refused", "is not suspended, and is in AUTO: nothing was changed",
    )  # fmt: skip
    (answer,) = stage.order("arm")
    assert (answer.state, answer.detail) == ("refused", "is armed: nothing was changed")
    assert stage.order("hold")[0].state == "accepted"
    stage.mode = "LOITER"
    stage.wait(3.0)
    (answer,) = stage.order("hold")
    assert (answer.state, answer.detail) == ("refused", "is held by order: nothing was changed")


@pytest.mark.parametrize(
    ("autopilot", "height_m", "is_refused"),
    [
        (ARDUPLANE, 13.0, True),
        (ARDUPLANE, 39.0, True),
        (ARDUPLANE, 41.0, False),
        (PX4, 13.0, True),
        (PX4, 30.0, False),  # its return ends in a circle at that height
    ],
)
def test_a_vehicle_near_the_ground_is_not_turned_back(
    autopilot: int, height_m: float, is_refused: bool
) -> None:
    stage = airborne(autopilot, "RTL", height_m)
    (answer, *_) = stage.order("resume")
    assert answer.state == ("refused" if is_refused else "accepted")
    if is_refused:
        assert answer.detail == (
            f"is in RTL, {height_m:.0f} m above home: too low to turn back; let it land, or order it to "
            "resume when it is higher"
        )
        assert not stage.commands(SET_MODE)


@BOTH
def test_a_vehicle_that_stands_in_rtl_is_resumed_into_hold_and_never_into_auto(autopilot: int) -> None:
    stage = landed(autopilot, "RTL")
    assert stage.order("resume")[0].state == "accepted"
    stage.mode = "LOITER"
    stage.wait(3.0)
    assert stage.engine.untaskable() == {}
    profile = profile_of(autopilot)
    assert profile is not None
    modes = {(m.param2, m.param3) for m in stage.commands(SET_MODE)}
    assert modes == {profile.mode_numbers("LOITER")}


def test_resume_lets_a_px4_that_rejected_its_mission_have_the_next_one_at_once() -> None:
    stage = airborne(PX4, "AUTO")
    active, none = dialect.MISSION_STATE_ACTIVE, dialect.MISSION_STATE_NO_MISSION
    stage.hear(dialect.MAVLink_mission_current_message(1, 4, active))
    stage.mode = "LOITER"
    stage.show()
    stage.hear(dialect.MAVLink_mission_current_message(1, 4, none))
    assert stage.noticed(NoticeCode.MISSION_REJECTED)
    assert stage.order("resume")[0].state == "accepted"
    stage.wait(3.0)
    (answer,) = [e for e in stage.effects if isinstance(e, OrderAnswer) and e.state == "done"]
    assert answer.detail == "LOITER, armed: waits for its next mission"
    assert not stage.engine.state.agents[1].tasking.retry.failures
    assert stage.engine.untaskable() == {}


@BOTH
@pytest.mark.parametrize(("action", "mode"), [("hold", "LOITER"), ("return", "RTL")])
def test_a_suspended_vehicle_stays_so_over_a_lost_link_a_reboot_and_a_pilots_auto(
    autopilot: int, action: str, mode: str
) -> None:
    stage = airborne(autopilot, "AUTO")
    assert stage.order(action)[0].state == "accepted"
    stage.mode = mode
    stage.wait(3.0)
    before = stage.engine.state.agents[1].control.claims[
        Authority.HELD if action == "hold" else Authority.RETURNING
    ]
    for _ in range(60):
        stage.t_ns += S // 2
        stage.step(Tick(stage.t_ns))
    for stage.mode in ("MANUAL", "AUTO", mode):
        stage.wait(2.0)
        control = stage.engine.state.agents[1].control
        assert control.suspension == action
        assert before in control.claims.values()
    assert stage.order("resume")[0].state == "accepted"
    assert stage.engine.state.agents[1].control.suspension is None


def test_a_pilots_loiter_is_kept_over_a_restart_and_a_reboot_that_empties_the_mission() -> None:
    """It must not pass for the mode that the vehicle booted in."""
    before = Engine(parse(MISSION, "x"), 1)
    before.stages.tasking.overrides.of(1).observe_mode("AUTO", 90 * S)
    before.stages.tasking.overrides.of(1).observe_mode("LOITER", 100 * S)
    after = Engine(parse(MISSION, "x"), 1, decode_state("test", encode_state(before.state)))
    after.step(Resumed(110 * S, 105 * S))
    overrides = after.stages.tasking.overrides
    overrides.note_mission_lost(1, 200 * S, 230 * S)
    assert overrides.modes() == {1: "LOITER"}


def test_a_vehicle_of_an_unknown_firmware_is_not_tasked_from_its_first_heartbeat() -> None:
    """The first plan would count on it, and leave its target without an agent until the upload fails."""
    engine, encode = Engine(parse(MISSION, "x"), 1), Encoder(1, 1)
    generic = dialect.MAV_AUTOPILOT_GENERIC
    heartbeat = dialect.MAVLink_heartbeat_message(1, generic, 129, 0, 4, 3)
    engine.step(Datagram(S, AIR, PEER, encode(heartbeat)))
    engine.step(Tick(2 * S))
    assert engine.untaskable() == {1: "has a firmware that is not known here"}
    assert engine.state.agents[1].control.authority is Authority.UNSUPPORTED
    for action in ("hold", "return", "resume"):
        (answer,) = engine.step(Order(3 * S, action, action, (1,)))
        assert isinstance(answer, OrderAnswer)
        assert (answer.state, answer.detail) == ("refused", "has a firmware that is not known here")


# ---------------------------------------------------------------- landing


@BOTH
def test_a_vehicle_on_its_final_approach_is_not_tasked(autopilot: int) -> None:
    stage = airborne(autopilot, "AUTO", height_m=60.0)
    config, profile = mission(tables='[mission]\nend = "land"\n'), profile_of(autopilot)
    assert profile is not None
    route = Route(1, (0, 0), read_only([[0.0, 500.0], [900.0, 0.0]]), 1.0)
    planned = MissionBuilder(config).of(route, 1, None)
    items = build_items(profile, planned, Home(33.0, -87.0, 70.0))
    stage.engine.stages.tasking.onboard_missions.note(OnboardMission(route, items, profile.home_items))
    stage.hear(dialect.MAVLink_mission_current_message(len(items) - 2))
    stage.wait(1.0)
    assert stage.engine.untaskable() == {}
    stage.hear(dialect.MAVLink_mission_current_message(len(items) - 1))
    stage.wait(1.0)
    assert stage.engine.untaskable() == {1: "is landing and left alone"}
    stage.height_m, stage.speed_m_s = 0.5, 1.0
    stage.wait(1.0)
    assert stage.engine.untaskable() == {1: "is landing and left alone"}, "it rolls out: no new take-off"


# ---------------------------------------------------------------- notices to the operator


@BOTH
@pytest.mark.parametrize("mode", ["RTL", "MANUAL"])
def test_a_mode_that_is_not_ours_is_reported_at_the_start_with_the_remedy(autopilot: int, mode: str) -> None:
    stage = airborne(autopilot, mode)
    (overridden,) = stage.noticed(NoticeCode.OVERRIDDEN)
    assert (overridden.vehicle, overridden.parameters["mode"]) == (1, mode)
    stage.wait(20.0)
    assert len(stage.noticed(NoticeCode.OVERRIDDEN)) == 1
    stage.mode = "AUTO"
    stage.wait(2.0)
    assert stage.noticed(NoticeCode.OURS_AGAIN)


def test_the_mode_of_a_start_is_not_told_as_a_choice_of_a_pilot() -> None:
    stage = airborne(ARDUPLANE, "INITIALISING")
    stage.wait(5.0)
    assert not stage.noticed(NoticeCode.OVERRIDDEN)
    stage.mode = "MANUAL"
    stage.wait(5.0)
    (overridden,) = stage.noticed(NoticeCode.OVERRIDDEN)
    assert overridden.parameters["mode"] == "MANUAL"


def test_a_mode_that_an_operator_ordered_here_is_not_an_override() -> None:
    stage = airborne(ARDUPLANE, "AUTO")
    stage.order("return")
    stage.mode = "RTL"
    stage.wait(5.0)
    assert not stage.noticed(NoticeCode.OVERRIDDEN)


def test_targets_that_appear_after_the_missions_end_are_reported_once_with_the_remedy() -> None:
    engine, effects = Engine(mission(agents=[(100.0, 200.0)], births=[(1500.0, 200.0)]), 1), []
    for t_s in range(60):  # the agent never shows up: it is given up after 20 s
        place = [(1500.0, 200.0)] if t_s > 30 else []
        scan = Scan(at(t_s), at(t_s), RADAR, read_only(np.reshape(place, (-1, 2))))
        effects += engine.step(scan) + engine.step(Tick(at(t_s)))
    assert any(isinstance(effect, MissionEnded) for effect in effects)
    assert len(noticed(effects, NoticeCode.TARGETS_UNATTENDED)) == 1
