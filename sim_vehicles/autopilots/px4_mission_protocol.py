"""PX4's side of the MAVLink mission protocol, where it differs from ArduPlane's.

- An upload goes to a second store, which replaces the first after the last item: a mission is always whole.
  The same items again change nothing.
- Items are requested with ``MISSION_REQUEST_INT``, again after 250 ms, and given up after 5 s without a
  message. An item out of turn is ignored; a repeated last item is acknowledged again.
- ``current`` on an item makes the new mission begin there.
- Some parameters are kept, as floats including NaN: of a take-off the heading only. Others read back as 0.
  Frames read back are those of MISSION_ITEM_INT.
- One transfer at a time. A ``MISSION_COUNT`` during one gets ACK 1; ``MISSION_ACK`` 15 ends an upload;
  clearing and ``MISSION_SET_CURRENT`` are ignored.
- A read-back goes in order: the next item, or the last one again. Any other ends it with ACK 1, and 5 s
  without a request end it without a message. After that, requests are ignored until a new start.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicles.autopilots.mission_protocol import (
    MISSION,
    NEVER_NS,
    Item,
    MissionServer,
    MissionStore,
    Refused,
    accepted_commands,
    stored_position,
)

_FRAMES = {0: 5, 5: 5, 3: 6, 6: 6}
_CAPACITY = 2000
_KEPT = {
    mavlink.MAV_CMD_NAV_WAYPOINT: (1, 2, 4),
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: (3, 4),
    mavlink.MAV_CMD_NAV_LOITER_TIME: (1, 2, 3),
    mavlink.MAV_CMD_NAV_TAKEOFF: (4,),
    mavlink.MAV_CMD_NAV_LAND: (2, 4),
}
"""Numbers of the parameters that are stored; fences keep the first."""


@dataclass(slots=True)
class _Download:
    """A read-back under way."""

    peer: tuple[int, int]
    mission_type: int
    next: int
    heard_ns: int


class Px4MissionServer(MissionServer):
    """PX4's mission server; `replaced` is called with the item marked current of a new mission."""

    RE_REQUEST_NS = 250_000_000
    GIVE_UP_NS = 5_000_000_000

    def __init__(
        self,
        stores: dict[int, MissionStore],
        send: Callable[[Any], None],
        cleared: Callable[[], None],
        current: Callable[[], int],
        replaced: Callable[[int | None], None],
    ) -> None:
        super().__init__(stores, send, lambda: True, cleared, current)
        self._replaced = replaced
        self._staged: list[Item] = []
        self._marked: int | None = None
        self._download: _Download | None = None
        self._partner = (0, 0)
        self._seq = 0
        """Next item of the present or last transfer."""

    @property
    def is_busy(self) -> bool:
        """True if a transfer blocks the selection of an item."""
        return self._upload is not None or self._download is not None

    @property
    def due_ns(self) -> int:
        """Time of the next action of `handle_timer`."""
        ends_ns = NEVER_NS if self._download is None else self._download.heard_ns + self.GIVE_UP_NS
        return min(super().due_ns, ends_ns)

    def handle_timer(self, t_ns: int) -> None:
        """Request a missing item again, or give up an abandoned transfer."""
        super().handle_timer(t_ns)
        if self._download is not None and t_ns >= self._download.heard_ns + self.GIVE_UP_NS:
            self._download = None

    def _end(self, peer: tuple[int, int], message: Any) -> None:
        if peer == self._partner:
            self._download = None
            if message.type == mavlink.MAV_MISSION_OPERATION_CANCELLED:
                self._upload = None

    def _give_up(self, _upload: Any) -> None:
        self._upload = None

    def _begin(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
        upload = self._upload
        if upload is not None:
            upload.heard_ns = t_ns
        if upload is not None and upload.peer == peer and upload.next == 0:
            self._request_item(upload, t_ns)  # Treated as a repeated COUNT, whatever its count.
        elif self.is_busy:
            self._ack(peer, mavlink.MAV_MISSION_ERROR, message.mission_type)
        else:
            self._partner = peer
            self._seq = 0
            super()._begin(peer, message, t_ns)

    def _prepare(self, store: MissionStore, count: int) -> bool:
        self._staged = []
        self._marked = None
        if count == 0:
            store.truncate(0)
        return count <= _CAPACITY

    def _request_message(self, peer: tuple[int, int], seq: int, mission_type: int) -> Any:
        return mavlink.MAVLink_mission_request_int_message(*peer, seq, mission_type)

    def _receive_item(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
        upload = self._upload
        if peer != self._partner:
            return
        if upload is None:
            again = self._download is None and message.seq + 1 == self._seq
            result = mavlink.MAV_MISSION_ACCEPTED if again else mavlink.MAV_MISSION_ERROR
            self._ack(peer, result, message.mission_type)
            return
        if message.mission_type != upload.mission_type:
            self._ack(peer, mavlink.MAV_MISSION_ERROR, message.mission_type)
            return
        upload.heard_ns = t_ns
        if message.seq != upload.next:
            return
        try:
            self._staged.append(_stored(message))
        except Refused as refused:
            self._upload = None
            self._ack(peer, refused.result, message.mission_type)
            return
        if message.current:
            self._marked = message.seq
        upload.next += 1
        self._seq = upload.next
        if upload.next <= upload.last:
            self._request_item(upload, t_ns)
            return
        self._upload = None
        store = self._stores[message.mission_type]
        is_new = not _equal(list(store), self._staged)
        store.replace(self._staged)
        if is_new and message.mission_type == MISSION:
            self._replaced(self._marked)
        self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)

    def _list(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
        store = self._stores[message.mission_type]
        download = self._download
        if self._seq == len(store):  # Complete: the transfer has ended.
            self._upload = download = self._download = None
        key = peer, message.mission_type
        is_repeated = download is not None and (download.peer, download.mission_type) == key
        if self._upload is not None or (download is not None and not is_repeated):
            return
        self._partner = peer
        self._seq = 0
        self._download = _Download(peer, message.mission_type, 0, t_ns)
        self._send_count(peer, message.mission_type)

    def _answer_request(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
        download = self._download
        if download is None or (download.peer, download.mission_type) != (peer, message.mission_type):
            return
        download.heard_ns = t_ns
        is_in_order = message.seq in (download.next, download.next - 1)
        if not is_in_order or message.seq >= len(self._stores[message.mission_type]):
            self._download = None
            self._ack(peer, mavlink.MAV_MISSION_ERROR, message.mission_type)
            return
        download.next = self._seq = message.seq + 1
        self._send_item(peer, message)

    def _clear(self, peer: tuple[int, int], mission_type: int) -> None:
        if not self.is_busy:
            super()._clear(peer, mission_type)


def _stored(message: Any) -> Item:
    frame = _FRAMES.get(message.frame)
    if frame is None:
        raise Refused(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if message.command not in accepted_commands(message.mission_type):
        raise Refused(mavlink.MAV_MISSION_UNSUPPORTED)
    if not math.isfinite(message.z):
        raise Refused(mavlink.MAV_MISSION_INVALID_PARAM7)
    x, y = stored_position(message)
    sent = (message.param1, message.param2, message.param3, message.param4)
    kept = _KEPT.get(message.command, (1,))
    p1, p2, p3, p4 = (value if number in kept else 0.0 for number, value in enumerate(sent, 1))
    return Item(message.command, frame, p1, p2, p3, p4, x, y, message.z)


def _equal(a: list[Item], b: list[Item]) -> bool:
    return [repr(item) for item in a] == [repr(item) for item in b]  # NaN equals NaN.
