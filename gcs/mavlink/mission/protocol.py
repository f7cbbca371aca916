"""The two exchanges of the mission protocol: `MissionDownload` and `MissionUpload`. Sans-I/O.

MAV_MISSION_TYPE distinguishes missions, fences and rally points. Sources:
https://mavlink.io/en/services/mission.html, ArduPilot's `MissionItemProtocol`, PX4's `mavlink_mission`.

Upload: the vehicle requests one item after the other. ArduPilot repeats a lost request only once a second. So
we resend after a silence of about one round trip: the last item, the next one, and one more each time, up to
a window. Both firmwares store the item whose turn it is without a request. ArduPilot answers any other with
ACK 13 and PX4 ignores it; the transfer goes on. Without loss no item is sent without a request.

Download: we request the items. ArduPilot answers in any order, so a window of requests is in flight. PX4 ends
the transfer at any item but the next or the last one, so its window is one, and an ended transfer is
restarted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Message
from gcs.mavlink.mission.items import Item, item_of
from gcs.mavlink.services.retry import RetryTimer, ns
from gcs.mavlink.services.rtt import RttEstimator
from gcs.model import NS_PER_S

_MISSION: Final = dialect.MAV_MISSION_TYPE_MISSION
_MAX_LIST_TRIES: Final = 24
_MAX_ITEM_TRIES: Final = 20
_MAX_ITEM_TRIES_IN_ORDER: Final = 10
"""After so many the vehicle has ended the transfer."""
_MIN_ANSWER_S: Final = 15.0
"""Requests for items in any order are repeated for at least so long."""
_MAX_STARTS: Final = 10


class MissionDownload:
    """Download of a list from one vehicle.

    Parameters
    ----------
    to : (int, int)
        System and component id of the vehicle.
    rtt : RttEstimator
        Of its link.
    t_ns : int
        Time of the first request.
    in_order : bool
        True if items must be requested one after the other.
    """

    def __init__(
        self,
        to: tuple[int, int],
        rtt: RttEstimator,
        t_ns: int,
        mission_type: int = _MISSION,
        *,
        in_order: bool = True,
    ) -> None:
        self.count: int | None = None
        self._to, self._type, self._rtt, self._in_order = to, mission_type, rtt, in_order
        self._items: dict[int, Item] = {}
        self._timers: dict[int, RetryTimer] = {}
        self._starts = 0
        self._heard_t_ns = t_ns
        self._start(t_ns)

    @property
    def items(self) -> list[Item]:
        """Items received so far, in order."""
        return [self._items[seq] for seq in sorted(self._items)]

    @property
    def is_complete(self) -> bool:
        """True if all items have been received."""
        return self.count is not None and len(self._items) >= self.count

    def poll(self, t_ns: int, window: int = 1) -> list[Message]:
        """Return the requests that are due; `window` is their maximum number in flight, in any order."""
        if self.count is None:
            timers = [self._count_timer]
        else:
            if self._starts < _MAX_STARTS and self._is_stalled(t_ns):
                self._start(t_ns)
                return self.poll(t_ns, window)
            self._fill_window(t_ns, window)
            timers = list(self._timers.values())
        due = [timer for timer in timers if timer.start_try(t_ns)]
        resent = sum(timer.sent > 1 for timer in due)
        self._rtt.retransmissions += resent
        if resent and t_ns - self._heard_t_ns >= ns(self._rtt.wait_s):  # no answer at all: more than a loss
            self._heard_t_ns = t_ns
            self._rtt.back_off()
        return [timer.request for timer in due for _ in range(self._rtt.copies if timer.sent > 1 else 1)]

    def is_exhausted(self, t_ns: int) -> bool:
        """Return True if the vehicle does not answer: all tries are used up."""
        if self.count is None:
            return self._count_timer.is_exhausted(t_ns)
        return self._starts >= _MAX_STARTS and self._is_stalled(t_ns)

    def restart_if_in_order(self, t_ns: int) -> None:
        """Restart after MAV_MISSION_ERROR, by which a vehicle with a fixed order ends the transfer."""
        if self.count is not None and self._in_order and self._starts < _MAX_STARTS:
            self._start(t_ns)

    def ack_message(self) -> Message:
        """Return the MISSION_ACK that ends the transfer."""
        return dialect.MAVLink_mission_ack_message(*self._to, dialect.MAV_MISSION_ACCEPTED, self._type)

    def add_count(self, message: Message, t_ns: int) -> bool:
        """Add a MISSION_COUNT; return True if it is the first."""
        if self.count is not None:
            return False
        self._heard_t_ns = t_ns
        self._rtt.add_sample(self._count_timer.round_trip_s(t_ns))
        self.count = message.count
        return True

    def add_item(self, message: Message, t_ns: int) -> bool:
        """Add a MISSION_ITEM_INT; return True if it was requested."""
        timer = self._timers.pop(message.seq, None)
        if timer is None:
            return False
        self._heard_t_ns = t_ns
        self._rtt.add_sample(timer.round_trip_s(t_ns))
        self._items[message.seq] = item_of(message)
        return True

    def _is_stalled(self, t_ns: int) -> bool:
        return any(timer.is_exhausted(t_ns) for timer in self._timers.values())

    def _start(self, t_ns: int) -> None:
        self._starts += 1
        self.count, self._next = None, 0
        self._items.clear()
        self._timers.clear()
        request = dialect.MAVLink_mission_request_list_message(*self._to, self._type)
        self._count_timer = RetryTimer(request, self._rtt.retry_policy(_MAX_LIST_TRIES, _MIN_ANSWER_S), t_ns)

    def _fill_window(self, t_ns: int, window: int) -> None:
        assert self.count is not None
        if self._in_order:
            window, policy = 1, self._rtt.retry_policy(_MAX_ITEM_TRIES_IN_ORDER)
        else:
            policy = self._rtt.retry_policy(_MAX_ITEM_TRIES, _MIN_ANSWER_S)
        while len(self._timers) < window and self._next < self.count:
            request = dialect.MAVLink_mission_request_int_message(*self._to, self._next, self._type)
            self._timers[self._next] = RetryTimer(request, policy, t_ns)
            self._next += 1


class MissionUpload:
    """Upload of a list to one vehicle, which requests the items.

    A request beyond the next item belongs to an earlier transfer and is not answered.

    Parameters
    ----------
    last_on_request_only : bool
        True if the last item must not be sent without a request. A PX4 that has all items reports an error to
        its operator for any other item that comes again.
    """

    def __init__(
        self,
        items: Sequence[Item],
        to: tuple[int, int],
        rtt: RttEstimator,
        mission_type: int = _MISSION,
        *,
        last_on_request_only: bool = False,
    ) -> None:
        self._last_on_request_only = last_on_request_only
        self.sent_count = 0
        """Items sent so far."""
        self.acked = False
        self._items, self._to, self._rtt = items, to, rtt
        self._type = mission_type
        self._requested_seq = 0
        self._sent_once_t_ns: dict[int, int] = {}
        """Send time of each item that was sent once: only these measure a round trip."""
        self._resend_t_ns: int | None = None
        """When to resend without a request."""

    @property
    def is_all_sent(self) -> bool:
        """True if every item has been sent."""
        return self.sent_count == len(self._items)

    def restart(self) -> None:
        """Start again from the first item."""
        self.sent_count, self.acked, self._resend_t_ns = 0, False, None
        self._sent_once_t_ns.clear()

    def count_message(self) -> Message:
        """Return the MISSION_COUNT that starts the transfer."""
        return dialect.MAVLink_mission_count_message(*self._to, len(self._items), self._type)

    def answer_request(self, seq: int, t_ns: int, current: int = -1) -> list[Message]:
        """Return the requested item, or none out of turn; `current` is the first item to fly."""
        if seq > self.sent_count or seq >= len(self._items):
            return []
        before_t_ns = self._sent_once_t_ns.pop(seq - 1, None)
        if before_t_ns is not None:
            self._rtt.add_sample((t_ns - before_t_ns) / NS_PER_S)
        self._requested_seq = seq
        return self._item_messages(seq, seq + 1, t_ns, current)

    def poll(self, t_ns: int, current: int = -1, window: int = 1) -> list[Message]:
        """Return the items to send without a request, after a silence; at most `window` in flight."""
        if self._resend_t_ns is None or t_ns < self._resend_t_ns:
            return []
        self._rtt.back_off()
        last = len(self._items) - 1
        end_max = len(self._items) if self._requested_seq == last or not self._last_on_request_only else last
        end = min(self.sent_count + 1, self._requested_seq + window, end_max)
        return self._item_messages(self._requested_seq, end, t_ns, current) * self._rtt.copies

    def _item_messages(self, first: int, end: int, t_ns: int, current: int) -> list[Message]:
        for seq in range(first, end):
            if seq < self.sent_count:  # resent: the round trip is ambiguous
                self._rtt.retransmissions += 1
                self._sent_once_t_ns.pop(seq, None)
            else:
                self._sent_once_t_ns[seq] = t_ns
        self.sent_count = max(self.sent_count, end)
        self._resend_t_ns = t_ns + ns(self._rtt.wait_s)
        return [self._message(seq, current) for seq in range(first, end)]

    def _message(self, seq: int, current: int) -> Message:
        return self._items[seq].message(seq, *self._to, current=seq == current, mission_type=self._type)
