"""Faults of real firmware: parameters of the firmwares' own simulations, and a receiver of a false position.

ArduPlane: SIM_* parameters (https://ardupilot.org/dev/docs/sitl-parameters.html), and a throttle servo that
stays where the engine stands. A crash is an elevator that works the wrong way round, without thrust. PX4 with
SIH: MAV_CMD_INJECT_FAILURE reaches motors and the battery only, so other parameters are changed. A scale of
the airspeed is a blocked sensor. The host is the GPS receiver of a PX4 that is to glitch (HIL_GPS), and the
radio control of one that is to lose it (MANUAL_CONTROL). A silent radio is silence of the host.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.services.parameter_protocol import encode_value
from sim_vehicles.vehicle.faults import FaultKind

_GLITCH_DEG: Final = 0.0018
_LOW_CEILING_M: Final = 5.0
_SATELLITES: Final = 10
_BLOCKED_SCALE: Final = 0.08
"""1 m/s of 12 m/s."""
_ACCURACY_CM: Final = 90
_NO_THRUST: Final = {"SIH_F_T_MAX": 0.0, "SIH_T_MAX": 0.0}
"""The failure of a motor that can be injected does not stop SIH's propeller."""
_THRUST_N: Final = 6.0
_NO_THROTTLE: Final = {"SERVO3_MIN": 1000.0, "SERVO3_MAX": 1000.0}
"""SIM_ENGINE_FAIL is the number of a servo in one version of ArduPlane, and a set of them in another."""


class Injection(NamedTuple):
    """Parameters that begin a fault, and those that end it; an int is an INT32 parameter."""

    begins: dict[str, float]
    ends: dict[str, float]


PLANE: Final = {
    FaultKind.CRASH: Injection({"SERVO2_REVERSED": 1.0, **_NO_THROTTLE}, {}),
    FaultKind.ENGINE: Injection(_NO_THROTTLE, {"SERVO3_MAX": 2000.0}),
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
    FaultKind.GPS: Injection({"SIM_GPS_USED": 0}, {"SIM_GPS_USED": _SATELLITES}),
    FaultKind.GLITCH: Injection({}, {}),
    FaultKind.BATTERY: Injection({"SIM_BAT_MIN_PCT": 0.0}, {"SIM_BAT_MIN_PCT": 50.0}),
    FaultKind.RC: Injection({}, {}),
    FaultKind.AIRSPEED: Injection(
        {"ASPD_SCALE_APPLY": 1, "ASPD_SCALE_1": _BLOCKED_SCALE}, {"ASPD_SCALE_APPLY": 2, "ASPD_SCALE_1": 1.0}
    ),
    FaultKind.FENCE: Injection({"GF_MAX_VER_DIST": _LOW_CEILING_M}, {"GF_MAX_VER_DIST": 0.0}),
    FaultKind.RADIO: Injection({}, {}),
}


def injection_messages(system_id: int, px4: bool, kind: FaultKind, begins: bool) -> list[Any]:
    """Return the messages that begin or end a fault."""
    injection = (PX4 if px4 else PLANE)[kind]
    return [
        _set_parameter(system_id, px4, name, value)
        for name, value in (injection.begins if begins else injection.ends).items()
    ]


def _set_parameter(system_id: int, px4: bool, name: str, value: float) -> Any:
    is_int = isinstance(value, int)
    param_type = mavlink.MAV_PARAM_TYPE_INT32 if is_int else mavlink.MAV_PARAM_TYPE_REAL32
    sent = encode_value(value, param_type, px4)
    return mavlink.MAVLink_param_set_message(system_id, 1, name.encode("ascii"), sent, param_type)


def receiver_message(truth: Any, has_fix: bool, glitches: bool) -> Any:
    """Return the HIL_GPS of a receiver, 200 m off if it glitches, from a HIL_STATE_QUATERNION."""
    speed_cm_s = round(math.hypot(truth.vx, truth.vy))
    course_cdeg = round(100.0 * math.degrees(math.atan2(truth.vy, truth.vx))) % 36_000
    lat_e7 = truth.lat + (round(_GLITCH_DEG * 1e7) if glitches else 0)
    return mavlink.MAVLink_hil_gps_message(
        truth.time_usec, mavlink.GPS_FIX_TYPE_3D_FIX if has_fix else mavlink.GPS_FIX_TYPE_NO_FIX, lat_e7,
        truth.lon, truth.alt, _ACCURACY_CM, 2 * _ACCURACY_CM, speed_cm_s, truth.vx, truth.vy, truth.vz,
        course_cdeg, _SATELLITES,
    )  # fmt: skip


def stick_message(system_id: int) -> Any:
    """Return MANUAL_CONTROL with centred sticks: a radio control that PX4 can lose."""
    return mavlink.MAVLink_manual_control_message(system_id, 0, 0, 500, 0, 0)
