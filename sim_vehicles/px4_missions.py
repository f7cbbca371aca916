"""PX4's side of the MAVLink mission protocol, where it differs from ArduPlane's.

- An upload goes to a second store, which takes the first one's place when its last item is in: a mission is
  whole at any time. The same items again change nothing.
- Items are asked for with ``MISSION_REQUEST_INT``, again after 250 ms, and given up after 5 s with ACK 15. An
  item that was not asked for is ignored; the last one, come twice, is acknowledged twice.
- ``current`` on an item makes the new mission begin there.
- Parameters are kept as floats, NaN too. What is read back has the frames of MISSION_ITEM_INT.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicles.missions import (
    MISSION,
    Item,
    MissionServer,
    MissionStore,
    Refused,
    taken_commands,
    taken_place,
)

_FRAMES = {0: 5, 5: 5, 3: 6, 6: 6}
_CAPACITY = 2000


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
        self._done: tuple[tuple[int, int], int, int] | None = None
        """Peer, type and last item of the upload before."""

    def _prepare(self, store: MissionStore, count: int) -> bool:
        self._staged, self._marked, self._done = [], None, None
        if count == 0:
            store.truncate(0)
        return count <= _CAPACITY

    def _ask_for(self, peer: tuple[int, int], seq: int, mission_type: int) -> Any:
        return mavlink.MAVLink_mission_request_int_message(*peer, seq, mission_type)

    def _take(self, peer: tuple[int, int], message: Any, t_ns: int) -> None:
        upload = self._upload
        if upload is None:
            if self._done == (peer, message.mission_type, message.seq):
                self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)
            return
        if peer != upload.peer or message.mission_type != upload.mission_type or message.seq != upload.wanted:
            return
        try:
            self._staged.append(_stored(message))
        except Refused as refused:
            self._upload = None
            self._ack(peer, refused.result, message.mission_type)
            return
        if message.current:
            self._marked = message.seq
        upload.heard_ns = t_ns
        upload.wanted += 1
        if upload.wanted <= upload.last:
            self._ask(upload, t_ns)
            return
        self._upload = None
        self._done = (peer, message.mission_type, message.seq)
        store = self._stores[message.mission_type]
        is_new = not _equal(list(store), self._staged)
        store.replace(self._staged)
        if is_new and message.mission_type == MISSION:
            self._replaced(self._marked)
        self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)


def _stored(message: Any) -> Item:
    frame = _FRAMES.get(message.frame)
    if frame is None:
        raise Refused(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if message.command not in taken_commands(message.mission_type):
        raise Refused(mavlink.MAV_MISSION_UNSUPPORTED)
    if not math.isfinite(message.z):
        raise Refused(mavlink.MAV_MISSION_INVALID_PARAM7)
    x, y = taken_place(message)
    params = (message.param1, message.param2, message.param3, message.param4)
    return Item(message.command, frame, *params, x, y, message.z)


def _equal(a: list[Item], b: list[Item]) -> bool:
    return [repr(item) for item in a] == [repr(item) for item in b]  # NaN is equal to itself here
