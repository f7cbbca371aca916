"""Real firmware breaks where the scenario says so; else an untested failsafe passes for a tested one."""

from __future__ import annotations

import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.errors import ConfigError, SimulationError
from gcs.geo import LocalFrame
from sim_vehicles.autopilots.firmware import px4_command
from sim_vehicles.autopilots.firmware_faults import PLANE, PX4, injection_messages, receiver_message
from sim_vehicles.vehicle.faults import Fault, FaultKind, fault_changes, parse_fault
from sim_vehicles.vehicle.vehicle import VehicleSpec
from sim_vehicles.world.scenario import load, with_faults

FRAME = LocalFrame(33.2, -87.6, 70.0)


def test_every_kind_of_fault_can_be_injected_into_both_firmwares():
    assert set(PLANE) == set(PX4) == set(FaultKind)


def test_an_engine_of_an_arduplane_stops_as_its_throttle_servo_does_and_runs_again():
    """SIM_ENGINE_FAIL 4 stopped no engine where it is the number of a servo."""
    begins, ends = (injection_messages(3, False, FaultKind.ENGINE, begins) for begins in (True, False))
    assert {m.param_id: m.param_value for m in begins} == {"SERVO3_MIN": 1000.0, "SERVO3_MAX": 1000.0}
    assert {m.param_id: m.param_value for m in ends} == {"SERVO3_MAX": 2000.0}
    assert {m.target_system for m in begins} == {3}


def test_a_px4_loses_its_gps_as_its_simulated_receiver_has_no_satellites():
    """PX4 refuses an INT32 parameter in a float, and its GPS simulation knows no injected failure."""
    (begins,) = injection_messages(3, True, FaultKind.GPS, True)
    (ends,) = injection_messages(3, True, FaultKind.GPS, False)
    assert (begins.param_id, begins.param_type) == ("SIM_GPS_USED", mavlink.MAV_PARAM_TYPE_INT32)
    assert [struct.pack("<f", m.param_value) for m in (begins, ends)] == [bytes(4), struct.pack("<i", 10)]


def test_a_receiver_of_a_px4_jumps_by_200_m_and_keeps_its_velocity():
    truth = mavlink.MAVLink_hil_state_quaternion_message(
        5, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 332_000_000, -876_000_000, 150_000, 0, -1200, 10, 0, 0, 0, 0, 0
    )
    fix = receiver_message(truth, has_fix=True, glitches=True)
    assert receiver_message(truth, has_fix=True, glitches=False).lat == truth.lat
    assert receiver_message(truth, has_fix=False, glitches=False).fix_type == mavlink.GPS_FIX_TYPE_NO_FIX
    assert (fix.lat - truth.lat) * 1e-7 * 111_320.0 == pytest.approx(200.0, abs=1.0)
    assert (fix.lon, fix.alt, fix.vn, fix.ve, fix.vd) == (truth.lon, 150_000, 0, -1200, 10)
    assert (fix.fix_type, fix.vel, fix.cog) == (mavlink.GPS_FIX_TYPE_3D_FIX, 1200, 27_000)


@pytest.mark.parametrize(
    ("kind", "name"), [(FaultKind.GLITCH, "MAV_USEHILGPS"), (FaultKind.RC, "COM_RC_IN_MODE")]
)
def test_a_px4_is_started_so_that_its_host_can_be_its_receiver_or_its_radio_control(tmp_path, kind, name):
    for faults, wanted in (((Fault(kind, 5.0),), "1"), ((), None)):
        spec = VehicleSpec(3, 0, 0, 0, 90.0, 15.0, faults=faults)
        _, environment = px4_command(tmp_path / "bin" / "px4", spec, FRAME, 0, 1.0, tmp_path)
        assert environment.get(f"PX4_PARAM_{name}") == wanted


def test_faults_begin_and_end_at_their_times_and_a_crash_never_ends():
    faults = (Fault(FaultKind.GPS, 5.0, 3.0), Fault(FaultKind.CRASH, 6.0, 1.0))
    changes = [(c.t_ns / 1e9, c.kind.value, c.begins) for c in reversed(fault_changes(faults, 0))]
    assert changes == [(5.0, "gps", True), (6.0, "crash", True), (8.0, "gps", False)]


def test_a_fault_is_named_on_the_command_line():
    assert parse_fault("engine:2@40") == (2, Fault(FaultKind.ENGINE, 40.0))
    assert parse_fault("gps:3@40.5+12") == (3, Fault(FaultKind.GPS, 40.5, 12.0))


@pytest.mark.parametrize("text", ["engine", "engine:2", "wing:2@40", "engine:2@x", "engine:2@4+"])
def test_a_mistyped_fault_is_refused_with_the_right_form(text):
    with pytest.raises(SimulationError, match="KIND:VEHICLE@SECONDS"):
        parse_fault(text)


def test_faults_of_the_command_line_add_to_those_of_the_scenario():
    scenario = with_faults(load("deterministic"), ["engine:2@40", "gps:3@50+10"])
    assert [(f.system_id, f.kind) for f in scenario.simulation.faults] == [(2, "engine"), (3, "gps")]
    with pytest.raises(ConfigError, match="none of the agents"):
        with_faults(scenario, ["engine:99@40"])
