"""Requests to each vehicle for message intervals, its version and its home position, repeated until granted.

MAV_CMD_SET_MESSAGE_INTERVAL (511) and MAV_CMD_REQUEST_MESSAGE (512) of
https://mavlink.io/en/messages/common.html. A COMMAND_ACK names the command, not the message id. So one
request of each command is in flight. A requested message is its own answer. A stream is watched after its
ACK: the ACK may belong to the request before, and an autopilot may change its rates. A stalled stream is
requested again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.fleet.telemetry_table import DUE_NS, VehicleRecord, new_record
from gcs.mavlink.frames.codec import Message, is_for
from gcs.mavlink.services.command_sender import MESSAGE_INTERVAL, REQUEST_MESSAGE, command_long
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer, ns

_RETRY_POLICY: Final = RetryPolicy(wait_s=1.0, max_wait_s=5.0, max_tries=0)
_HOME_RETRY_POLICY: Final = RetryPolicy(wait_s=2.0, max_wait_s=2.0, max_tries=0)
_MAX_REFUSALS: Final = 3
_MIN_STALL_S: Final = 3.0
_STALL_PERIODS: Final = 5
_NEVER_NS: Final = 2**63 - 1


@dataclass(slots=True)
class _Request:
    message_type: str
    """Message that is requested."""
    command: int
    param1: float
    param2: float = 0.0
    policy: RetryPolicy = _RETRY_POLICY
    stall_ns: int = 0
    """For a stream: without the message for so long, it is requested again."""
    give_up: bool = True
    """True if refusals end it. Home is refused until the vehicle has one."""
    is_done: bool = False
    refusals: int = 0
    seen_t_ns: int = 0


class StreamRequests:
    """Requests to one vehicle; at most two are in flight, one of each command.

    `DUE_NS` in the vehicle's record is set to 0 when a new request may be due.
    """

    def __init__(
        self,
        system_id: int,
        own: tuple[int, int],
        position_rate_hz: float,
        record: VehicleRecord | None = None,
    ) -> None:
        self._record = new_record() if record is None else record
        self._system_id, self._own = system_id, own
        self._requests = (
            _rate("GLOBAL_POSITION_INT", dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, position_rate_hz),
            _rate("MISSION_CURRENT", dialect.MAVLINK_MSG_ID_MISSION_CURRENT, 1.0),
            _Request("AUTOPILOT_VERSION", REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
            _Request(
                "HOME_POSITION",
                REQUEST_MESSAGE,
                dialect.MAVLINK_MSG_ID_HOME_POSITION,
                policy=_HOME_RETRY_POLICY,
                give_up=False,
            ),
        )
        self._in_flight: dict[int, tuple[_Request, RetryTimer]] = {}
        self.idle_until_ns = 0
        """No request is due before, unless a message comes."""
        self.round_trip_s = 0.0
        """From a stream's request to its ACK; 0 before it was measured."""
        self._is_unambiguous = True
        """True if no stream was requested twice: an ACK then answers the request in flight."""

    def begin(self) -> None:
        """Request everything: at first contact, after a reboot, after a link loss."""
        self._in_flight.clear()
        self._poll_again()
        for request in self._requests:
            request.is_done, request.refusals = False, 0

    def _poll_again(self) -> None:
        self.idle_until_ns = self._record[DUE_NS] = 0

    def poll(self, t_ns: int) -> list[Message]:
        """Return the requests that are due."""
        if t_ns < self.idle_until_ns:
            return []
        out = []
        for number in (MESSAGE_INTERVAL, REQUEST_MESSAGE):
            if number not in self._in_flight:
                request = next(
                    (w for w in self._requests if w.command == number and not _is_satisfied(w, t_ns)), None
                )
                if request is None:
                    continue
                request.is_done = False
                self._in_flight[number] = (request, RetryTimer(self._request(request), request.policy, t_ns))
            timer = self._in_flight[number][1]
            if timer.start_try(t_ns):
                out.append(timer.request)
        self.idle_until_ns = min(self._next_t_ns(number) for number in (MESSAGE_INTERVAL, REQUEST_MESSAGE))
        return out

    def _next_t_ns(self, number: int) -> int:
        """Return when a request of one command may be due, if no message comes until then."""
        if number in self._in_flight:
            return self._in_flight[number][1].next_t_ns
        rates = (
            w for w in self._requests if w.command == number and w.stall_ns and w.refusals < _MAX_REFUSALS
        )
        return min((w.seen_t_ns + w.stall_ns for w in rates), default=_NEVER_NS)

    def heard(self, name: str, t_ns: int) -> None:
        """Note a message of type `name`."""
        for request in self._requests:
            if request.message_type == name:
                request.seen_t_ns = max(request.seen_t_ns, t_ns)
                if request.command == REQUEST_MESSAGE:
                    self._set_done(request)

    def acknowledged(self, ack: Message, t_ns: int) -> str:
        """Process a COMMAND_ACK; return the message type that the vehicle finally refuses, if any.

        A message that comes anyway is not refused: PX4 denies an interval for MISSION_CURRENT and sends it
        once a second.
        """
        number, result = ack.command, ack.result
        request, timer = self._in_flight.get(number, (None, None))
        if request is None or not is_for(ack, self._own) or result == dialect.MAV_RESULT_IN_PROGRESS:
            return ""
        if timer is not None and number == MESSAGE_INTERVAL:
            took_s = timer.round_trip_s(t_ns)
            self._is_unambiguous &= took_s is not None
            self.round_trip_s = took_s if took_s and self._is_unambiguous else self.round_trip_s
        if result == dialect.MAV_RESULT_ACCEPTED:
            if number == MESSAGE_INTERVAL:
                request.seen_t_ns = t_ns
                self._set_done(request)
            return ""
        if not request.give_up or result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
            return ""
        request.refusals += 1
        if request.refusals < _MAX_REFUSALS:
            return ""
        self._set_done(request)
        comes_by_itself = request.seen_t_ns > 0 and t_ns - request.seen_t_ns <= request.stall_ns
        return "" if comes_by_itself else request.message_type

    def _set_done(self, request: _Request) -> None:
        request.is_done = True
        self._poll_again()
        if request.command in self._in_flight and self._in_flight[request.command][0] is request:
            del self._in_flight[request.command]

    def _request(self, request: _Request) -> Message:
        return command_long(self._system_id, request.command, request.param1, request.param2)


def _rate(name: str, message_id: int, rate_hz: float) -> _Request:
    stall_ns = ns(max(_MIN_STALL_S, _STALL_PERIODS / rate_hz))
    return _Request(name, MESSAGE_INTERVAL, message_id, 1e6 / rate_hz, stall_ns=stall_ns)


def _is_satisfied(request: _Request, t_ns: int) -> bool:
    """Return True if there is nothing to request: done and, for a granted stream, not stalled."""
    is_stalled = 0 < request.stall_ns < t_ns - request.seen_t_ns and request.refusals < _MAX_REFUSALS
    return request.is_done and not is_stalled
