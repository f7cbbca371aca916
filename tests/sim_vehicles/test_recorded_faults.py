"""The simulated autopilots break down as the firmwares did.

Otherwise a user would trust alarms that were tested against what no vehicle does.

Expected times, modes and texts are those of recorded flights: ArduPlane 4.7-dev (flights C4 and A6) and
PX4 1.17-dev (r2 and r5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicles.vehicle.faults import Fault, FaultKind

SET_MODE, ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
LAND = mavlink.MAV_CMD_NAV_LAND
PX4_HOLD, PX4_AUTO, PX4_RTL, PX4_LAND = (4 << 16 | sub << 24 for sub in (3, 4, 5, 6))
PLANE_AUTO, PLANE_RTL = 10, 11
STANDBY, ACTIVE, CRITICAL = 3, 4, 5
AIRSPEED, GPS, RC, AHRS, BATTERY = 0x10, 0x20, 0x10000, 0x200000, 0x2000000
FAULT_S = 2.0


@dataclass
class Flight:
    """What one vehicle sent; times are from the fault, in steps of 0.1 s."""

    ground: Any
    heard: list[tuple[float, Any]]

    def first(self, kind, condition):
        """Return the time of the first message of a kind that fulfils a condition; None without one."""
        return next((t_s for t_s, m in self.heard if m.get_type() == kind and condition(m)), None)

    def text(self, text):
        return self.first("STATUSTEXT", lambda m: m.text.rstrip("\t") == text)

    def texts(self):
        return [m.text.rstrip("\t") for t_s, m in self.heard if m.get_type() == "STATUSTEXT" and t_s >= 0.0]

    def modes(self):
        """Return the changes of the mode: (seconds, custom mode)."""
        beats = [(t_s, m.custom_mode) for t_s, m in self.heard if m.get_type() == "HEARTBEAT"]
        return [beat for n, beat in enumerate(beats) if n == 0 or beat[1] != beats[n - 1][1]]

    def lost_bit(self, bit, field="onboard_control_sensors_health"):
        return self.first("SYS_STATUS", lambda m: not getattr(m, field) & bit)

    def last(self, kind):
        return [m for _, m in self.heard if m.get_type() == kind][-1]


@pytest.fixture
def fly(ground, item):
    """Fly a mission in AUTO at 90 m; 2 s later something breaks."""

    def fly_one(autopilot, kind, until_s, *, lasts_s=0.0, speed_m_s=15.0, items=None, **parameters):
        g = ground(
            autopilot=autopilot, faults=(Fault(FaultKind(kind), FAULT_S, lasts_s),), airframe="banked",
            parameters=parameters, forward_speed_m_s=speed_m_s, alt_rel_m=90.0,
        )  # fmt: skip
        is_px4 = autopilot == "px4"
        rows = [item(0, 0.0, 0.0)] if not is_px4 else []
        for east_m, north_m, *command in items or [(20_000.0, 0.0)]:
            rows.append(item(len(rows), east_m, north_m, 90.0, command=command[0] if command else 16))
        replies = g.send(mavlink.MAVLink_mission_count_message(7, 1, len(rows), 0))
        while replies[-1].get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
            replies = g.send(rows[replies[-1].seq])
        g.command(SET_MODE, 1, *((4, 4) if is_px4 else (PLANE_AUTO,)))
        heard = []
        for step in range(round((FAULT_S + until_s) * 10)):
            heard += [((step + 1) / 10 - FAULT_S, m) for m in g.fly(0.1)]
        return Flight(g, heard)

    return fly_one


def test_a_crashed_arduplane_stays_armed_in_auto_at_height_zero(fly):
    """C4: the impact at 24 m/s, STANDBY 10 s later, disarmed after 48 s; the mode stays AUTO."""
    flight = fly("ardupilot", "crash", 60.0)
    hit_s = flight.first("GLOBAL_POSITION_INT", lambda m: m.relative_alt < 100)
    dives = [m for t_s, m in flight.heard if m.get_type() == "GLOBAL_POSITION_INT" and 1.0 < t_s < hit_s]
    assert dives[-1].vz > 1500
    standby_s = flight.first("HEARTBEAT", lambda m: m.system_status == STANDBY)
    disarmed_s = flight.first("HEARTBEAT", lambda m: not m.base_mode & 128)
    assert standby_s - hit_s == pytest.approx(10.0, abs=1.1)
    assert disarmed_s - hit_s == pytest.approx(48.4, abs=1.1)
    assert [mode for _, mode in flight.modes()][-1] == PLANE_AUTO
    assert flight.last("GLOBAL_POSITION_INT").relative_alt == 0
    assert flight.ground.vehicle.alive
    assert flight.ground.vehicle.is_down


def test_a_wreck_accepts_commands_and_never_flies_again(fly):
    flight = fly("ardupilot", "crash", 60.0)
    g = flight.ground
    assert g.command(SET_MODE, 1, PLANE_AUTO)[0] == 0
    assert g.command(ARM, 1)[0] == 0
    g.fly(30.0)
    assert g.vehicle.alt_rel_m == 0.0
    assert g.vehicle.is_down


def test_without_thrust_an_arduplane_glides_down_at_full_throttle_in_auto(fly):
    """A6, agent 1: from 90 m at 22 m/s down in 35 s, at half the speed; it stays armed."""
    flight = fly("ardupilot", "engine", 60.0, speed_m_s=22.0)
    assert flight.first("GLOBAL_POSITION_INT", lambda m: m.relative_alt < 100) == pytest.approx(35.0, abs=5.0)
    assert flight.first("VFR_HUD", lambda m: m.throttle == 100) <= 1.0
    at_30 = next(m for t_s, m in flight.heard if m.get_type() == "VFR_HUD" and t_s > 25.0)
    assert at_30.airspeed == pytest.approx(11.0, abs=1.0)
    assert at_30.climb == pytest.approx(-2.55, abs=0.5)
    beat = flight.last("HEARTBEAT")
    assert (beat.custom_mode, beat.base_mode & 128, beat.system_status) == (PLANE_AUTO, 128, STANDBY)


def test_without_thrust_a_px4_comes_down_in_its_mission_and_stays_armed(fly):
    """r2, agent 3: 3.3 m/s at half the speed; "Landing detected", ON_GROUND, armed, AUTO, ACTIVE."""
    flight = fly("px4", "engine", 60.0, speed_m_s=11.4)
    at_20 = next(m for t_s, m in flight.heard if m.get_type() == "VFR_HUD" and t_s > 20.0)
    assert at_20.climb == pytest.approx(-3.3, abs=0.3)
    down_s = flight.first("GLOBAL_POSITION_INT", lambda m: m.relative_alt < 100)
    landed_s = flight.first("EXTENDED_SYS_STATE", lambda m: m.landed_state == 1)
    assert flight.text("Landing detected") - down_s == pytest.approx(2.5, abs=1.2)
    assert landed_s - down_s == pytest.approx(3.5, abs=2.0)
    beat = flight.last("HEARTBEAT")
    assert (beat.custom_mode, beat.base_mode & 128, beat.system_status) == (PX4_AUTO, 128, ACTIVE)
    assert flight.last("MISSION_CURRENT").mission_state == 3


def test_an_arduplane_without_a_fix_flies_on_without_a_word(fly):
    """A6, agent 3: the health bit at once, the estimate without an absolute position after 10 s, no text."""
    flight = fly("ardupilot", "gps", 40.0, lasts_s=22.0)
    assert 0.0 <= flight.lost_bit(GPS) <= 1.1
    assert 0.0 <= flight.first("GPS_RAW_INT", lambda m: m.fix_type == 1) <= 1.1
    assert flight.first("EKF_STATUS_REPORT", lambda m: m.flags == 0x12F) == pytest.approx(10.0, abs=1.1)
    assert (flight.texts(), [mode for _, mode in flight.modes()][1:]) == ([], [])
    assert flight.last("GPS_RAW_INT").fix_type == 3
    assert flight.last("EKF_STATUS_REPORT").flags == 0x33F


def test_a_px4_without_a_fix_flies_on_without_a_word(fly):
    """r2, agent 1: no receiver at once, dropped from SYS_STATUS after 7.5 s, position control after 33 s."""
    flight = fly("px4", "gps", 40.0)
    assert flight.first("GPS_RAW_INT", lambda m: (m.fix_type, m.satellites_visible) == (0, 0)) <= 1.1
    assert flight.lost_bit(GPS) is None
    assert flight.lost_bit(GPS, "onboard_control_sensors_present") == pytest.approx(7.5, abs=1.1)
    assert flight.lost_bit(0x4000) == pytest.approx(33.0, abs=1.1)
    assert (flight.texts(), [mode for _, mode in flight.modes()]) == ([], [PX4_AUTO])


def test_a_jump_of_the_position_reaches_the_reports_of_an_arduplane_after_four_seconds(fly):
    """A6, agent 2: the receiver jumps at once, the estimate rejects it and then follows; back at its end."""
    flight = fly("ardupilot", "glitch", 20.0, lasts_s=10.5)
    north_m = [(t_s, m.lat) for t_s, m in flight.heard if m.get_type() == "GLOBAL_POSITION_INT"]
    jumps = [
        t_s for (t_s, lat), (_, before) in zip(north_m[1:], north_m, strict=False) if abs(lat - before) > 9e3
    ]
    assert jumps[0] == pytest.approx(3.9, abs=1.1)
    assert flight.text("AHRS: DCM active") == pytest.approx(3.9, abs=0.2)
    assert flight.text("AHRS: EKF3 active") == pytest.approx(10.5, abs=0.2)
    assert flight.first("EKF_STATUS_REPORT", lambda m: m.flags & 0x8000) == pytest.approx(2.0, abs=1.1)
    assert flight.lost_bit(AHRS) == pytest.approx(4.0, abs=1.1)


def test_an_arduplane_without_radio_control_returns_after_the_long_failsafe(fly):
    """A6, agent 5: 1.2 s short, AUTO and CRITICAL; 6.5 s long, RTL."""
    flight = fly("ardupilot", "rc", 20.0, FS_LONG_ACTN=1)
    assert flight.text("Throttle failsafe on") == pytest.approx(1.2, abs=0.2)
    assert flight.text("RC Short Failsafe On") == pytest.approx(1.2, abs=0.2)
    assert flight.text("RC Long Failsafe On: RTL") == pytest.approx(6.5, abs=0.2)
    assert flight.first("HEARTBEAT", lambda m: m.system_status == CRITICAL) == pytest.approx(1.6, abs=1.0)
    assert flight.modes()[-1] == (pytest.approx(7.0, abs=1.0), PLANE_RTL)
    assert flight.lost_bit(RC) == pytest.approx(1.6, abs=1.0)


def test_a_px4_with_an_empty_battery_holds_then_lands_where_it_is(fly):
    """r2, agent 2: warning, Hold for 5 s, LAND; 83 m in 97 s; disarmed, AUTO is shown again."""
    flight = fly("px4", "battery", 190.0, COM_LOW_BAT_ACT=2)
    low_s, hold_s = flight.text("Low battery"), flight.text("Failsafe activated: entering Hold for 5 seconds")
    land_s, landed_s = flight.text("Failsafe activated"), flight.text("Landing detected")
    assert 0.0 <= low_s < hold_s
    assert land_s - hold_s == pytest.approx(5.4, abs=0.5)
    assert landed_s - land_s == pytest.approx(97.5, abs=12.0)
    assert flight.text("Disarmed by landing") - landed_s == pytest.approx(2.3, abs=0.5)
    assert [mode for _, mode in flight.modes()] == [PX4_AUTO, PX4_HOLD, PX4_LAND, PX4_AUTO]
    charges = [m.charge_state for _, m in flight.heard if m.get_type() == "BATTERY_STATUS"]
    assert sorted(set(charges)) == [1, 2, 3, 4]
    beat = flight.last("HEARTBEAT")
    assert (beat.base_mode & 128, beat.system_status) == (0, STANDBY)
    assert flight.lost_bit(BATTERY) is not None


def test_a_px4_that_landed_for_a_failsafe_takes_off_with_its_mission_when_armed(fly):
    flight = fly("px4", "battery", 190.0, lasts_s=170.0, COM_LOW_BAT_ACT=2)
    g = flight.ground
    assert g.vehicle.is_down
    assert g.command(ARM, 1)[0] == 0
    g.fly(10.0)
    assert g.vehicle.alt_rel_m > 20.0
    assert not g.vehicle.is_down


def test_a_px4_returns_before_it_lands_when_it_is_told_to(fly):
    flight = fly("px4", "battery", 70.0, COM_LOW_BAT_ACT=3)
    assert [mode for _, mode in flight.modes()] == [PX4_AUTO, PX4_HOLD, PX4_RTL, PX4_LAND]


def test_a_px4_without_radio_control_holds_then_returns(fly):
    flight = fly("px4", "rc", 20.0)
    assert [mode for _, mode in flight.modes()] == [PX4_AUTO, PX4_HOLD, PX4_RTL]
    assert flight.texts()[0] == "Failsafe activated: entering Hold for 5 seconds", "no text names the cause"
    assert flight.lost_bit(RC) <= 1.6
    assert flight.lost_bit(RC, "onboard_control_sensors_present") <= 1.6
    assert flight.lost_bit(RC, "onboard_control_sensors_enabled") is None


def test_a_px4_in_rtl_over_a_mission_landing_flies_a_mission_that_arrives(fly, item):
    """r5: RTL, "climb to"; then a mission is stored and its first item flown, in RTL."""
    flight = fly("px4", "gps", 1.0, items=[(900.0, 0.0), (0.0, 500.0, LAND)], RTL_RETURN_ALT=120.0)
    g = flight.ground
    g.heard.clear()
    g.command(SET_MODE, 1, 4, 5)
    texts = [m.text.rstrip("\t") for m in g.heard if m.get_type() == "STATUSTEXT"]
    assert texts == ["Executing Mission", "RTL Mission land: climb to 190 m"]
    rows = [item(0, 20_000.0, 0.0, 90.0), item(1, 0.0, 500.0, 0.0, command=LAND)]
    replies = g.send(mavlink.MAVLink_mission_count_message(7, 1, 2, 0))
    while replies[-1].get_type() == "MISSION_REQUEST_INT":
        replies = g.send(rows[replies[-1].seq])
    g.send(mavlink.MAVLink_mission_set_current_message(7, 1, 0))
    before_m = g.vehicle.east_m
    heard = g.fly(30.0)
    assert g.vehicle.east_m - before_m > 300.0, "it flies to the target, not home"
    beat = [m for m in heard if m.get_type() == "HEARTBEAT"][-1]
    current = [m for m in heard if m.get_type() == "MISSION_CURRENT"][-1]
    assert beat.custom_mode == PX4_RTL
    assert (current.seq, current.mission_state, current.mission_mode) == (0, 2, 2)


def test_a_px4_in_rtl_over_a_mission_landing_lands_there(fly):
    flight = fly("px4", "gps", 1.0, items=[(900.0, 0.0), (0.0, 500.0, LAND)], RTL_RETURN_ALT=60.0)
    g = flight.ground
    g.command(SET_MODE, 1, 4, 5)
    heard = g.until(lambda: not g.vehicle.autopilot.armed)
    assert abs(g.vehicle.north_m - 500.0) < 100.0
    assert not g.vehicle.is_down, "it landed where it was meant to"
    states = [m.landed_state for m in heard if m.get_type() == "EXTENDED_SYS_STATE"]
    assert 4 in states


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_beyond_its_fence_a_vehicle_returns_with_the_firmware_s_words(fly, autopilot):
    """Recorded: ArduPlane clears a health bit, with a text of severity NOTICE; PX4 has the text alone."""
    flight = fly(autopilot, "fence", 10.0, GF_ACTION=3)
    px4_text = "Geofence: exceeding maximum altitude above Home"
    assert flight.text(px4_text if autopilot == "px4" else "Max Alt fence breached") <= 0.2
    expected = [PX4_AUTO, PX4_HOLD, PX4_RTL] if autopilot == "px4" else [PLANE_AUTO, PLANE_RTL]
    assert [mode for _, mode in flight.modes()][-len(expected) :] == expected
    lost_s = flight.lost_bit(mavlink.MAV_SYS_STATUS_GEOFENCE)
    assert (lost_s is None) if autopilot == "px4" else lost_s <= 1.1


def test_an_arduplane_disables_a_blocked_airspeed_sensor_and_calls_it_healthy(fly):
    """Recorded: the text after 4 s; then the sensor is not enabled, which no health bit shows."""
    flight = fly("ardupilot", "airspeed", 8.0)
    assert flight.text("Airspeed sensor 1 failure. Disabling") == pytest.approx(4.0, abs=0.2)
    assert flight.lost_bit(AIRSPEED, "onboard_control_sensors_enabled") == pytest.approx(4.6, abs=0.7)
    assert flight.lost_bit(AIRSPEED) is None
    assert flight.last("VFR_HUD").airspeed == 1.0


def test_a_blocked_airspeed_sensor_of_a_px4_shows_in_the_health(fly):
    """Recorded: the health bit, an airspeed that is no number, and a text after 1 s."""
    flight = fly("px4", "airspeed", 5.0)
    assert flight.lost_bit(AIRSPEED) <= 1.1
    assert flight.first("VFR_HUD", lambda m: math.isnan(m.airspeed)) <= 1.1
    assert flight.text("Preflight Fail: Airspeed invalid") == pytest.approx(1.1, abs=0.2)


def test_a_silent_radio_sends_and_hears_nothing_and_comes_back(fly):
    flight = fly("ardupilot", "radio", 20.0, lasts_s=10.0)
    times = [t_s for t_s, _ in flight.heard]
    assert not [t_s for t_s in times if 0.2 < t_s < 9.9]
    assert flight.last("HEARTBEAT").base_mode & 128
    assert times[-1] > 19.0
