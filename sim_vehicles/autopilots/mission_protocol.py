"""Storage of missions, fences and rally points, and ArduPlane's side of the MAVLink mission protocol.

ArduPlane differs from the guide (https://mavlink.io/en/services/mission.html):

- Item 0 of a mission is home. An uploaded item 0 is acknowledged and dropped.
- An upload is in place: ``MISSION_COUNT`` truncates at once, and each item replaces the one before. A broken
  upload leaves an inconsistent mission.
- Items are requested with ``MISSION_REQUEST``, again after 1 s, and given up after 8 s with ACK 15. The next
  item is stored without a request; any other gets ACK 13, and the transfer continues.
- During an upload, uploads of other ground stations, read-backs and clearing are refused.
- A read-back has no state: any requested item is sent.
- A read-back is normalised: frame 6 becomes 3, a NaN parameter 0, autocontinue 1. Radii are at most 255 m,
  altitudes are whole centimetres, and ``NAV_WAYPOINT`` loses its hold time.

Fence and rally points are lists under the same protocol, without home.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

MAX_ITEMS = 700
MISSION = 0
FENCE = 1
RALLY = 2
NEVER_NS = 1 << 62

_FRAMES = {0: 0, 5: 0, 3: 3, 6: 3, 10: 10, 11: 10}
_COMMANDS = {
    MISSION: frozenset(
        {
            mavlink.MAV_CMD_NAV_WAYPOINT,
            mavlink.MAV_CMD_NAV_LOITER_UNLIM,
            mavlink.MAV_CMD_NAV_LOITER_TIME,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
            mavlink.MAV_CMD_NAV_LAND,
            mavlink.MAV_CMD_NAV_TAKEOFF,
        }
    ),
    FENCE: frozenset(
        range(mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT, mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION + 1)
    ),
    RALLY: frozenset({mavlink.MAV_CMD_NAV_RALLY_POINT}),
}
_WITHOUT_PLACE = frozenset({mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH})


@dataclass(frozen=True, slots=True)
class Item:
    """One stored item, normalised, with latitude and longitude in 1e-7 degrees."""

    command: int
    frame: int = 3
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    x: int = 0
    y: int = 0
    z: float = 0.0


class Refused(Exception):  # noqa: N818  caught in this module
    """An item cannot be stored; ``result`` is a MAV_MISSION_RESULT."""

    def __init__(self, result: int) -> None:
        self.result = result
        super().__init__(f"MAV_MISSION_RESULT {result}")


def normalised(message: Any, mission_type: int) -> Item:
    """Return the stored part of a MISSION_ITEM_INT or MISSION_ITEM.

    Raises
    ------
    Refused
        For an unsupported frame, command or parameter.
    """
    frame = _FRAMES.get(message.frame)
    if frame is None:
        raise Refused(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if message.command not in _COMMANDS[mission_type]:
        raise Refused(mavlink.MAV_MISSION_UNSUPPORTED)
    p1 = message.param1
    p2 = message.param2
    p3 = message.param3
    p4 = message.param4
    for index, value in enumerate((p1, p2, p3)):
        if not math.isfinite(value):
            raise Refused(mavlink.MAV_MISSION_INVALID_PARAM1 + index)
    p4 = p4 if math.isfinite(p4) else 0.0
    x, y = stored_position(message)
    if not math.isfinite(message.z):
        raise Refused(mavlink.MAV_MISSION_INVALID_PARAM7)
    item = Item(message.command, frame, p1, p2, p3, p4, x, y, round(message.z, 2))
    return _as_ardupilot_packs(item)


def accepted_commands(mission_type: int) -> frozenset[int]:
    """Return the MAV_CMDs of a mission type."""
    return _COMMANDS[mission_type]


def stored_position(message: Any) -> tuple[int, int]:
    """Return latitude and longitude of an item of either message, in 1e-7 degrees.

    Raises
    ------
    Refused
        The position is not on Earth.
    """
    if message.command in _WITHOUT_PLACE:
        return 0, 0
    if not (math.isfinite(message.x) and math.isfinite(message.y)):
        raise Refused(mavlink.MAV_MISSION_INVALID_PARAM5_X)
    scale = 1.0 if message.get_type() == "MISSION_ITEM_INT" else 1e7
    x = round(message.x * scale)
    y = round(message.y * scale)
    if abs(x) > 900_000_000:
        raise Refused(mavlink.MAV_MISSION_INVALID_PARAM5_X)
    if abs(y) > 1_800_000_000:
        raise Refused(mavlink.MAV_MISSION_INVALID_PARAM6_Y)
    return x, y


def _as_ardupilot_packs(item: Item) -> Item:
    """Return the item as ArduPilot's 15 bytes of storage keep it."""
    if item.command == mavlink.MAV_CMD_NAV_WAYPOINT:
        accept, pass_by = (float(min(max(int(p), 0), 255)) for p in (item.param2, item.param3))
        return replace(item, param1=0.0, param2=accept, param3=pass_by, param4=0.0)
    if item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
        radius = math.copysign(min(abs(round(item.param3)), 255), item.param3)
        return replace(item, param1=0.0, param2=0.0, param3=radius, param4=0.0)
    if item.command == mavlink.MAV_CMD_NAV_LOITER_TIME:  # no room for the radius
        side = math.copysign(1.0, item.param3)
        tangent = float(item.param4 > 0.0)
        return replace(item, param1=float(int(item.param1)), param2=0.0, param3=side, param4=tangent)
    if item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
        return replace(item, param1=float(int(item.param1)), param2=0.0, param3=0.0, param4=0.0)
    return item


def to_message(
    item: Item, seq: int, mission_type: int, current: bool, peer: tuple[int, int], as_int: bool
) -> Any:
    """Return the MISSION_ITEM_INT of an item, or the MISSION_ITEM if `as_int` is False."""
    head = (*peer, seq, item.frame, item.command, int(current), 1)
    params = (item.param1, item.param2, item.param3, item.param4)
    if as_int:
        return mavlink.MAVLink_mission_item_int_message(*head, *params, item.x, item.y, item.z, mission_type)
    return mavlink.MAVLink_mission_item_message(
        *head, *params, item.x * 1e-7, item.y * 1e-7, item.z, mission_type
    )


class MissionStore:
    """Stored items of one mission type. Index 0 of a mission is always home."""

    def __init__(self, mission_type: int, home: Callable[[], Item] | None = None) -> None:
        self.mission_type = mission_type
        self._home = home
        self._items: list[Item] = []

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: int) -> Item:
        if index == 0 and self._home is not None and self._items:
            return self._home()
        return self._items[index]

    def __iter__(self) -> Iterator[Item]:
        return (self[index] for index in range(len(self)))

    def truncate(self, count: int) -> None:
        """Keep the first `count` items."""
        del self._items[count:]

    def replace(self, items: list[Item]) -> None:
        """Replace all items."""
        self._items = list(items)

    def put(self, index: int, item: Item) -> None:
        """Replace an item, or append the next one; raises `Refused` for a gap."""
        if index > len(self._items):
            raise Refused(mavlink.MAV_MISSION_ERROR)
        self._items[index : index + 1] = [item]


@dataclass(slots=True)
class _Upload:
    peer: tuple[int, int]
    mission_type: int
    next: int
    last: int
    heard_ns: int
    requested_ns: int


class MissionServer:
    """Vehicle's side of the mission protocol: messages in, messages out, time an argument.

    Parameters
    ----------
    stores : dict
        Store of each mission type.
    send : callable
        Takes one MAVLink message.
    may_clear : callable
        Returns True if the mission may be cleared now; ArduPlane refuses in AUTO.
    cleared : callable
        Called when the mission has been cleared.
    current : callable
        Returns the index of the current item.
    """

    RE_REQUEST_NS = 1_000_000_000
    GIVE_UP_NS = 8_000_000_000

    def __init__(
        self,
        stores: dict[int, MissionStore],
        send: Callable[[Any], None],
        may_clear: Callable[[], bool],
        cleared: Callable[[], None],
        current: Callable[[], int],
    ) -> None:
        self._stores = stores
        self._send = send
        self._may_clear = may_clear
        self._cleared = cleared
        self._current = current
        self._upload: _Upload | None = None

    @property
    def is_busy(self) -> bool:
        """True if a transfer blocks the selection of an item: never on ArduPlane."""
        return False

    @property
    def due_ns(self) -> int:
        """Time of the next action of `handle_timer`."""
        if self._upload is None:
            return NEVER_NS
        return min(self._upload.requested_ns + self.RE_REQUEST_NS, self._upload.heard_ns + self.GIVE_UP_NS)

    def handle_timer(self, t_ns: int) -> None:
        """Request a missing item again, or give up."""
        upload = self._upload
        if upload is None or t_ns < self.due_ns:
            return
        if t_ns >= upload.heard_ns + self.GIVE_UP_NS:
            self._give_up(upload)
        else:
            self._request_item(upload, t_ns)

    def handle(self, message: Any, t_ns: int) -> None:
        """Process one message of the mission protocol for this vehicle."""
        peer = (message.get_srcSystem(), message.get_srcComponent())
        kind = message.get_type()
        if kind == "MISSION_ACK":
            self._end(peer, message)
        elif message.mission_type not in self._stores:
            self._ack(peer, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)
        elif kind == "MISSION_COUNT":
            self._begin(peer, message, t_ns)
        elif kind == "MISSION_WRITE_PARTIAL_LIST":
            self._begin_partial(peer, message, t_ns)
        elif kind in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            self._receive_item(peer, message, t_ns)
        elif kind == "MISSION_REQUEST_LIST":
            self._list(peer, message, t_ns)
        elif kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            self._answer_request(peer, message, t_ns)
        elif kind == "MISSION_CLEAR_ALL":
            self._clear(peer, message.mission_type)

    def _give_up(self, upload: _Upload) -> None:
        self._upload = None
        self._ack(upload.peer, mavlink.MAV_MISSION_OPERATION_CANCELLED, upload.mission_type)

    def _begin(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
        store = self._stores[message.mission_type]
        if self._upload is not None and self._upload.peer != peer:
            self._ack(peer, mavlink.MAV_MISSION_DENIED, message.mission_type)
            return
        if not self._prepare(store, message.count):
            self._ack(peer, mavlink.MAV_MISSION_NO_SPACE, message.mission_type)
            return
        self._upload = None
        if message.count == 0:
            self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)
            return
        self._upload = _Upload(peer, message.mission_type, 0, message.count - 1, t_ns, t_ns)
        self._request_item(self._upload, t_ns)

    def _prepare(self, store: MissionStore, count: int) -> bool:
        """Start an upload of `count` items; return False if the storage is too small."""
        if count > MAX_ITEMS:
            return False
        store.truncate(count)
        return True

    def _end(self, peer: tuple[int, int], message: Any) -> None:
        """Ignore a ground station's MISSION_ACK: a read-back has no state."""

    def _begin_partial(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
        if self._upload is not None and self._upload.peer != peer:
            self._ack(peer, mavlink.MAV_MISSION_DENIED, message.mission_type)
            return
        first = message.start_index
        last = message.end_index
        if not 0 <= first <= last < len(self._stores[message.mission_type]):
            self._ack(peer, mavlink.MAV_MISSION_ERROR, message.mission_type)
            return
        self._upload = _Upload(peer, message.mission_type, first, last, t_ns, t_ns)
        self._request_item(self._upload, t_ns)

    def _receive_item(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
        upload = self._upload
        if upload is None or upload.mission_type != message.mission_type:
            self._ack(peer, mavlink.MAV_MISSION_ERROR, message.mission_type)
            return
        if message.seq != upload.next:
            self._ack(peer, mavlink.MAV_MISSION_INVALID_SEQUENCE, message.mission_type)
            return
        if peer != upload.peer:
            self._ack(peer, mavlink.MAV_MISSION_DENIED, message.mission_type)
            return
        try:
            self._stores[message.mission_type].put(message.seq, normalised(message, message.mission_type))
        except Refused as refused:
            self._upload = None
            self._ack(peer, refused.result, message.mission_type)
            return
        upload.heard_ns = t_ns
        upload.next += 1
        if upload.next > upload.last:
            self._upload = None
            self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)
        else:
            self._request_item(upload, t_ns)

    def _request_item(self, upload: _Upload, t_ns: int) -> None:
        upload.requested_ns = t_ns
        self._send(self._request_message(upload.peer, upload.next, upload.mission_type))

    def _request_message(self, peer: tuple[int, int], seq: int, mission_type: int) -> Any:
        """Return the request for an item."""
        return mavlink.MAVLink_mission_request_message(*peer, seq, mission_type)

    def _list(self, peer: tuple[int, int], message: Any, _t_ns: int) -> None:
        if self._upload is None:
            self._send_count(peer, message.mission_type)
        else:
            self._ack(peer, mavlink.MAV_MISSION_DENIED, message.mission_type)

    def _answer_request(self, peer: tuple[int, int], message: Any, _t_ns: int) -> None:
        if self._upload is not None and message.get_type() == "MISSION_REQUEST_INT":
            self._ack(peer, mavlink.MAV_MISSION_DENIED, message.mission_type)
        elif message.seq >= len(self._stores[message.mission_type]):
            self._send_count(peer, message.mission_type)
            self._ack(peer, mavlink.MAV_MISSION_ERROR, message.mission_type)
        else:
            self._send_item(peer, message)

    def _send_item(self, peer: tuple[int, int], message: Any) -> None:
        store = self._stores[message.mission_type]
        is_current = message.mission_type == MISSION and message.seq == self._current()
        as_int = message.get_type() == "MISSION_REQUEST_INT"
        self._send(
            to_message(store[message.seq], message.seq, message.mission_type, is_current, peer, as_int)
        )

    def _clear(self, peer: tuple[int, int], mission_type: int) -> None:
        if self._upload is not None or (mission_type == MISSION and not self._may_clear()):
            self._ack(peer, mavlink.MAV_MISSION_ERROR, mission_type)
            return
        self._stores[mission_type].truncate(0)
        if mission_type == MISSION:
            self._cleared()
        self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, mission_type)

    def _send_count(self, peer: tuple[int, int], mission_type: int) -> None:
        count = len(self._stores[mission_type])
        self._send(mavlink.MAVLink_mission_count_message(*peer, count, mission_type))

    def _ack(self, peer: tuple[int, int], result: int, mission_type: int) -> None:
        self._send(mavlink.MAVLink_mission_ack_message(*peer, result, mission_type))
