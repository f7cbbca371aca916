"""Faults of real firmware: parameters of ArduPilot's simulation, and failure injection of PX4.

ArduPlane: SIM_* parameters (https://ardupilot.org/dev/docs/sitl-parameters.html). A crash is an elevator
that works the wrong way round, without thrust. PX4: MAV_CMD_INJECT_FAILURE with SYS_FAILURE_EN,
SIM_BAT_MIN_PCT, and for a crash an elevator that the controller takes the wrong way round. PX4 cannot
inject a loss of the radio control: the host sends MANUAL_CONTROL, and stops. A silent radio is silence of
the host.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicles.vehicle.faults import FaultKind

_GLITCH_DEG: Final = 0.0018
_LOW_CEILING_M: Final = 5.0
_OFF: Final = mavlink.FAILURE_TYPE_OFF
_STUCK: Final = mavlink.FAILURE_TYPE_STUCK
_NO_THRUST: Final = {"SIH_F_T_MAX": 0.0, "SIH_T_MAX": 0.0}
"""The failure of a motor that can be injected does not stop SIH's propeller."""
_THRUST_N: Final = 6.0


class Injection(NamedTuple):
    """What begins a fault and what ends it: parameters, and PX4's failure unit and type."""

    begins: dict[str, float]
    ends: dict[str, float]
    failure: tuple[int, int] | None = None


PLANE: Final = {
    FaultKind.CRASH: Injection({"SERVO2_REVERSED": 1.0, "SIM_ENGINE_MUL": 0.0, "SIM_ENGINE_FAIL": 4.0}, {}),
    FaultKind.ENGINE: Injection({"SIM_ENGINE_MUL": 0.0, "SIM_ENGINE_FAIL": 4.0}, {"SIM_ENGINE_FAIL": 0.0}),
    FaultKind.GPS: Injection({"SIM_GPS1_ENABLE": 0.0}, {"SIM_GPS1_ENABLE": 1.0}),
    FaultKind.GLITCH: Injection({"SIM_GPS1_GLTCH_X": _GLITCH_DEG}, {"SIM_GPS1_GLTCH_X": 0.0}),
    FaultKind.BATTERY: Injection({"SIM_BATT_VOLTAGE": 10.2}, {"SIM_BATT_VOLTAGE": 12.6}),
    FaultKind.RC: Injection({"SIM_RC_FAIL": 1.0}, {"SIM_RC_FAIL": 0.0}),
    FaultKind.AIRSPEED: Injection({"SIM_ARSPD_FAIL": 1.0}, {"SIM_ARSPD_FAIL": 0.0}),
    FaultKind.FENCE: Injection(
        {"FENCE_TYPE": 1.0, "FENCE_ALT_MAX": _LOW_CEILING_M, "FENCE_ENABLE": 1.0}, {"FENCE_ENABLE": 0.0}
    ),
    FaultKind.RADIO: Injection({}, {}),
}
PX4: Final = {
    FaultKind.CRASH: Injection({"CA_SV_CS1_TRQ_P": -1.0, **_NO_THRUST}, {}),
    FaultKind.ENGINE: Injection(_NO_THRUST, dict.fromkeys(_NO_THRUST, _THRUST_N)),
    FaultKind.GPS: Injection({}, {}, (mavlink.FAILURE_UNIT_SENSOR_GPS, _OFF)),
    FaultKind.GLITCH: Injection({}, {}, (mavlink.FAILURE_UNIT_SENSOR_GPS, _STUCK)),
    FaultKind.BATTERY: Injection({"SIM_BAT_MIN_PCT": 0.0}, {"SIM_BAT_MIN_PCT": 50.0}),
    FaultKind.RC: Injection({}, {}),
    FaultKind.AIRSPEED: Injection({}, {}, (mavlink.FAILURE_UNIT_SENSOR_AIRSPEED, _OFF)),
    FaultKind.FENCE: Injection({"GF_MAX_VER_DIST": _LOW_CEILING_M}, {"GF_MAX_VER_DIST": 0.0}),
    FaultKind.RADIO: Injection({}, {}),
}


def injection_messages(system_id: int, px4: bool, kind: FaultKind, begins: bool) -> list[Any]:
    """Return the messages that begin or end a fault."""
    injection = (PX4 if px4 else PLANE)[kind]
    messages: list[Any] = [
        mavlink.MAVLink_param_set_message(
            system_id, 1, name.encode("ascii"), value, mavlink.MAV_PARAM_TYPE_REAL32
        )
        for name, value in (injection.begins if begins else injection.ends).items()
    ]
    if injection.failure is not None:
        unit, failure_type = injection.failure
        values = (unit, failure_type if begins else mavlink.FAILURE_TYPE_OK, 0, 0, 0, 0, 0)
        messages.append(
            mavlink.MAVLink_command_long_message(system_id, 1, mavlink.MAV_CMD_INJECT_FAILURE, 0, *values)
        )
    return messages


def stick_message(system_id: int) -> Any:
    """Return MANUAL_CONTROL with centred sticks: a radio control that PX4 can lose."""
    return mavlink.MAVLink_manual_control_message(system_id, 0, 0, 500, 0, 0)
