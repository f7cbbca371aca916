"""An operator would lose the mission to a wreck that counts as a vehicle, or see a wreck launched.

One vehicle is played message by message, as ArduPlane or as PX4.
"""

from __future__ import annotations

import pytest
from helpers.aeroplane import AIRSPEED, GLITCH, Aeroplane, estimate
from helpers.noticed import noticed
from helpers.played_vehicle import ARDUPLANE, ARM, BOTH, PX4, SET_MODE
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.model import (
    NS_PER_S,
    PHASE_TRANSITIONS,
    AgentStatus,
    FlightEvent,
    FlightPhase,
    HealthItem,
    Notice,
    NoticeCode,
    Tick,
)

P, E = FlightPhase, FlightEvent


# ---------------------------------------------------------------- phases


def test_the_table_of_phases_has_no_way_from_the_ground_after_a_flight_but_an_order_or_the_air() -> None:
    for phase in (P.LANDED, P.DOWN):
        for event, after in PHASE_TRANSITIONS[phase].items():
            assert after.is_in_air or (event is E.READY and after is P.ON_GROUND)
    for phase in P:
        reached = {after for events in PHASE_TRANSITIONS.values() for after in events.values()}
        assert phase in reached or phase is P.UNKNOWN


@BOTH
def test_a_crashed_vehicle_with_a_living_radio_is_down_within_three_seconds(autopilot: int) -> None:
    plane = Aeroplane(autopilot)
    plane.wait(5.0)
    assert plane.phase is P.EN_ROUTE
    plane.crash()
    plane.wait(3.0)
    assert plane.phase is P.DOWN
    assert plane.status_of_agent == "down"
    (told,) = plane.noticed(NoticeCode.CAME_DOWN)
    assert (told.vehicle, told.parameters["phase"]) == (1, "en route")
    assert told.parameters["lat_deg"] == pytest.approx(33.0, abs=0.05)  # where to look
    assert [e.status for e in plane.effects if isinstance(e, AgentStatus)] == ["down"]
    plane.armed = False
    plane.wait(10.0)
    assert plane.status_of_agent == "down"


@BOTH
def test_a_wreck_obeys_no_order_and_is_only_kept_from_taking_off(autopilot: int) -> None:
    plane = Aeroplane(autopilot)
    plane.wait(5.0)
    plane.crash()
    plane.wait(3.0)
    plane.effects.clear()
    plane.armed = False
    plane.wait(1.0)
    plane.effects.clear()
    for action in ("resume", "hold", "return", "arm"):
        answers = plane.order(action)
        assert [answer.state for answer in answers] == ["refused"], action
        assert "is down" in answers[0].detail
    plane.wait(5.0)
    assert not plane.commands(ARM)
    loiter = (12.0, 0.0) if autopilot == ARDUPLANE else (4.0, 3.0)
    assert {(sent.param2, sent.param3) for sent in plane.commands(SET_MODE)} == {loiter}


@BOTH
def test_only_the_order_that_it_is_ready_takes_a_wreck_back(autopilot: int) -> None:
    plane = Aeroplane(autopilot)
    plane.wait(5.0)
    plane.crash()
    plane.wait(3.0)
    assert "disarm it first" in plane.order("ready")[0].detail
    plane.armed = False
    plane.wait(2.0)
    assert [answer.state for answer in plane.order("ready")] == ["accepted", "done"]
    assert plane.phase is P.ON_GROUND
    assert plane.status_of_agent == "active"
    assert "nothing was changed" in plane.order("ready")[0].detail


@BOTH
def test_a_landed_vehicle_in_auto_is_set_to_loiter_and_not_armed_before_it_is_ready(autopilot: int) -> None:
    """PX4 disarms after a failsafe landing and shows AUTO: armed, it would fly its old mission at once."""
    plane = Aeroplane(autopilot, "RTL")
    plane.away_m = 10.0
    plane.wait(5.0)
    assert plane.phase is P.RETURNING
    plane.crash()  # as gently as one can
    plane.wait(2.0)
    plane.armed, plane.mode = False, "AUTO"
    plane.wait(1.5)
    assert plane.phase is P.LANDED
    assert plane.status_of_agent == "active"
    assert not plane.noticed(NoticeCode.OURS_AGAIN)
    assert plane.commands(SET_MODE)
    plane.mode = "LOITER"
    plane.wait(2.0)
    assert "has landed" in plane.order("arm")[0].detail
    plane.order("ready")
    assert [answer.state for answer in plane.order("arm")] == ["accepted"]


def test_a_landing_by_px4s_own_mission_is_no_crash() -> None:
    plane = Aeroplane(PX4)
    plane.away_m, plane.landed_state = 400.0, dialect.MAV_LANDED_STATE_LANDING
    plane.wait(4.0)
    assert plane.phase is P.LANDING
    plane.crash()
    plane.landed_state = dialect.MAV_LANDED_STATE_ON_GROUND
    plane.wait(3.0)
    assert plane.phase is P.LANDED
    assert not plane.noticed(NoticeCode.CAME_DOWN)


def test_a_battery_landing_in_a_field_is_down() -> None:
    plane = Aeroplane(PX4)
    plane.wait(3.0)
    plane.mode, plane.landed_state = "LAND", dialect.MAV_LANDED_STATE_LANDING
    plane.wait(3.0)
    plane.crash()
    plane.wait(3.0)
    assert plane.phase is P.DOWN


def test_a_crash_on_a_hill_is_seen_by_the_autopilots_own_word() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.landed_state = dialect.MAV_LANDED_STATE_IN_AIR
    plane.wait(4.0)
    plane.climb_m_s, plane.speed_m_s, plane.height_m = 0.0, 0.0, 60.0
    plane.wait(4.0)
    assert plane.phase is P.EN_ROUTE  # it may stand still over the ground, in a strong wind
    plane.landed_state = dialect.MAV_LANDED_STATE_ON_GROUND
    plane.wait(3.0)
    assert plane.phase is P.DOWN


def test_a_vehicle_that_rolls_and_stops_before_it_flew_is_not_down() -> None:
    plane = Aeroplane(ARDUPLANE, armed=False, height_m=0.0)
    plane.away_m = 0.0
    plane.wait(2.0)
    assert plane.phase is P.ON_GROUND
    plane.armed, plane.speed_m_s = True, 9.0
    plane.wait(2.0)
    assert plane.phase is P.TAKING_OFF
    plane.speed_m_s = 0.0
    plane.wait(3.0)
    assert plane.phase is P.ON_GROUND
    assert plane.status_of_agent == "active"


def test_a_vehicle_that_bounced_and_flies_on_is_tasked_again() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.crash()
    plane.wait(3.0)
    assert plane.status_of_agent == "down"
    plane.climb_m_s, plane.speed_m_s = 5.0, 15.0
    plane.wait(8.0)
    assert plane.phase is P.EN_ROUTE
    assert plane.status_of_agent == "active"


# ---------------------------------------------------------------- health


def test_lost_gps_begins_makes_unfit_and_ends() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.fix = 1
    plane.wait(3.0)
    assert plane.problems(NoticeCode.GPS_PROBLEM)[0].startswith("no 3D fix")
    plane.wait(4.0)
    assert "no 3D fix" in plane.engine.state.agents[1].flight.unfit
    plane.fix = 3
    plane.wait(5.0)
    assert plane.noticed(NoticeCode.GPS_GOOD)
    assert not plane.engine.state.agents[1].flight.unfit
    assert not plane.engine.state.agents[1].flight.problems


@BOTH
def test_a_jump_of_the_gps_position_is_told_before_the_estimator_follows_it(autopilot: int) -> None:
    plane = Aeroplane(autopilot)
    good = 0x33F
    for flags, expected in ((good, 0), (good | GLITCH[autopilot], 1)):
        for _ in range(4):
            plane.hear(estimate(autopilot, flags))
            plane.wait(0.5)
        causes = plane.problems(NoticeCode.GPS_POSITION_PROBLEM)
        assert len(causes) == expected
        assert all(cause.startswith("it jumps") for cause in causes)
    plane.fix = 1
    plane.wait(2.0)
    (cause,) = plane.problems(NoticeCode.GPS_PROBLEM)
    assert cause.startswith("no 3D fix"), "a worse problem, told too"


def test_sinking_at_full_throttle_is_a_failed_engine_and_its_cause_is_told_when_it_is_down() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.climb_m_s, plane.throttle = -4.0, 100
    plane.wait(4.5)
    assert plane.problems(NoticeCode.PROPULSION_PROBLEM)[0].startswith("it sinks at full throttle")
    assert plane.engine.state.agents[1].flight.unfit
    plane.crash()
    plane.wait(3.0)
    (causes,) = plane.causes_of_coming_down()
    assert "engine or propeller" in causes


def test_a_dive_for_a_blocked_airspeed_sensor_is_no_failed_engine_and_takes_no_target() -> None:
    """PX4 1.17 dives at full throttle for 9 s; its sensor is unhealthy 1.5 s after the dive began."""
    plane = Aeroplane(PX4)
    plane.wait(4.0)
    plane.climb_m_s, plane.throttle = -4.0, 100
    plane.wait(1.5)
    plane.failed = AIRSPEED
    plane.wait(7.5)
    plane.climb_m_s, plane.throttle = 0.0, 60
    plane.wait(10.0)
    assert plane.noticed(NoticeCode.AIRSPEED_PROBLEM)
    assert not plane.noticed(NoticeCode.PROPULSION_PROBLEM)


def test_an_engine_that_fails_after_the_airspeed_sensor_is_told() -> None:
    plane = Aeroplane(PX4)
    plane.wait(4.0)
    plane.failed = AIRSPEED
    plane.wait(16.0)
    plane.climb_m_s, plane.throttle = -4.0, 100
    plane.wait(4.5)
    assert plane.noticed(NoticeCode.PROPULSION_PROBLEM)


def test_a_glide_in_waves_is_a_failed_engine_too() -> None:
    """ArduPlane without thrust sinks for some seconds, and then holds its height for some."""
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.throttle = 100
    for _ in range(3):
        plane.climb_m_s = -3.0
        plane.wait(1.5)
        plane.climb_m_s = 0.0
        plane.wait(2.0)
    assert plane.problems(NoticeCode.PROPULSION_PROBLEM)[0].startswith("it sinks at full throttle")
    assert not plane.noticed(NoticeCode.PROPULSION_GOOD)


def test_a_vehicle_that_sinks_in_waves_is_one_alarm_and_one_all_clear() -> None:
    plane = Aeroplane(ARDUPLANE, "LOITER", height_m=60.0)
    plane.wait(4.0)
    for _ in range(3):
        plane.climb_m_s = -3.0
        plane.wait(2.5)
        plane.climb_m_s = 0.0
        plane.wait(3.0)
    (alarm,) = plane.noticed(NoticeCode.SINKS)
    assert alarm.parameters["sink_m_s"] == pytest.approx(3.0, abs=0.5)
    assert not plane.noticed(NoticeCode.SINKS_NO_LONGER)
    plane.wait(6.0)
    assert len(plane.noticed(NoticeCode.SINKS_NO_LONGER)) == 1


@BOTH
def test_a_dive_is_told_before_the_ground_also_on_the_way_home(autopilot: int) -> None:
    plane = Aeroplane(autopilot, "RTL", height_m=120.0)
    plane.wait(4.0)
    plane.climb_m_s = -18.0
    plane.wait(2.5)
    assert plane.noticed(NoticeCode.SINKS)[0].parameters["sink_m_s"] == pytest.approx(18.0, abs=0.5)


def test_a_pilots_dive_is_no_news() -> None:
    plane = Aeroplane(ARDUPLANE, "FBWA", height_m=120.0)
    plane.wait(4.0)
    plane.climb_m_s = -18.0
    plane.wait(2.5)
    assert not plane.noticed(NoticeCode.SINKS)


def test_the_cause_of_a_problem_is_that_of_its_newest_telemetry() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.percent = 14
    plane.wait(4.0)
    plane.percent, plane.failed = 98, dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    plane.wait(4.0)
    plane.crash()
    plane.wait(3.0)
    assert plane.causes_of_coming_down() == ["the autopilot reports that it is empty or faulty"]


def test_a_fence_breach_of_arduplane_is_a_failsafe_although_its_text_is_a_notice() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.say("Max Alt fence breached", 5)
    plane.mode = "RTL"
    plane.wait(5.0)
    assert [cause for cause in causes_told(plane, "RTL") if cause.startswith("Max Alt fence breached")]


def test_the_alarm_of_a_problem_ends_with_a_take_off_that_is_broken_off() -> None:
    """The vehicle did not land and did not come down: its alarm stayed for ever."""
    plane = Aeroplane(ARDUPLANE, armed=False, height_m=0.5)
    plane.armed, plane.speed_m_s, plane.height_m = True, 12.0, 2.0
    plane.failed = dialect.MAV_SYS_STATUS_SENSOR_PROPULSION
    plane.wait(6.0)
    assert plane.phase is P.TAKING_OFF
    plane.crash()
    plane.wait(30.0)
    assert plane.phase is P.ON_GROUND
    codes = [e.code for e in plane.effects if isinstance(e, Notice)]
    assert codes.count(NoticeCode.PROPULSION_PROBLEM) == 1
    (end,) = [code for code in codes if NoticeCode.PROPULSION_PROBLEM in code.ends]
    assert codes.index(end) > codes.index(NoticeCode.PROPULSION_PROBLEM)


def test_a_short_sink_at_full_throttle_is_no_news() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.climb_m_s, plane.throttle = -4.0, 100
    plane.wait(1.5)
    plane.climb_m_s = 2.0
    plane.wait(8.0)
    assert not plane.noticed(NoticeCode.PROPULSION_PROBLEM)
    assert not plane.engine.state.agents[1].flight.problems


def test_a_receiver_that_never_heard_a_transmitter_is_no_news_and_one_that_lost_it_is() -> None:
    plane = Aeroplane(PX4, failed=dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER)
    plane.wait(4.0)
    assert HealthItem.RC not in plane.engine.state.agents[1].flight.problems
    plane.failed = 0
    plane.wait(2.0)
    plane.failed = dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    plane.wait(4.0)
    assert plane.noticed(NoticeCode.RC_PROBLEM)


def test_an_airspeed_sensor_disabled_in_flight_is_told_and_one_that_was_never_used_is_not() -> None:
    """After a failure the sensor is present and healthy, and not enabled, until it is used again."""
    unused = Aeroplane(ARDUPLANE, disabled=AIRSPEED)
    unused.wait(4.0)
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.disabled = AIRSPEED
    plane.wait(3.0)
    plane.disabled = 0
    plane.wait(5.0)
    told, good = NoticeCode.AIRSPEED_PROBLEM, NoticeCode.AIRSPEED_GOOD
    codes = [e.code for e in plane.effects if isinstance(e, Notice) and e.code in (told, good)]
    assert codes == [told, good]
    assert not [e for e in unused.effects if isinstance(e, Notice) and e.code is told]


def test_a_battery_that_does_not_last_for_the_route_and_back_is_told_and_limits_the_range() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    for percent in range(80, 60, -1):
        plane.percent = percent
        plane.wait(4.0)
    flight = plane.engine.state.agents[1].flight
    assert flight.endurance_s == pytest.approx(46 * 85.0 / 19, abs=5.0)


# ---------------------------------------------------------------- failsafes


def told(plane: Aeroplane, mode: str) -> list[Notice]:
    """Return the notices of a mode that was not commanded."""
    found = noticed(plane.effects, NoticeCode.FAILSAFE, NoticeCode.OVERRIDDEN)
    return [notice for notice in found if notice.parameters["mode"] == mode]


def causes_told(plane: Aeroplane, mode: str) -> list[str]:
    """Return the causes of the failsafes that chose a mode."""
    return [str(one.parameters["cause"]) for one in told(plane, mode) if one.code is NoticeCode.FAILSAFE]


def test_a_failsafe_is_told_with_the_autopilots_cause_and_never_as_a_persons_choice() -> None:
    plane = Aeroplane(PX4)
    plane.wait(4.0)
    plane.say("Low battery\t")
    plane.say("Failsafe activated: entering Hold for 5 seconds\t")
    plane.mode, plane.system_status = "LOITER", dialect.MAV_STATE_CRITICAL
    plane.wait(2.0)
    cause = "Low battery; Failsafe activated: entering Hold for 5 seconds"
    assert causes_told(plane, "LOITER") == [cause]
    plane.mode = "LAND"
    plane.wait(2.0)
    assert causes_told(plane, "LAND")
    assert not plane.noticed(NoticeCode.OVERRIDDEN)


def test_px4s_loss_of_the_ground_station_is_a_cause_although_its_text_is_an_information() -> None:
    plane = Aeroplane(PX4)
    plane.wait(4.0)
    plane.say("Connection to ground station lost\t", 6)
    plane.mode, plane.system_status = "LOITER", dialect.MAV_STATE_CRITICAL
    plane.wait(2.0)
    assert causes_told(plane, "LOITER") == ["Connection to ground station lost"]


def test_a_failsafe_of_px4_without_a_text_of_its_cause_is_told_with_what_the_vehicle_lacks() -> None:
    """PX4 1.17: 77 to 100 s after the loss of its GPS it returns."""
    plane = Aeroplane(PX4)
    plane.wait(4.0)
    plane.fix = 0
    plane.wait(4.0)
    plane.say("Failsafe activated\t")
    plane.mode, plane.system_status = "RTL", dialect.MAV_STATE_CRITICAL
    plane.wait(2.0)
    (cause,) = causes_told(plane, "RTL")
    assert cause.startswith("no 3D fix")
    assert cause.endswith("; Failsafe activated")


def test_a_drifting_position_is_the_cause_of_a_failsafe_of_px4() -> None:
    plane = Aeroplane(PX4)
    plane.wait(4.0)
    plane.say("Position estimate has low accuracy\t", 4)
    plane.say("Failsafe activated\t")
    plane.mode, plane.system_status = "RTL", dialect.MAV_STATE_CRITICAL
    plane.wait(2.0)
    assert causes_told(plane, "RTL") == ["Position estimate has low accuracy; Failsafe activated"]


def test_arduplanes_long_failsafe_is_told_in_its_own_words() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.say("RC Short Failsafe On", 4)
    plane.system_status = dialect.MAV_STATE_CRITICAL
    plane.wait(5.0)
    plane.say("RC Long Failsafe On: RTL", 4)
    plane.mode = "RTL"
    plane.wait(4.0)
    assert causes_told(plane, "RTL") == ["RC Short Failsafe On; RC Long Failsafe On: RTL"]


def test_arduplanes_failsafe_whose_text_was_lost_on_the_way_is_told_by_its_heartbeat() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.mode, plane.system_status = "RTL", dialect.MAV_STATE_CRITICAL
    plane.wait(4.0)
    assert causes_told(plane, "RTL")[0].startswith("its autopilot names no cause")


def test_a_failsafe_that_began_while_the_link_was_down_names_the_link() -> None:
    plane = Aeroplane(PX4)
    plane.wait(4.0)
    for _ in range(20):
        plane.t_ns += NS_PER_S // 2
        plane.step(Tick(plane.t_ns))
    plane.mode, plane.system_status = "RTL", dialect.MAV_STATE_CRITICAL
    plane.wait(5.0)
    assert causes_told(plane, "RTL") == ["its link was down"]


def test_arduplanes_failsafe_that_ends_as_its_link_returns_names_the_link() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    for _ in range(20):
        plane.t_ns += NS_PER_S // 2
        plane.step(Tick(plane.t_ns))
    plane.say("GCS Failsafe Off", 4)  # before a heartbeat with its mode, in which it is ACTIVE again
    plane.mode = "RTL"
    plane.wait(5.0)
    assert causes_told(plane, "RTL") == ["its link was down"]


@pytest.mark.parametrize("mode", ["RTL", "FBWA"])
def test_a_failsafe_that_ends_on_a_living_link_chooses_no_mode(mode: str) -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.say("GCS Failsafe Off", 4)
    plane.mode = mode
    plane.wait(5.0)
    assert told(plane, mode)[0].code is NoticeCode.OVERRIDDEN


@pytest.mark.parametrize("silent_s", [0, 12])
def test_a_px4_that_rebooted_into_hold_is_not_told_as_a_persons_choice(silent_s: int) -> None:
    """It boots in silence, or so fast that only its clock tells it."""
    plane = Aeroplane(PX4)
    plane.wait(6.0)
    for _ in range(silent_s):
        plane.t_ns += NS_PER_S
        plane.step(Tick(plane.t_ns))
    plane.booted_t_ns, plane.mode = plane.t_ns, "LOITER"
    plane.wait(4.0)
    (notice,) = told(plane, "LOITER")
    assert str(notice.parameters["why"]).startswith("it rebooted, or ")
    assert plane.noticed(NoticeCode.REBOOTED)


def test_a_px4_that_leaves_land_by_itself_after_a_landing_is_not_told_as_a_persons_choice() -> None:
    plane = Aeroplane(PX4)
    plane.wait(4.0)
    plane.say("Emergency battery level\t")
    plane.mode, plane.system_status, plane.climb_m_s = "LAND", dialect.MAV_STATE_CRITICAL, -5.0
    plane.wait(20.0)
    plane.climb_m_s, plane.speed_m_s, plane.height_m = 0.0, 0.0, 0.0
    plane.wait(6.0)
    plane.armed, plane.mode, plane.system_status = False, "LOITER", dialect.MAV_STATE_STANDBY
    plane.wait(6.0)
    assert plane.phase.has_flown
    assert not plane.noticed(NoticeCode.OVERRIDDEN)


def test_a_persons_choice_long_after_a_reboot_is_told_as_such() -> None:
    plane = Aeroplane(PX4)
    plane.wait(6.0)
    plane.booted_t_ns = plane.t_ns
    plane.wait(40.0)
    assert plane.noticed(NoticeCode.REBOOTED)
    plane.mode = "LOITER"
    plane.wait(4.0)
    (notice,) = told(plane, "LOITER")
    assert str(notice.parameters["why"]).startswith("an operator ")


PX4_TEXTS = ["Low battery", "Geofence: approaching or outside geofence", "GNSS data fusion stopped"]


@pytest.mark.parametrize("text", [*PX4_TEXTS, "Failsafe activated"])
def test_a_persons_choice_after_a_warning_of_px4_is_not_told_as_a_failsafe(text: str) -> None:
    """The heartbeat shows a failsafe; a text alone may be a warning, or a lie."""
    plane = Aeroplane(PX4)
    plane.wait(4.0)
    plane.say(text)
    plane.mode = "LOITER"
    plane.wait(2.0)
    (notice,) = told(plane, "LOITER")
    assert notice.code is NoticeCode.OVERRIDDEN
    assert notice.parameters["why"] == "an operator or another station chose that mode"


@pytest.mark.parametrize("mode", ["RTL", "FBWA", "LOITER"])
@pytest.mark.parametrize(
    ("text", "severity"),
    [
        ("GPS 1: detected u-blox", 5),
        ("EKF3 IMU0 origin set: fence loaded", 5),
        ("EKF3 lane switch 1", 2),
        ("PolyFence: storage write failed", 4),
        ("Mode change to AUTO denied, in fence recovery", 5),
        ("engine failsafe battery gps crash termination", 2),
    ],
)
def test_a_persons_choice_after_any_text_of_arduplane_is_not_told_as_a_failsafe(
    text: str, severity: int, mode: str
) -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.say(text, severity)
    plane.mode = mode
    plane.wait(5.0)
    (notice,) = told(plane, mode)
    assert notice.code is NoticeCode.OVERRIDDEN


def test_a_pilot_who_answers_a_warning_of_arduplane_is_not_told_as_a_failsafe() -> None:
    """With BATT_FS_LOW_ACT 0 and FENCE_ACTION 0 it warns, and stays CRITICAL for an empty battery."""
    for text, severity, status in (
        ("Battery 1 is low 10.40V used 2900 mAh", 4, dialect.MAV_STATE_CRITICAL),
        ("Max Alt fence breached", 5, dialect.MAV_STATE_ACTIVE),
    ):
        plane = Aeroplane(ARDUPLANE)
        plane.wait(4.0)
        plane.say(text, severity)
        plane.system_status = status
        plane.wait(4.0)
        plane.mode = "RTL"
        plane.wait(5.0)
        assert told(plane, "RTL")[0].code is NoticeCode.OVERRIDDEN, text


def test_a_mode_that_no_failsafe_chooses_is_a_pilots_also_right_after_a_breach() -> None:
    plane = Aeroplane(ARDUPLANE)
    plane.wait(4.0)
    plane.say("Max Alt fence breached", 5)
    plane.mode = "FBWA"
    plane.wait(3.0)
    (notice,) = told(plane, "FBWA")
    assert notice.code is NoticeCode.OVERRIDDEN
    assert notice.parameters["why"] == "a pilot or another station chose that mode"
