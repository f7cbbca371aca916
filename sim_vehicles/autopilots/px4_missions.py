"""PX4's side of the MAVLink mission protocol, where it differs from ArduPlane's.

- An upload goes to a second store, which takes the first one's place when its last item is in: a mission is
  whole at any time. The same items again change nothing.
- Items are asked for with ``MISSION_REQUEST_INT``, again after 250 ms; after 5 s without an item it is given
  up without a word. An item whose turn it is not is ignored; the last one, come twice, is acknowledged twice.
- ``current`` on an item makes the new mission begin there.
- Parameters are kept as floats, NaN too, but not all of them: of a take-off the heading alone, and not its
  pitch. The others read back as 0. What is read back has the frames of MISSION_ITEM_INT.
- One conversation at a time, whatever it is about. A ``MISSION_COUNT`` in the midst of one gets ACK 1 and
  changes nothing; ``MISSION_ACK`` 15 ends an upload; clearing and ``MISSION_SET_CURRENT`` are not heard.
- A read-back goes in order: the next item, or the last one again. Any other ends it with ACK 1, and 5 s of
  silence end it without a word; then nothing is answered until it is begun anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicles.autopilots.missions import (
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
    mavlink.MAV_CMD_NAV_TAKEOFF: (4,),
    mavlink.MAV_CMD_NAV_LAND: (2, 4),
}
"""Parameters that are stored, of those that an item brings; fences keep the first."""


@dataclass(slots=True)
class _Download:
    """A read-back under way."""

    peer: tuple[int, int]
    mission_type: int
    next: int
    heard_ns: int


class Px4MissionServer(MissionServer):
    """As `MissionServer`; `replaced` is told that a mission is new, and the item that was marked current."""

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
        """Item that comes next in the conversation under way, or would have in the one before."""

    @property
    def is_busy(self) -> bool:
        """Whether a conversation keeps the vehicle from selecting an item."""
        return self._upload is not None or self._download is not None

    @property
    def due_ns(self) -> int:
        """When `handle_timer` is next wanted."""
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
        if upload is not None and upload.peer == peer and upload.wanted == 0:
            self._ask(upload, t_ns)  # Treated as a repeated COUNT, whatever its count.
        elif self.is_busy:
            self._ack(peer, mavlink.MAV_MISSION_ERROR, message.mission_type)
        else:
            self._partner, self._seq = peer, 0
            super()._begin(peer, message, t_ns)

    def _prepare(self, store: MissionStore, count: int) -> bool:
        self._staged, self._marked = [], None
        if count == 0:
            store.truncate(0)
        return count <= _CAPACITY

    def _ask_for(self, peer: tuple[int, int], seq: int, mission_type: int) -> Any:
        return mavlink.MAVLink_mission_request_int_message(*peer, seq, mission_type)

    def _take(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
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
        if message.seq != upload.wanted:
            return
        try:
            self._staged.append(_stored(message))
        except Refused as refused:
            self._upload = None
            self._ack(peer, refused.result, message.mission_type)
            return
        if message.current:
            self._marked = message.seq
        upload.wanted += 1
        self._seq = upload.wanted
        if upload.wanted <= upload.last:
            self._ask(upload, t_ns)
            return
        self._upload = None
        store = self._stores[message.mission_type]
        is_new = not _equal(list(store), self._staged)
        store.replace(self._staged)
        if is_new and message.mission_type == MISSION:
            self._replaced(self._marked)
        self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)

    def _list(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
        store, going = self._stores[message.mission_type], self._download
        if self._seq == len(store):  # all of it was sent or taken: what is left of a conversation is over
            self._upload = going = self._download = None
        theirs = going is not None and (going.peer, going.mission_type) == (peer, message.mission_type)
        if self._upload is not None or (going is not None and not theirs):
            return
        self._partner, self._seq = peer, 0
        self._download = _Download(peer, message.mission_type, 0, t_ns)
        self._send_count(peer, message.mission_type)

    def _give(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
        going = self._download
        if going is None or (going.peer, going.mission_type) != (peer, message.mission_type):
            return
        going.heard_ns = t_ns
        if message.seq not in (going.next, going.next - 1) or message.seq >= len(
            self._stores[message.mission_type]
        ):
            self._download = None
            self._ack(peer, mavlink.MAV_MISSION_ERROR, message.mission_type)
            return
        going.next = self._seq = message.seq + 1
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
    return [repr(item) for item in a] == [repr(item) for item in b]  # NaN is equal to itself here
