"""Traits of the simulated autopilots: modes and what differs between ArduPlane and PX4.

Sources: ArduPlane's `Mode::Number`; PX4's `px4_custom_mode.h` (main mode in bits 16-23 of `custom_mode`, sub
mode in bits 24-31), `mavlink_mission.cpp` and `navigator`; observations of both. Modes have ArduPlane's names
inside, and parameters are ArduPlane's on both.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink


class Mode(IntEnum):
    """Simulated custom modes of ArduPlane."""

    MANUAL = 0
    CIRCLE = 1
    STABILIZE = 2
    TRAINING = 3
    ACRO = 4
    FBWA = 5
    FBWB = 6
    CRUISE = 7
    AUTO = 10
    RTL = 11
    LOITER = 12
    TAKEOFF = 13
    GUIDED = 15
    LAND = 100
    """PX4 only: circles down where it is."""


_PX4_MODES: Final = {
    Mode.MANUAL: (1, 0),
    Mode.FBWA: (2, 0),
    Mode.FBWB: (3, 0),
    Mode.ACRO: (5, 0),
    Mode.GUIDED: (6, 0),
    Mode.STABILIZE: (7, 0),
    Mode.TAKEOFF: (4, 2),
    Mode.LOITER: (4, 3),
    Mode.AUTO: (4, 4),
    Mode.RTL: (4, 5),
    Mode.LAND: (4, 6),
}
_PX4_MODE_OF: Final = {numbers: mode for mode, numbers in _PX4_MODES.items()}
_POSITION_CONTROL: Final = (3, 0)


@dataclass(frozen=True, slots=True)
class AutopilotTraits:
    """Differences of one autopilot that a ground station sees."""

    name: str
    mav_autopilot: int
    home_items: int
    """1: item 0 of a mission is home."""
    atomic: bool
    """True if a mission is replaced as a whole, and then flown from its marked item at once."""
    ends_in: Mode
    """Mode after the last item."""
    has_set_current_command: bool
    """True if it accepts DO_SET_MISSION_CURRENT."""
    glide_ratio: float
    """Of its simulated aeroplane without thrust, at half the cruising speed."""

    def custom_mode(self, mode: Mode) -> int:
        """Return the `custom_mode` of a HEARTBEAT."""
        if self is not PX4:
            return int(mode)
        main, sub = _PX4_MODES.get(mode, _POSITION_CONTROL)
        return (main << 16) | (sub << 24)

    def mode_of_numbers(self, main: int, sub: int) -> Mode | None:
        """Return the mode of DO_SET_MODE's parameters 2 and 3; None if there is none."""
        if self is PX4:
            return _PX4_MODE_OF.get((main, sub))
        return Mode(main) if main in Mode._value2member_map_ and main != Mode.LAND else None

    def mode_of_custom(self, custom_mode: int) -> Mode | None:
        """Return the mode of SET_MODE's `custom_mode`; None if there is none."""
        if self is PX4:
            return self.mode_of_numbers((custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF)
        return self.mode_of_numbers(custom_mode, 0)


ARDUPLANE: Final = AutopilotTraits(
    "ardupilot", mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 1, False, Mode.RTL, True, 4.3
)
PX4: Final = AutopilotTraits("px4", mavlink.MAV_AUTOPILOT_PX4, 0, True, Mode.LOITER, False, 1.75)
TRAITS: Final = {traits.name: traits for traits in (ARDUPLANE, PX4)}
