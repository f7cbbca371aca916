"""Flight modes by name, per autopilot.

Sources: ArduPlane `Mode::Number` (https://ardupilot.org/plane/docs/parameters.html, FLTMODE1) and PX4
`px4_custom_mode.h`, where the main mode lies in bits 16-23 of `custom_mode` and the sub mode in bits 24-31.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

ARDUPILOT: Final = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
PX4: Final = dialect.MAV_AUTOPILOT_PX4

AUTO = "AUTO"
LOITER = "LOITER"
RTL = "RTL"

_ARDUPLANE: Final = {
    0: "MANUAL",
    1: "CIRCLE",
    2: "STABILIZE",
    3: "TRAINING",
    4: "ACRO",
    5: "FBWA",
    6: "FBWB",
    7: "CRUISE",
    8: "AUTOTUNE",
    10: AUTO,
    11: RTL,
    12: LOITER,
    13: "TAKEOFF",
    14: "AVOID_ADSB",
    15: "GUIDED",
    16: "INITIALISING",
    17: "QSTABILIZE",
    18: "QHOVER",
    19: "QLOITER",
    20: "QLAND",
    21: "QRTL",
    22: "QAUTOTUNE",
    23: "QACRO",
    24: "THERMAL",
    25: "LOITER_ALT_QLAND",
    26: "AUTOLAND",
}
_PX4_MAIN: Final = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
}
_PX4_AUTO: Final = {
    1: "READY",
    2: "TAKEOFF",
    3: LOITER,
    4: AUTO,
    5: RTL,
    6: "LAND",
    8: "FOLLOW",
    9: "PRECLAND",
}
_PX4_MAIN_AUTO: Final = 4


def mode_name(autopilot: int, custom_mode: int) -> str:
    """Name of a heartbeat's mode; the same word for the same behaviour on every autopilot."""
    if autopilot == PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        name = _PX4_AUTO.get(sub) if main == _PX4_MAIN_AUTO else _PX4_MAIN.get(main)
    else:
        name = _ARDUPLANE.get(custom_mode)
    return name if name is not None else f"MODE({custom_mode})"


def mode_numbers(autopilot: int, name: str) -> tuple[int, int]:
    """Return (main, sub) mode for parameters 2 and 3 of MAV_CMD_DO_SET_MODE.

    Raises
    ------
    KeyError
        The autopilot has no such mode.
    """
    if autopilot == PX4:
        pairs = {known: (_PX4_MAIN_AUTO, sub) for sub, known in _PX4_AUTO.items()}
        pairs |= {known: (main, 0) for main, known in _PX4_MAIN.items()}
        return pairs[name]
    return {known: (number, 0) for number, known in _ARDUPLANE.items()}[name]
