"""Geofences and rally points as items of the mission protocol, and the comparison of what was read back.

Sources: https://mavlink.io/en/services/mission.html (geofence and rally plans), ArduPilot's
`MissionItemProtocol_Fence` and `_Rally`.

* A polygon is one item per vertex, in sequence, with the number of vertices in param1.
* Frame and height of a fence item are unused; ArduPilot returns zeros.
* ArduPilot keeps the height of a rally point in whole metres above home.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.fence import Area, Fence, Rally
from gcs.mavlink.mission.items import Item

FENCE: Final[int] = dialect.MAV_MISSION_TYPE_FENCE
RALLY: Final[int] = dialect.MAV_MISSION_TYPE_RALLY
LIST_NAMES: Final = {FENCE: "fence", RALLY: "rally"}

_POLYGONS: Final = {
    True: dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    False: dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
}
_CIRCLES: Final = {
    True: dialect.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
    False: dialect.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
}
_STAYS_IN: Final = {command: stay_in for table in (_POLYGONS, _CIRCLES) for stay_in, command in table.items()}
_RADIUS_TOLERANCE_M: Final = 0.01


def fence_items(fence: Fence) -> tuple[Item, ...]:
    """Return the items of a fence. Its ceiling is a parameter of the vehicle, not an item."""
    items = []
    for area in fence.areas:
        if area.corners_deg:
            command = _POLYGONS[area.stay_in]
            count = float(len(area.corners_deg))
            items += [_item(command, *corner, 0.0, count) for corner in area.corners_deg]
        else:
            items.append(_item(_CIRCLES[area.stay_in], *area.centre_deg, 0.0, round(area.radius_m, 2)))
    return tuple(items)


def rally_items(points: Sequence[Rally]) -> tuple[Item, ...]:
    """Return the items of rally points."""
    command = dialect.MAV_CMD_NAV_RALLY_POINT
    frame = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT
    return tuple(
        _item(command, point.lat_deg, point.lon_deg, float(point.alt_rel_m))._replace(frame=frame)
        for point in points
    )


def list_difference(mission_type: int, sent: Sequence[Item], held: Sequence[Item]) -> str:
    """Return the first difference between sent and stored items; empty if equal."""
    if len(sent) != len(held):
        return f"{len(held)} items instead of {len(sent)}"
    for seq, (want, got) in enumerate(zip(sent, held, strict=True)):
        same = (want.command, want.x, want.y) == (got.command, got.x, got.y)
        if mission_type == FENCE:
            same = same and abs(want.param1 - got.param1) <= _RADIUS_TOLERANCE_M
        else:
            same = same and abs(want.z_m - got.z_m) < 1.0
        if not same:
            return f"item {seq} is another one"
    return ""


def fence_from_items(items: Sequence[Item]) -> Fence | None:
    """Return the fence of stored items; None if they are not a valid fence."""
    areas = []
    at = 0
    while at < len(items):
        item = items[at]
        stay_in = _STAYS_IN.get(item.command)
        if stay_in is None:
            if item.command != dialect.MAV_CMD_NAV_FENCE_RETURN_POINT:
                return None
            at += 1
        elif item.command in _CIRCLES.values():
            areas.append(Area(stay_in, (), _degrees(item), item.param1))
            at += 1
        else:
            corners = items[at : at + max(int(item.param1), 1)]
            if len(corners) < 3 or any(corner.command != item.command for corner in corners):
                return None
            areas.append(Area(stay_in, tuple(_degrees(corner) for corner in corners)))
            at += len(corners)
    return Fence(tuple(areas))


def _item(command: int, lat_deg: float, lon_deg: float, z_m: float, param1: float = 0.0) -> Item:
    place = round(lat_deg * 1e7), round(lon_deg * 1e7)
    return Item(command, dialect.MAV_FRAME_GLOBAL, *place, z_m, param1)


def _degrees(item: Item) -> tuple[float, float]:
    return item.x * 1e-7, item.y * 1e-7
