"""Reading a list back, and sending one: the two conversations of the mission protocol, sans-I/O.

Missions, fences and rally points go by it alike: MAV_MISSION_TYPE tells them apart.

Sources: https://mavlink.io/en/services/mission.html; ArduPilot's `MissionItemProtocol`, PX4's
`mavlink_mission`. The vehicle leads an upload: it asks for one item after the other. But ArduPilot asks again
for what was lost only once a second, so we act on silence: no request for as long as a round trip usually
takes means that the item asked for last was lost, or the request for the next one. So both are sent, and one
more each time that nothing comes of it, up to a window. An item whose turn it is, is stored by either
firmware though its request was lost; any other is refused with ACK 13 (ArduPilot) or not heard (PX4), and the
transfer goes on. Without loss nothing is sent that was not asked for.

A read-back is led by us. ArduPilot answers whatever item is asked for, so a window of questions is kept on
its way. PX4 keeps count: any item but the next one, or the last one again, ends the conversation, so there
the window is one, and a conversation that has ended is begun anew.

Both know only what has been said in them; what to make of the outcome is the task's
(`gcs.mavlink.mission.upload_task`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Message
from gcs.mavlink.mission.items import Item, item_of
from gcs.mavlink.services.retry import RetryTimer, ns
from gcs.mavlink.services.rtt import RttEstimator
from gcs.model import NS_PER_S

_MISSION: Final = dialect.MAV_MISSION_TYPE_MISSION
_LIST_TRIES: Final = 24
_TRIES: Final = 20
_TRIES_IN_ORDER: Final = 10
"""Then the vehicle has ended the conversation."""
_ANSWER_S: Final = 15.0
"""The same without an order, and so long at the least."""
_BEGINNINGS: Final = 10


class MissionDownload:
    """What a vehicle stores.

    Parameters
    ----------
    to : (int, int)
        Its system and component id.
    pace : Pace
        Of its link.
    t_ns : int
        When to ask first.
    window : callable, optional
        Questions on their way at a time, for a vehicle that answers them in any order; without it they go one
        after the other.
    """

    def __init__(
        self,
        to: tuple[int, int],
        pace: RttEstimator,
        t_ns: int,
        window: Callable[[], int] | None = None,
        mission_type: int = _MISSION,
    ) -> None:
        self.count: int | None = None
        self._to, self._type, self._pace, self._window = to, mission_type, pace, window
        self._items: dict[int, Item] = {}
        self._asked: dict[int, RetryTimer] = {}
        self._beginnings = 0
        self._heard_t_ns = t_ns
        self._begin(t_ns)

    @property
    def items(self) -> list[Item]:
        """What has come, in order."""
        return [self._items[seq] for seq in sorted(self._items)]

    @property
    def is_complete(self) -> bool:
        """Whether all of it has come."""
        return self.count is not None and len(self._items) >= self.count

    def due(self, t_ns: int) -> list[Message]:
        """Return the questions that are due now."""
        if self.count is None:
            asking = [self._list]
        else:
            if self._beginnings < _BEGINNINGS and self._is_stuck(t_ns):
                self._begin(t_ns)
                return self.due(t_ns)
            self._fill(t_ns)
            asking = list(self._asked.values())
        due = [one for one in asking if one.due(t_ns)]
        again = sum(one.sent > 1 for one in due)
        self._pace.repeats += again
        if again and t_ns - self._heard_t_ns >= ns(self._pace.wait_s):  # nothing comes: more than a loss
            self._heard_t_ns = t_ns
            self._pace.late()
        return [one.question for one in due for _ in range(self._pace.copies if one.sent > 1 else 1)]

    def unanswered(self, t_ns: int) -> bool:
        """Whether it is in vain."""
        if self.count is None:
            return self._list.unanswered(t_ns)
        return self._beginnings >= _BEGINNINGS and self._is_stuck(t_ns)

    def broken_off(self, t_ns: int) -> None:
        """Begin anew when the vehicle says that it has ended a conversation whose order matters."""
        if self.count is not None and self._window is None and self._beginnings < _BEGINNINGS:
            self._begin(t_ns)

    def thanks(self) -> Message:
        """Return what ends the conversation."""
        return dialect.MAVLink_mission_ack_message(*self._to, dialect.MAV_MISSION_ACCEPTED, self._type)

    def take_count(self, message: Message, t_ns: int) -> bool:
        """Take a MISSION_COUNT; whether it was news."""
        if self.count is not None:
            return False
        self._heard_t_ns = t_ns
        self._pace.took(self._list.took_s(t_ns))
        self.count = message.count
        return True

    def take_item(self, message: Message, t_ns: int) -> bool:
        """Take a MISSION_ITEM_INT; whether it was asked for."""
        asking = self._asked.pop(message.seq, None)
        if asking is None:
            return False
        self._heard_t_ns = t_ns
        self._pace.took(asking.took_s(t_ns))
        self._items[message.seq] = item_of(message)
        return True

    def _is_stuck(self, t_ns: int) -> bool:
        return any(asked.unanswered(t_ns) for asked in self._asked.values())

    def _begin(self, t_ns: int) -> None:
        self._beginnings += 1
        self.count, self._next = None, 0
        self._items.clear()
        self._asked.clear()
        question = dialect.MAVLink_mission_request_list_message(*self._to, self._type)
        self._list = RetryTimer(question, self._pace.patience(_LIST_TRIES, _ANSWER_S), t_ns)

    def _fill(self, t_ns: int) -> None:
        assert self.count is not None
        window, patience = 1, self._pace.patience(_TRIES_IN_ORDER)
        if self._window is not None:
            window, patience = self._window(), self._pace.patience(_TRIES, _ANSWER_S)
        while len(self._asked) < window and self._next < self.count:
            question = dialect.MAVLink_mission_request_int_message(*self._to, self._next, self._type)
            self._asked[self._next] = RetryTimer(question, patience, t_ns)
            self._next += 1


class MissionUpload:
    """Items on their way to a vehicle that asks for them.

    A request that runs ahead of what was sent belongs to an older session whose MISSION_COUNT was ours too,
    and is not answered.

    With `last_when_asked` the last item is not sent unasked: to a PX4 that has all of them, any other item
    that comes again is an error, which it tells the operator.
    """

    def __init__(
        self,
        items: Sequence[Item],
        to: tuple[int, int],
        pace: RttEstimator,
        window: Callable[[], int] = lambda: 1,
        mission_type: int = _MISSION,
        *,
        last_when_asked: bool = False,
    ) -> None:
        self._last_when_asked = last_when_asked
        self.next = 0
        """Items sent so far."""
        self.acked = False
        self._items, self._to, self._pace = items, to, pace
        self._window, self._type = window, mission_type
        self._asked = 0
        self._once: dict[int, int] = {}
        """When each item was sent of which that can be told: those sent twice are not in it."""
        self._quiet_t_ns: int | None = None
        """When silence has lasted too long."""

    @property
    def is_whole(self) -> bool:
        """Whether every item has been sent."""
        return self.next == len(self._items)

    def begin(self) -> None:
        """Begin again from the first item."""
        self.next, self.acked, self._quiet_t_ns = 0, False, None
        self._once.clear()

    def count(self) -> Message:
        """Return what opens the conversation."""
        return dialect.MAVLink_mission_count_message(*self._to, len(self._items), self._type)

    def answer(self, seq: int, t_ns: int, current: int = -1) -> list[Message]:
        """Return the item asked for, none when it is not its turn; `current` is where the mission begins."""
        if seq > self.next or seq >= len(self._items):
            return []
        before_t_ns = self._once.pop(seq - 1, None)
        if before_t_ns is not None:
            self._pace.took((t_ns - before_t_ns) / NS_PER_S)
        self._asked = seq
        return self._sent(seq, seq + 1, t_ns, current)

    def due(self, t_ns: int, current: int = -1) -> list[Message]:
        """Return the items to send without having been asked, after a silence."""
        if self._quiet_t_ns is None or t_ns < self._quiet_t_ns:
            return []
        self._pace.late()
        last = len(self._items) - 1
        most = len(self._items) if self._asked == last or not self._last_when_asked else last
        end = min(self.next + 1, self._asked + self._window(), most)
        return self._sent(self._asked, end, t_ns, current) * self._pace.copies

    def _sent(self, first: int, end: int, t_ns: int, current: int) -> list[Message]:
        for seq in range(first, end):
            if seq < self.next:  # which of the two is answered cannot be told
                self._pace.repeats += 1
                self._once.pop(seq, None)
            else:
                self._once[seq] = t_ns
        self.next = max(self.next, end)
        self._quiet_t_ns = t_ns + ns(self._pace.wait_s)
        return [self._message(seq, current) for seq in range(first, end)]

    def _message(self, seq: int, current: int) -> Message:
        return self._items[seq].message(seq, *self._to, current=seq == current, mission_type=self._type)
