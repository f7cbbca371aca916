"""Profile of PX4 fixed wing: modes, mission items, limits, return, and the texts of its failsafes.

Sources: PX4's `mavlink_mission.cpp`, `px4_custom_mode.h` (`custom_mode`: main mode in bits 16-23, sub mode in
bits 24-31), https://docs.px4.io/main/en/advanced_config/parameter_reference, and tests with PX4 1.17.

* No home item: item 0 is flown.
* An upload is atomic: a second store replaces the first after the last item. ``current`` on an item makes the
  new mission begin there. The same items again change nothing.
* Items are requested with MISSION_REQUEST_INT, again after 250 ms; PX4 gives up after 5 s.
* One transfer at a time: a MISSION_COUNT during one gets ACK 1. MISSION_ACK 15 ends it. A download goes in
  order.
* ACK 0 says that a mission is stored, not that it can be flown. `mission_state` of MISSION_CURRENT is
  NO_MISSION if the navigator rejects it. In the air it then goes to Hold; AUTO is refused.
* NAV_TAKEOFF keeps its yaw only (`parse_mavlink_mission_item`): a pitch reads back as 0.
* There is no DO_SET_MISSION_CURRENT. MISSION_SET_CURRENT has no answer but MISSION_CURRENT.
* Unused parameters are NaN: yaw 0 would be a course to keep. All are kept as floats.
* From Hold to AUTO it climbs first, in a circle where it is, if the current item is higher by NAV_FW_ALT_RAD.
* After the last item it circles in Hold, the same mode as an operator's.
* Altitude control runs from the start on in all modes but MANUAL, STABILIZED and ACRO. Its reference begins
  at 0 m above sea level, before there is a position, and rises by FW_T_CLMB_R_SP (`TECS::initialize`;
  https://github.com/PX4/PX4-Autopilot/pull/27670). Until it is at the vehicle's altitude the vehicle descends
  after its take-off: at 1,546 m with 4 m/s for the first 390 s.
* HEARTBEAT shows MAV_STATE_CRITICAL as long as a failsafe has chosen the mode (`vehicle_status.failsafe`).
  Cause and action come as STATUSTEXT (`HealthAndArmingChecks`, `FailsafeBase::notifyUser`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.autopilots.preflight_parameters import PX4_PARAMETERS, px4_parameters_for
from gcs.mavlink.autopilots.profile import AutopilotProfile, FailsafeText, FenceLimits, PossibleReturn
from gcs.mavlink.mission.items import Item

_MODES: Final = {
    (1, 0): "MANUAL",
    (2, 0): "ALTCTL",
    (3, 0): "POSCTL",
    (5, 0): "ACRO",
    (6, 0): "OFFBOARD",
    (7, 0): "STABILIZED",
    (8, 0): "RATTITUDE",
    (10, 0): "TERMINATION",
    (4, 1): "READY",
    (4, 2): "TAKEOFF",
    (4, 3): LOITER,
    (4, 4): AUTO,
    (4, 5): RTL,
    (4, 6): "LAND",
    (4, 8): "FOLLOW",
    (4, 9): "PRECLAND",
}

_CAUSES: Final = (
    r"(Low|Critical|Emergency) battery|Battery \d+( missing| disconnected|:)|Geofence: |"
    r"Position estimate has low accuracy|"
    r"Connection to (ground station|mission computer) lost|High latency data link lost|"
    r"GNSS (data fusion stopped|signal spoofed)|GPS jamming detected|Maximum flight time reached|"
    r"Compass needs calibration - Land now|GNSS heading not reliable|ESC\d+: |Parachute system lost|"
    r"Remote ID system lost|Mission cannot be completed"
)


def _fence_limits(values: Mapping[str, float]) -> FenceLimits:
    """Return the limits by GF_* parameters; 0 is no limit."""
    return FenceLimits(
        is_on=values.get("GF_ACTION", 0) > 0,
        polygons=True,
        max_alt_rel_m=values.get("GF_MAX_VER_DIST") or None,
        max_radius_m=values.get("GF_MAX_HOR_DIST") or None,
    )


def _return_heights(values: Mapping[str, float], rally_m: Sequence[float]) -> list[PossibleReturn]:
    """Return RTL_RETURN_ALT above the return position (`RTL::findRtlDestination`)."""
    above_m = values.get("RTL_RETURN_ALT")
    if above_m is None:
        return []
    highest_m = max((0.0, *rally_m))
    return [PossibleReturn(highest_m + above_m, "RTL_RETURN_ALT", highest_m)]


def _stored(item: Item) -> Item:
    if item.command == dialect.MAV_CMD_NAV_TAKEOFF:
        return item._replace(param1=0.0, param2=0.0, param3=0.0)
    return item


PX4: Final = AutopilotProfile(
    name="PX4",
    autopilot=dialect.MAV_AUTOPILOT_PX4,
    home_items=0,
    atomic=True,
    window=6,
    in_order=True,
    tracks_old_leg=False,
    climbs_first=True,
    widens_circles=False,
    marks_current=True,
    ends_in=LOITER,
    unused=math.nan,
    min_radius_m=0.1,
    takeoff_pitch_deg=15.0,
    modes=_MODES,
    split_mode=lambda custom_mode: ((custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF),
    critical_ends=True,
    failsafe_modes=frozenset(_MODES.values()) - {AUTO},
    failsafe_texts=(
        FailsafeText(re.compile(_CAUSES), dialect.MAV_SEVERITY_INFO),
        FailsafeText(re.compile("Failsafe activated"), dialect.MAV_SEVERITY_INFO, names_cause=False),
    ),
    stored=_stored,
    parameters=PX4_PARAMETERS,
    fits=px4_parameters_for,
    altitude_reference_parameter="FW_T_CLMB_R_SP",
    modes_without_altitude=frozenset({"MANUAL", "STABILIZED", "ACRO"}),
    fence_parameters=("GF_ACTION", "GF_MAX_VER_DIST", "GF_MAX_HOR_DIST"),
    fence_limits=_fence_limits,
    ceiling_parameter="GF_MAX_VER_DIST",
    return_parameters=("RTL_RETURN_ALT", "RTL_TYPE"),
    return_circle_parameter="RTL_DESCEND_ALT",
    radius_parameters=("NAV_LOITER_RAD", "RTL_LOITER_RAD"),
    return_heights=_return_heights,
)
"""Profile of PX4 as an aeroplane."""
