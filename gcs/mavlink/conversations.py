"""Reading a list back, and sending one: the two conversations of the mission protocol, sans-I/O.

Missions, fences and rally points go by it alike: MAV_MISSION_TYPE tells them apart.

Source: https://mavlink.io/en/services/mission.html. Both know only what has been said in them; patience,
repetition and what to make of the outcome is the task's (`gcs.mavlink.transfer`).
"""

from __future__ import annotations

from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.codec import Message
from gcs.mavlink.items import Item, item_of

_MISSION = dialect.MAV_MISSION_TYPE_MISSION
_GAIN = 0.125


class ReadBack:
    """What a vehicle stores, asked for in order. `to` is its system and component id."""

    def __init__(self, to: tuple[int, int], mission_type: int = _MISSION) -> None:
        self._type = mission_type
        self.count: int | None = None
        self.items: list[Item] = []
        self._to = to

    @property
    def is_complete(self) -> bool:
        """Whether all of it has come."""
        return self.count is not None and len(self.items) >= self.count

    def question(self) -> Message:
        """Return what to ask next."""
        if self.count is None:
            return dialect.MAVLink_mission_request_list_message(*self._to, self._type)
        return dialect.MAVLink_mission_request_int_message(*self._to, len(self.items), self._type)

    def thanks(self) -> Message:
        """Return what ends the conversation."""
        return dialect.MAVLink_mission_ack_message(*self._to, dialect.MAV_MISSION_ACCEPTED, self._type)

    def take_count(self, message: Message) -> bool:
        """Take a MISSION_COUNT; whether it was news."""
        if self.count is not None:
            return False
        self.count = message.count
        return True

    def take_item(self, message: Message) -> bool:
        """Take a MISSION_ITEM_INT; whether it was the one asked for."""
        if self.is_complete or self.count is None or message.seq != len(self.items):
            return False
        self.items.append(item_of(message))
        return True


class Sending:
    """Items on their way to a vehicle that asks for them.

    An item is sent when it is asked for and only in order: a request that runs ahead belongs to an older
    session whose MISSION_COUNT was ours too.
    """

    def __init__(self, items: Sequence[Item], to: tuple[int, int], mission_type: int = _MISSION) -> None:
        self._type = mission_type
        self.next = 0
        """Items asked for so far."""
        self.acked = False
        self.round_trip_s: float | None = None
        """From an item that was sent once to the request for the next one, smoothed."""
        self._items, self._to = items, to
        self._sent_t_ns: int | None = None

    @property
    def is_whole(self) -> bool:
        """Whether every item has been sent."""
        return self.next == len(self._items)

    def begin(self) -> None:
        """Begin again from the first item."""
        self.next, self.acked, self._sent_t_ns = 0, False, None

    def count(self) -> Message:
        """Return what opens the conversation."""
        return dialect.MAVLink_mission_count_message(*self._to, len(self._items), self._type)

    def counted(self, t_ns: int, *, again: bool) -> None:
        """Note that it goes out."""
        self._sent_t_ns = None if again else t_ns

    def answer(self, seq: int, t_ns: int, current: int = -1) -> Message | None:
        """Return the item asked for, None when it is not its turn; `current` is where the mission begins."""
        if seq > self.next or seq >= len(self._items):
            return None
        if seq == self.next:
            self._measure(t_ns)
            self.next += 1
            self._sent_t_ns = t_ns
        else:  # asked again: which of the two is answered next cannot be told
            self._sent_t_ns = None
        return self._items[seq].message(seq, *self._to, current=seq == current, mission_type=self._type)

    def _measure(self, t_ns: int) -> None:
        if self._sent_t_ns is None:
            return
        took_s = (t_ns - self._sent_t_ns) * 1e-9
        known = self.round_trip_s
        self.round_trip_s = took_s if known is None else known + _GAIN * (took_s - known)
