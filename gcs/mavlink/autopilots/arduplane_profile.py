"""Profile of ArduPlane: modes, mission items, limits, return, and the texts of its failsafes.

Sources: ArduPilot's `AP_Mission` (stored fields of an item, and their precision), `Mode::Number`
(https://ardupilot.org/plane/docs/parameters.html, FLTMODE1), and tests with ArduPlane 4.7.

* Item 0 is home. Without it the first item is lost.
* An upload is in place: MISSION_COUNT truncates at once, each item replaces the one before.
* Items are requested with MISSION_REQUEST and sent as MISSION_ITEM_INT. The next item is stored without a
  request; any other gets ACK 13. A download may request items in any order, and is denied during an upload.
* Latitude and longitude are exact. Height is kept in centimetres; frame 6 returns as 3, NaN as 0.
  NAV_WAYPOINT keeps its acceptance radius in whole metres up to 255 and loses hold time and yaw.
  NAV_LOITER_UNLIM keeps its radius, NAV_LOITER_TIME the side of its turns only, NAV_TAKEOFF its pitch in
  whole degrees, NAV_LAND its abort height.
* The current waypoint is cached: MISSION_SET_CURRENT makes the vehicle take the new one, on a leg from its
  position. DO_SET_MISSION_CURRENT does so on a leg from the waypoint before, unless sent twice.
* At a mission's end, and in AUTO without a mission, it returns to launch.
* A failsafe changes the mode at the time of its text; HEARTBEAT is sent at once (`Plane::set_mode`). It shows
  MAV_STATE_CRITICAL as long as the cause lasts, for an empty battery also when nothing is done about it, for
  a breached fence not at all (`Plane::any_failsafe_triggered`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from ctypes import c_float
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.modes import AUTO, INITIALISING, LOITER, RTL
from gcs.mavlink.autopilots.preflight_parameters import ARDUPLANE_PARAMETERS, arduplane_parameters_for
from gcs.mavlink.autopilots.profile import AutopilotProfile, FailsafeText, FenceLimits, PossibleReturn
from gcs.mavlink.mission.items import Item

_MAX_RADIUS_M: Final = 255.0

_MODES: Final = {
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
    16: INITIALISING,
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

_ALERT: Final[int] = dialect.MAV_SEVERITY_ALERT
_WARNING: Final[int] = dialect.MAV_SEVERITY_WARNING
_NOTICE: Final[int] = dialect.MAV_SEVERITY_NOTICE
_FAILSAFE_MODES: Final = frozenset(
    {RTL, "CIRCLE", "FBWA", "FBWB", "AUTOLAND", "QLAND", "QRTL", "LOITER_ALT_QLAND"}
)
_FAILSAFE_TEXTS: Final = (
    FailsafeText(re.compile("Throttle failsafe on"), _WARNING),
    FailsafeText(re.compile("RC Short Failsafe On"), _WARNING),
    FailsafeText(re.compile("RC Short Failsafe: switched to"), _WARNING, _FAILSAFE_MODES),
    FailsafeText(re.compile("(RC Long|GCS) Failsafe On"), _WARNING, _FAILSAFE_MODES),
    FailsafeText(re.compile("GCS Failsafe Off"), _WARNING, frozenset({RTL, "CIRCLE", "AUTOLAND"}), ends=True),
    FailsafeText(re.compile(r"Battery \d+ is (low|critical)"), _WARNING, _FAILSAFE_MODES),
    FailsafeText(re.compile(r"[\w ]*fences? breached", re.IGNORECASE), _NOTICE, frozenset({RTL, "GUIDED"})),
    FailsafeText(
        re.compile("Avoid: Performing action"),
        _ALERT,
        frozenset({RTL, LOITER, "AVOID_ADSB", "GUIDED", "QLOITER"}),
    ),
)
"""From `events.cpp`, `radio.cpp`, `fence.cpp`, `avoidance_adsb.cpp` and `AP_BattMonitor.cpp`."""


def _stored(item: Item) -> Item:
    match item.command:
        case dialect.MAV_CMD_NAV_WAYPOINT:
            radius_m = min(_MAX_RADIUS_M, _whole(item.param2, _MAX_RADIUS_M))
            return item._replace(param1=0.0, param2=radius_m, param4=0.0)
        case dialect.MAV_CMD_NAV_LOITER_UNLIM:
            return item._replace(param1=0.0, param2=0.0, param4=0.0)
        case dialect.MAV_CMD_NAV_LOITER_TIME:
            side = math.copysign(1.0, item.param3)
            tangent = float(item.param4 > 0.0)
            return item._replace(param1=_whole(item.param1, 0.0), param2=0.0, param3=side, param4=tangent)
        case dialect.MAV_CMD_NAV_TAKEOFF | dialect.MAV_CMD_NAV_LAND:
            return item._replace(param1=_whole(item.param1, 0.0), param2=0.0, param3=0.0, param4=0.0)
    return item


def _whole(value: float, otherwise: float) -> float:
    """Return the whole part of a parameter as received, a float32; `otherwise` if it is not finite."""
    received = c_float(value).value
    return float(int(received)) if math.isfinite(received) else otherwise


def _fence_limits(values: Mapping[str, float]) -> FenceLimits:
    """FENCE_TYPE: bit 0 maximum altitude, bit 1 circle around home, bit 2 polygons and circles."""
    kinds = int(values.get("FENCE_TYPE", 0))
    return FenceLimits(
        is_on=values.get("FENCE_ENABLE", 0) > 0,
        polygons=bool(kinds & 4),
        max_alt_rel_m=values.get("FENCE_ALT_MAX") if kinds & 1 else None,
        max_radius_m=values.get("FENCE_RADIUS") if kinds & 2 else None,
    )


def _return_heights(values: Mapping[str, float], rally_m: Sequence[float]) -> list[PossibleReturn]:
    """Return the nearest rally point's height; RTL_ALTITUDE with none within RALLY_LIMIT_KM.

    Source: `Plane::do_RTL`, `AP_Rally::calc_best_rally_or_home_location`. A negative RTL_ALTITUDE keeps the
    height.
    """
    found = [PossibleReturn(max(rally_m))] if rally_m else []
    for name, units_per_m in (("RTL_ALTITUDE", 1.0), ("ALT_HOLD_RTL", 100.0)):
        height_m = values.get(name, 0.0) / units_per_m
        if height_m > 0.0:
            found.append(PossibleReturn(height_m, name))
    return found


ARDUPLANE: Final = AutopilotProfile(
    name="ArduPlane",
    autopilot=dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
    home_items=1,
    atomic=False,
    window=6,
    in_order=False,
    tracks_old_leg=True,
    climbs_first=False,
    widens_circles=True,
    marks_current=False,
    ends_in=RTL,
    unused=0.0,
    min_radius_m=1.0,  # less is stored as 0, which means the default of 90 m
    takeoff_pitch_deg=15.0,
    modes={(number, 0): name for number, name in _MODES.items()},
    split_mode=lambda custom_mode: (custom_mode, 0),
    critical_ends=False,
    failsafe_modes=_FAILSAFE_MODES,
    failsafe_texts=_FAILSAFE_TEXTS,
    stored=_stored,
    parameters=ARDUPLANE_PARAMETERS,
    fits=arduplane_parameters_for,
    altitude_reference_parameter="",
    modes_without_altitude=frozenset(),
    fence_parameters=("FENCE_ENABLE", "FENCE_TYPE", "FENCE_ALT_MAX", "FENCE_RADIUS"),
    fence_limits=_fence_limits,
    ceiling_parameter="FENCE_ALT_MAX",
    return_parameters=("RTL_ALTITUDE", "ALT_HOLD_RTL"),
    return_circle_parameter="",
    radius_parameters=("WP_LOITER_RAD", "RTL_RADIUS"),
    return_heights=_return_heights,
)
"""Profile of ArduPlane, tested with 4.7."""
