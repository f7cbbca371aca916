"""Mission of one vehicle as a `.plan` of QGroundControl: mission items, fence and rally points.

Format: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html. Home is not among the
items: QGroundControl puts it before them for ArduPilot itself. A parameter that is NaN is null.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.fence import Fence, Rally
from gcs.mavlink.autopilots.profile import AutopilotProfile
from gcs.mavlink.mission.geofence_rally import fence_from_items, fence_items, rally_items
from gcs.mavlink.mission.items import Home, Item

_RELATIVE: Final = 1
_ABSOLUTE: Final = 2
_ALTITUDE_MODES: Final = {
    dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT: _RELATIVE,
    dialect.MAV_FRAME_GLOBAL: _ABSOLUTE,
}
"""`AltitudeMode` of QGroundControl, by frame."""


def plan_document(
    profile: AutopilotProfile,
    items: Sequence[Item],
    home: Home,
    speed_m_s: float,
    fence: Fence,
    rally: Sequence[Rally],
) -> dict[str, Any]:
    """Return the content of a `.plan`.

    Parameters
    ----------
    items : sequence of Item
        Mission as it is uploaded, with home where the firmware keeps it.
    """
    flown = items[profile.home_items :]
    return {
        "fileType": "Plan",
        "geoFence": _fence(fence),
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": speed_m_s,
            "firmwareType": profile.autopilot,
            "globalPlanAltitudeMode": _ALTITUDE_MODES[flown[0].frame],
            "hoverSpeed": speed_m_s,
            "items": [_simple_item(item, number) for number, item in enumerate(flown, start=1)],
            "plannedHomePosition": [home.lat_deg, home.lon_deg, home.alt_msl_m],
            "vehicleType": dialect.MAV_TYPE_FIXED_WING,
            "version": 2,
        },
        "rallyPoints": {
            "points": [[*_degrees(item), item.z_m] for item in rally_items(rally)],
            "version": 2,
        },
        "version": 1,
    }


def _simple_item(item: Item, number: int) -> dict[str, Any]:
    params = (item.param1, item.param2, item.param3, item.param4, *_degrees(item), item.z_m)
    return {
        "AMSLAltAboveTerrain": None,
        "Altitude": item.z_m,
        "AltitudeMode": _ALTITUDE_MODES[item.frame],
        "autoContinue": bool(item.autocontinue),
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        "params": [None if math.isnan(value) else value for value in params],
        "type": "SimpleItem",
    }


def _fence(fence: Fence) -> dict[str, Any]:
    """Return the areas as vehicles store them: vertices in 1e-7 degrees."""
    stored = fence_from_items(fence_items(fence))
    areas = () if stored is None else stored.areas
    return {
        "circles": [
            {
                "circle": {"center": _rounded(area.centre_deg), "radius": area.radius_m},
                "inclusion": area.stay_in,
                "version": 1,
            }
            for area in areas
            if not area.corners_deg
        ],
        "polygons": [
            {
                "inclusion": area.stay_in,
                "polygon": [_rounded(corner) for corner in area.corners_deg],
                "version": 1,
            }
            for area in areas
            if area.corners_deg
        ],
        "version": 2,
    }


def _degrees(item: Item) -> list[float]:
    return _rounded((item.x * 1e-7, item.y * 1e-7))


def _rounded(place_deg: tuple[float, float]) -> list[float]:
    return [round(value, 7) for value in place_deg]
