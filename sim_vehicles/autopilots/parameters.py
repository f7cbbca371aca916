"""Parameters of simulated vehicles: ArduPlane's names, types and defaults.

Names and meanings follow ArduPlane 4.6 (https://ardupilot.org/plane/docs/parameters.html). Only those marked
as used change the vehicle's behaviour; the others can be listed, read, set and read back. WP_RADIUS is the
mission's 10 m, not ArduPlane's 90 m. ARMING_DELAY_S is this simulator's own: time after boot in which arming
is refused.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from enum import IntEnum


class Kind(IntEnum):
    """MAV_PARAM_TYPE, as far as ArduPilot uses it."""

    INT8 = 2
    INT16 = 4
    INT32 = 6
    REAL32 = 9


_INTEGER_RANGE = {
    Kind.INT8: (-(2**7), 2**7 - 1),
    Kind.INT16: (-(2**15), 2**15 - 1),
    Kind.INT32: (-(2**31), 2**31 - 1),
}

# name, type, default; "used" = it changes the vehicle's behaviour.
_TABLE: tuple[tuple[str, Kind, float], ...] = (
    ("FORMAT_VERSION", Kind.INT16, 13),
    ("SYSID_THISMAV", Kind.INT16, 1),  # read only: set from the vehicle's system id
    ("SYSID_MYGCS", Kind.INT16, 255),  # used: whose heartbeats feed the failsafe
    ("SYSID_ENFORCE", Kind.INT8, 0),
    ("ARMING_CHECK", Kind.INT32, 1),  # used: 0 skips the pre-arm checks
    ("ARMING_DELAY_S", Kind.REAL32, 20),  # used
    ("ARMING_REQUIRE", Kind.INT8, 1),
    ("WP_RADIUS", Kind.INT16, 10),  # used: acceptance radius of items that name none, metres
    ("WP_LOITER_RAD", Kind.INT16, 60),  # used: metres, negative turns left
    ("WP_MAX_RADIUS", Kind.INT16, 0),
    ("RTL_ALTITUDE", Kind.REAL32, 100),  # used: metres above home, -1 keeps the altitude
    ("RTL_RADIUS", Kind.INT16, 0),  # used: metres, 0 takes WP_LOITER_RAD
    ("RTL_AUTOLAND", Kind.INT8, 0),
    ("TKOFF_ALT", Kind.REAL32, 50),  # used: mode TAKEOFF climbs to this, metres above home
    ("FS_SHORT_ACTN", Kind.INT8, 0),  # used: 0 no change in AUTO, 1 circles
    ("FS_SHORT_TIMEOUT", Kind.REAL32, 1.5),
    ("FS_LONG_ACTN", Kind.INT8, 0),  # used: 0 continues the mission, 1 returns
    ("FS_LONG_TIMEOUT", Kind.REAL32, 5),  # used: seconds
    ("FS_GCS_ENABL", Kind.INT8, 0),  # used: 1 watches the ground station's heartbeat
    ("THR_FAILSAFE", Kind.INT8, 1),  # used: 1 watches the radio control
    ("FENCE_ENABLE", Kind.INT8, 0),
    ("FENCE_TYPE", Kind.INT8, 4),
    ("FENCE_ACTION", Kind.INT8, 1),
    ("FENCE_ALT_MAX", Kind.REAL32, 100),
    ("FENCE_ALT_MIN", Kind.REAL32, -10),
    ("FENCE_RADIUS", Kind.REAL32, 300),
    ("FENCE_MARGIN", Kind.REAL32, 2),
    ("FENCE_TOTAL", Kind.INT8, 0),
    ("FENCE_RET_RALLY", Kind.INT8, 0),
    ("FENCE_RET_ALT", Kind.INT16, 0),
    ("FENCE_AUTOENABLE", Kind.INT8, 0),
    ("FENCE_OPTIONS", Kind.INT16, 1),
    ("RALLY_TOTAL", Kind.INT8, 0),
    ("RALLY_LIMIT_KM", Kind.REAL32, 5),
    ("RALLY_INCL_HOME", Kind.INT8, 0),
    ("MIS_TOTAL", Kind.INT16, 0),
    ("MIS_RESTART", Kind.INT8, 0),
    ("MIS_OPTIONS", Kind.INT16, 0),
    ("AIRSPEED_CRUISE", Kind.REAL32, 15),
    ("AIRSPEED_MIN", Kind.REAL32, 9),
    ("AIRSPEED_MAX", Kind.REAL32, 22),
    ("ALT_SLOPE_MIN", Kind.INT16, 15),  # used: altitude is linear along legs that rise more, metres
    ("TECS_CLMB_MAX", Kind.REAL32, 5),
    ("TECS_SINK_MAX", Kind.REAL32, 5),
    ("ROLL_LIMIT_DEG", Kind.REAL32, 45),
    ("PTCH_LIM_MAX_DEG", Kind.REAL32, 20),
    ("PTCH_LIM_MIN_DEG", Kind.REAL32, -25),
    ("NAVL1_PERIOD", Kind.REAL32, 15),  # used
    ("NAVL1_DAMPING", Kind.REAL32, 0.75),  # used
    ("FLTMODE_CH", Kind.INT8, 8),
    ("FLTMODE1", Kind.INT8, 11),
    ("FLTMODE2", Kind.INT8, 11),
    ("FLTMODE3", Kind.INT8, 5),
    ("FLTMODE4", Kind.INT8, 5),
    ("FLTMODE5", Kind.INT8, 0),
    ("FLTMODE6", Kind.INT8, 0),
    ("INITIAL_MODE", Kind.INT8, 0),
    ("BATT_MONITOR", Kind.INT8, 4),
    ("BATT_LOW_VOLT", Kind.REAL32, 10.5),  # used
    ("BATT_LOW_TIMER", Kind.INT16, 10),  # used: seconds below a voltage until the failsafe
    ("BATT_CRT_VOLT", Kind.REAL32, 0),  # used: 0 for none
    ("BATT_FS_LOW_ACT", Kind.INT8, 0),  # used: 1 returns; 2 flies to the mission's landing, or returns
    ("BATT_FS_CRT_ACT", Kind.INT8, 0),  # used
    ("BATT_CAPACITY", Kind.INT32, 3300),
    ("COMPASS_USE", Kind.INT8, 1),
    ("COMPASS_OFS_X", Kind.REAL32, 5),
    ("COMPASS_OFS_Y", Kind.REAL32, 13),
    ("COMPASS_OFS_Z", Kind.REAL32, -18),
    ("INS_ACCOFFS_X", Kind.REAL32, 0.001),
    ("INS_ACCOFFS_Y", Kind.REAL32, 0.001),
    ("INS_ACCOFFS_Z", Kind.REAL32, 0.001),
    ("GPS1_TYPE", Kind.INT8, 1),
    ("AHRS_EKF_TYPE", Kind.INT8, 3),
    ("EK3_ENABLE", Kind.INT8, 1),
    ("LOG_BITMASK", Kind.INT32, 65535),
    ("SCHED_LOOP_RATE", Kind.INT16, 50),
    ("STAT_BOOTCNT", Kind.INT16, 1),
    ("Q_ENABLE", Kind.INT8, 0),
)
_PX4_TABLE: tuple[tuple[str, Kind, float], ...] = (
    ("MAV_SYS_ID", Kind.INT32, 1),
    ("MIS_TKO_LAND_REQ", Kind.INT32, 0),
    ("NAV_DLL_ACT", Kind.INT32, 0),
    ("NAV_RCL_ACT", Kind.INT32, 2),
    ("COM_DL_LOSS_T", Kind.INT32, 10),
    ("COM_LOW_BAT_ACT", Kind.INT32, 0),
    ("COM_RCL_EXCEPT", Kind.INT32, 0),
    ("RTL_TYPE", Kind.INT32, 1),
    ("RTL_RETURN_ALT", Kind.REAL32, 60),
    ("RTL_DESCEND_ALT", Kind.REAL32, 100),
    ("RTL_LOITER_RAD", Kind.REAL32, 80),
    ("GF_ACTION", Kind.INT32, 2),
    ("GF_MAX_HOR_DIST", Kind.REAL32, 0),
    ("GF_MAX_VER_DIST", Kind.REAL32, 0),
    ("FW_LND_ANG", Kind.REAL32, 5),
    ("FW_R_LIM", Kind.REAL32, 50),
    ("FW_AIRSPD_TRIM", Kind.REAL32, 15),
    ("FW_T_CLMB_R_SP", Kind.REAL32, 3),
    ("FW_T_SINK_R_SP", Kind.REAL32, 2),
    ("FW_T_HRATE_FF", Kind.REAL32, 0.3),
    ("FW_T_ALT_TC", Kind.REAL32, 5),
    ("NAV_ACC_RAD", Kind.REAL32, 10),
    ("NAV_LOITER_RAD", Kind.REAL32, 80),
)
"""Additional parameters of a simulated PX4."""
_READ_ONLY = frozenset({"FORMAT_VERSION", "SYSID_THISMAV", "MIS_TOTAL", "FENCE_TOTAL", "RALLY_TOTAL"})


def _as_float32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


class Parameters:
    """Named values in a fixed order, each rounded to its type and to float32."""

    def __init__(self, px4: bool = False, **values: float) -> None:
        table = _TABLE + _PX4_TABLE if px4 else _TABLE
        self._kinds = {name: kind for name, kind, _ in table}
        self._values = {name: _as_float32(default) for name, _, default in table}
        self._names = tuple(self._values)
        for name, value in values.items():
            self.store(name, value)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __len__(self) -> int:
        return len(self._names)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def name(self, index: int) -> str:
        """Return the name at an index; raises IndexError outside the list."""
        if index < 0:
            raise IndexError(index)
        return self._names[index]

    def index(self, name: str) -> int:
        """Return the index of a name."""
        return self._names.index(name)

    def kind(self, name: str) -> Kind:
        """Return the MAVLink type."""
        return self._kinds[name]

    def request(self, name: str, value: float) -> bool:
        """Set a parameter for a ground station; return False if it is unknown or read-only."""
        if name not in self._values or name in _READ_ONLY or not math.isfinite(value):
            return False
        self.store(name, value)
        return True

    def store(self, name: str, value: float) -> None:
        """Set a known parameter; integers are rounded and clipped, as by ArduPilot."""
        kind = self._kinds[name]
        if kind is not Kind.REAL32:
            low, high = _INTEGER_RANGE[kind]
            value = min(max(round(value), low), high)
        self._values[name] = _as_float32(value)
