"""Transfer of a list of items: `MissionDownload` and `MissionUpload`, with their retries. Sans-I/O.

MAV_MISSION_TYPE distinguishes missions, fences and rally points. Sources:
https://mavlink.io/en/services/mission.html, ArduPilot's `MissionItemProtocol`, PX4's `mavlink_mission`.

Upload: the vehicle requests one item after the other. ArduPilot repeats a lost request only once a second. So
we resend after a timeout of about one round trip: the last item, the next one, and one more each time, up to
a window. Both firmwares store the item whose turn it is without a request. ArduPilot answers any other with
ACK 13 and PX4 ignores it; the transfer goes on. Without loss no item is sent without a request.

Download: we request the items. ArduPilot answers in any order, so a window of requests is in flight. PX4 ends
the transfer at any item but the next or the last one, so its window is one, and an ended transfer is
restarted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Message
from gcs.mavlink.mission.items import Item, item_of
from gcs.mavlink.services.retransmission_timeout import RttEstimator
from gcs.mavlink.services.retry import RetryTimer, ns
from gcs.model import NS_PER_S

_MISSION: Final = dialect.MAV_MISSION_TYPE_MISSION
_MAX_LIST_TRIES: Final = 24
_MAX_ITEM_TRIES: Final = 20
_MAX_ITEM_TRIES_IN_ORDER: Final = 10
"""After so many the vehicle has ended the transfer."""
_MIN_ANSWER_S: Final = 15.0
"""Requests for items in any order are repeated for at least so long."""
_MAX_STARTS: Final = 10


@dataclass(slots=True)
class MissionDownload:
    """Download of a list from one vehicle."""

    to: tuple[int, int]
    """System and component id of the vehicle."""
    count_timer: RetryTimer
    """Timer of the request for the number of items."""
    heard_t_ns: int
    """Time of the last answer, or of the last wait that grew."""
    mission_type: int = _MISSION
    in_order: bool = True
    """True if items must be requested one after the other."""
    count: int | None = None
    """Number of items; None if it is unknown."""
    received: dict[int, Item] = field(default_factory=dict)
    """By number."""
    timers: dict[int, RetryTimer] = field(default_factory=dict)
    """Of the items that have been requested, by number."""
    next_seq: int = 0
    """Number of the next item to request."""
    starts: int = 1
    """Times that the download was begun."""

    @classmethod
    def begin(
        cls,
        to: tuple[int, int],
        rtt: RttEstimator,
        t_ns: int,
        mission_type: int = _MISSION,
        *,
        in_order: bool = True,
    ) -> MissionDownload:
        """Begin a download over a link of this round trip; the first request is due at once."""
        return cls(to, _count_timer(to, mission_type, rtt, t_ns), t_ns, mission_type, in_order)

    @property
    def items(self) -> list[Item]:
        """Items received so far, in order."""
        return [self.received[seq] for seq in sorted(self.received)]

    @property
    def is_complete(self) -> bool:
        """True if all items have been received."""
        return self.count is not None and len(self.received) >= self.count

    def poll(self, t_ns: int, rtt: RttEstimator, window: int = 1) -> list[Message]:
        """Return the requests that are due; `window` is their maximum number in flight, in any order."""
        if self.count is None:
            timers = [self.count_timer]
        else:
            if self.starts < _MAX_STARTS and self._is_stalled(t_ns):
                self._start(t_ns, rtt)
                return self.poll(t_ns, rtt, window)
            self._fill_window(t_ns, rtt, window)
            timers = list(self.timers.values())
        due = [timer for timer in timers if timer.start_try(t_ns)]
        resent = sum(timer.sent > 1 for timer in due)
        rtt.retransmissions += resent
        if resent and t_ns - self.heard_t_ns >= ns(rtt.wait_s):  # no answer at all: more than a loss
            self.heard_t_ns = t_ns
            rtt.back_off()
        return [timer.request for timer in due for _ in range(rtt.copies if timer.sent > 1 else 1)]

    def is_exhausted(self, t_ns: int) -> bool:
        """Return True if the vehicle does not answer: all tries are used up."""
        if self.count is None:
            return self.count_timer.is_exhausted(t_ns)
        return self.starts >= _MAX_STARTS and self._is_stalled(t_ns)

    def restart_if_in_order(self, t_ns: int, rtt: RttEstimator) -> None:
        """Restart after MAV_MISSION_ERROR, by which a vehicle with a fixed order ends the transfer."""
        if self.count is not None and self.in_order and self.starts < _MAX_STARTS:
            self._start(t_ns, rtt)

    def ack_message(self) -> Message:
        """Return the MISSION_ACK that ends the transfer."""
        return dialect.MAVLink_mission_ack_message(*self.to, dialect.MAV_MISSION_ACCEPTED, self.mission_type)

    def add_count(self, message: Message, t_ns: int, rtt: RttEstimator) -> None:
        """Add a MISSION_COUNT, if it is the first."""
        if self.count is not None:
            return
        self.heard_t_ns = t_ns
        rtt.add_sample(self.count_timer.round_trip_s(t_ns))
        self.count = message.count

    def add_item(self, message: Message, t_ns: int, rtt: RttEstimator) -> bool:
        """Add a MISSION_ITEM_INT; return True if it was requested."""
        timer = self.timers.pop(message.seq, None)
        if timer is None:
            return False
        self.heard_t_ns = t_ns
        rtt.add_sample(timer.round_trip_s(t_ns))
        self.received[message.seq] = item_of(message)
        return True

    def _is_stalled(self, t_ns: int) -> bool:
        return any(timer.is_exhausted(t_ns) for timer in self.timers.values())

    def _start(self, t_ns: int, rtt: RttEstimator) -> None:
        self.starts += 1
        self.count = None
        self.next_seq = 0
        self.received.clear()
        self.timers.clear()
        self.count_timer = _count_timer(self.to, self.mission_type, rtt, t_ns)

    def _fill_window(self, t_ns: int, rtt: RttEstimator, window: int) -> None:
        assert self.count is not None
        if self.in_order:
            window = 1
            policy = rtt.retry_policy(_MAX_ITEM_TRIES_IN_ORDER)
        else:
            policy = rtt.retry_policy(_MAX_ITEM_TRIES, _MIN_ANSWER_S)
        while len(self.timers) < window and self.next_seq < self.count:
            request = dialect.MAVLink_mission_request_int_message(*self.to, self.next_seq, self.mission_type)
            self.timers[self.next_seq] = RetryTimer(request, policy, t_ns)
            self.next_seq += 1


def _count_timer(to: tuple[int, int], mission_type: int, rtt: RttEstimator, t_ns: int) -> RetryTimer:
    request = dialect.MAVLink_mission_request_list_message(*to, mission_type)
    return RetryTimer(request, rtt.retry_policy(_MAX_LIST_TRIES, _MIN_ANSWER_S), t_ns)


@dataclass(slots=True)
class MissionUpload:
    """Upload of a list to one vehicle, which requests the items.

    A request beyond the next item belongs to an earlier transfer and is not answered.
    """

    items: tuple[Item, ...]
    to: tuple[int, int]
    """System and component id of the vehicle."""
    mission_type: int = _MISSION
    in_order: bool = False
    """True if the last item must not be sent without a request. A PX4 that has all items reports an error to
    its operator for any other item that comes again."""
    sent_count: int = 0
    """Items sent so far."""
    acked: bool = False
    """True if the vehicle has acknowledged the whole list."""
    requested_seq: int = 0
    """Number of the last requested item."""
    sent_once_t_ns: dict[int, int] = field(default_factory=dict)
    """Send time of each item that was sent once: only these measure a round trip."""
    resend_t_ns: int | None = None
    """When to resend without a request."""

    @property
    def is_all_sent(self) -> bool:
        """True if every item has been sent."""
        return self.sent_count == len(self.items)

    def restart(self) -> None:
        """Start again from the first item."""
        self.sent_count = 0
        self.acked = False
        self.resend_t_ns = None
        self.sent_once_t_ns.clear()

    def count_message(self) -> Message:
        """Return the MISSION_COUNT that starts the transfer."""
        return dialect.MAVLink_mission_count_message(*self.to, len(self.items), self.mission_type)

    def answer_request(self, seq: int, t_ns: int, rtt: RttEstimator, current: int = -1) -> list[Message]:
        """Return the requested item, or none out of turn; `current` is the first item to fly."""
        if seq > self.sent_count or seq >= len(self.items):
            return []
        before_t_ns = self.sent_once_t_ns.pop(seq - 1, None)
        if before_t_ns is not None:
            rtt.add_sample((t_ns - before_t_ns) / NS_PER_S)
        self.requested_seq = seq
        return self._item_messages(seq, seq + 1, t_ns, rtt, current)

    def poll(self, t_ns: int, rtt: RttEstimator, current: int = -1, window: int = 1) -> list[Message]:
        """Return the items to send without a request, after a timeout; at most `window` in flight."""
        if self.resend_t_ns is None or t_ns < self.resend_t_ns:
            return []
        rtt.back_off()
        last = len(self.items) - 1
        end_max = len(self.items) if self.requested_seq == last or not self.in_order else last
        end = min(self.sent_count + 1, self.requested_seq + window, end_max)
        return self._item_messages(self.requested_seq, end, t_ns, rtt, current) * rtt.copies

    def _item_messages(
        self, first: int, end: int, t_ns: int, rtt: RttEstimator, current: int
    ) -> list[Message]:
        for seq in range(first, end):
            if seq < self.sent_count:  # resent: the round trip is ambiguous
                rtt.retransmissions += 1
                self.sent_once_t_ns.pop(seq, None)
            else:
                self.sent_once_t_ns[seq] = t_ns
        self.sent_count = max(self.sent_count, end)
        self.resend_t_ns = t_ns + ns(rtt.wait_s)
        return [self._message(seq, current) for seq in range(first, end)]

    def _message(self, seq: int, current: int) -> Message:
        return self.items[seq].message(seq, *self.to, current=seq == current, mission_type=self.mission_type)
