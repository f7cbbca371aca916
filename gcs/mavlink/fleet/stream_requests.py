"""Requests to each vehicle for message intervals, its version and its home position, repeated until granted.

MAV_CMD_SET_MESSAGE_INTERVAL (511) and MAV_CMD_REQUEST_MESSAGE (512) of
https://mavlink.io/en/messages/common.html. A COMMAND_ACK names the command, not the message id. So one
request of each command is in flight. A requested message is its own answer. A stream is watched after its
ACK: the ACK may belong to the request before, and an autopilot may change its rates. A stalled stream is
requested again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.fleet.telemetry_table import DUE_NS, VehicleRecord
from gcs.mavlink.frames.codec import Message, is_for
from gcs.mavlink.services.command_sender import MESSAGE_INTERVAL, REQUEST_MESSAGE, command_long
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer, ns

_RETRY_POLICY: Final = RetryPolicy(wait_s=1.0, max_wait_s=5.0, max_tries=0)
_HOME_RETRY_POLICY: Final = RetryPolicy(wait_s=2.0, max_wait_s=2.0, max_tries=0)
_MAX_REFUSALS: Final = 3
_MIN_STALL_S: Final = 3.0
_STALL_PERIODS: Final = 5
_NEVER_NS: Final = 2**63 - 1


@dataclass(frozen=True, slots=True)
class MessageRequest:
    """One request to every vehicle."""

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
    is_optional: bool = False
    """True if nobody is told of a refusal."""


def message_requests(position_rate_hz: float) -> tuple[MessageRequest, ...]:
    """Return the requests to every vehicle, by priority."""
    return (
        _rate("GLOBAL_POSITION_INT", dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, position_rate_hz),
        _rate("MISSION_CURRENT", dialect.MAVLINK_MSG_ID_MISSION_CURRENT, 1.0),
        _health("SYS_STATUS", dialect.MAVLINK_MSG_ID_SYS_STATUS),
        _health("GPS_RAW_INT", dialect.MAVLINK_MSG_ID_GPS_RAW_INT),
        _health("VFR_HUD", dialect.MAVLINK_MSG_ID_VFR_HUD),
        _health("EXTENDED_SYS_STATE", dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE),
        MessageRequest("AUTOPILOT_VERSION", REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
        MessageRequest(
            "HOME_POSITION",
            REQUEST_MESSAGE,
            dialect.MAVLINK_MSG_ID_HOME_POSITION,
            policy=_HOME_RETRY_POLICY,
            give_up=False,
        ),
    )


@dataclass(slots=True)
class RequestProgress:
    """Progress of one request to one vehicle."""

    is_done: bool = False
    refusals: int = 0
    seen_t_ns: int = 0
    """Time of the last message of its type."""


@dataclass(slots=True)
class StreamRecord:
    """Requests to one vehicle: their progress and timers."""

    progress: dict[str, RequestProgress] = field(default_factory=dict)
    """By message type."""
    in_flight: dict[int, tuple[str, RetryTimer]] = field(default_factory=dict)
    """Message type and timer of the request in flight, by command."""
    idle_until_ns: int = 0
    """No request is due before, unless a message comes."""
    round_trip_s: float = 0.0
    """From a stream's request to its ACK; 0 before it was measured."""
    is_unambiguous: bool = True
    """True if no stream was requested twice: an ACK then answers the request in flight."""


class StreamRequests:
    """Requests to one vehicle; at most two are in flight, one of each command.

    Parameters
    ----------
    state : StreamRecord
        Progress so far.
    record : (WIDTH,) array
        The vehicle's row of the telemetry table. `DUE_NS` is set to 0 when a new request may be due.
    """

    def __init__(
        self,
        system_id: int,
        own: tuple[int, int],
        requests: Sequence[MessageRequest],
        state: StreamRecord,
        record: VehicleRecord,
    ) -> None:
        self._system_id = system_id
        self._own = own
        self._requests = {request.message_type: request for request in requests}
        self.state = state
        self._record = record
        for message_type in self._requests:
            state.progress.setdefault(message_type, RequestProgress())

    def begin(self) -> None:
        """Request everything: at first contact, after a reboot, after a link loss."""
        self.state.in_flight.clear()
        self._poll_again()
        for progress in self.state.progress.values():
            progress.is_done = False
            progress.refusals = 0

    def _poll_again(self) -> None:
        self.state.idle_until_ns = self._record[DUE_NS] = 0

    def poll(self, t_ns: int) -> list[Message]:
        """Return the requests that are due."""
        state = self.state
        if t_ns < state.idle_until_ns:
            return []
        out = []
        for number in (MESSAGE_INTERVAL, REQUEST_MESSAGE):
            if number not in state.in_flight:
                open_requests = (r for r in self._of(number) if not self._is_satisfied(r, t_ns))
                request = next(open_requests, None)
                if request is None:
                    continue
                state.progress[request.message_type].is_done = False
                timer = RetryTimer(self._message(request), request.policy, t_ns)
                state.in_flight[number] = (request.message_type, timer)
            timer = state.in_flight[number][1]
            if timer.start_try(t_ns):
                out.append(timer.request)
        state.idle_until_ns = min(self._next_t_ns(number) for number in (MESSAGE_INTERVAL, REQUEST_MESSAGE))
        return out

    def _of(self, number: int) -> Iterator[MessageRequest]:
        """Return the requests of one command, by priority."""
        return (request for request in self._requests.values() if request.command == number)

    def _next_t_ns(self, number: int) -> int:
        """Return when a request of one command may be due, if no message comes until then."""
        if number in self.state.in_flight:
            return self.state.in_flight[number][1].next_t_ns
        rates = ((r.stall_ns, self.state.progress[r.message_type]) for r in self._of(number) if r.stall_ns)
        stalls_t_ns = (p.seen_t_ns + stall_ns for stall_ns, p in rates if p.refusals < _MAX_REFUSALS)
        return min(stalls_t_ns, default=_NEVER_NS)

    def heard(self, name: str, t_ns: int) -> None:
        """Note a message of type `name`."""
        request = self._requests.get(name)
        if request is not None:
            progress = self.state.progress[name]
            progress.seen_t_ns = max(progress.seen_t_ns, t_ns)
            if request.command == REQUEST_MESSAGE:
                self._set_done(request)

    def acknowledged(self, ack: Message, t_ns: int) -> str:
        """Process a COMMAND_ACK; return the message type that the vehicle finally refuses, if any.

        A message that comes anyway is not refused: PX4 denies an interval for MISSION_CURRENT and sends it
        once a second.
        """
        state = self.state
        number = ack.command
        result = ack.result
        if number not in state.in_flight or not is_for(ack, self._own):
            return ""
        if result == dialect.MAV_RESULT_IN_PROGRESS:
            return ""
        name, timer = state.in_flight[number]
        request = self._requests[name]
        progress = state.progress[name]
        if number == MESSAGE_INTERVAL:
            took_s = timer.round_trip_s(t_ns)
            state.is_unambiguous &= took_s is not None
            state.round_trip_s = took_s if took_s and state.is_unambiguous else state.round_trip_s
        if result == dialect.MAV_RESULT_ACCEPTED:
            if number == MESSAGE_INTERVAL:
                progress.seen_t_ns = t_ns
                self._set_done(request)
            return ""
        if not request.give_up or result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
            return ""
        progress.refusals += 1
        if progress.refusals < _MAX_REFUSALS:
            return ""
        self._set_done(request)
        comes_by_itself = progress.seen_t_ns > 0 and t_ns - progress.seen_t_ns <= request.stall_ns
        return "" if comes_by_itself or request.is_optional else name

    def _set_done(self, request: MessageRequest) -> None:
        self.state.progress[request.message_type].is_done = True
        self._poll_again()
        if self.state.in_flight.get(request.command, ("",))[0] == request.message_type:
            del self.state.in_flight[request.command]

    def _is_satisfied(self, request: MessageRequest, t_ns: int) -> bool:
        """Return True if there is nothing to request: done and, for a granted stream, not stalled."""
        progress = self.state.progress[request.message_type]
        silent_ns = t_ns - progress.seen_t_ns
        is_stalled = 0 < request.stall_ns < silent_ns and progress.refusals < _MAX_REFUSALS
        return progress.is_done and not is_stalled

    def _message(self, request: MessageRequest) -> Message:
        return command_long(self._system_id, request.command, request.param1, request.param2)


def _health(name: str, message_id: int) -> MessageRequest:
    """Return the request for a stream that many autopilots send by themselves, once a second."""
    return MessageRequest(name, MESSAGE_INTERVAL, message_id, 1e6, is_optional=True)


def _rate(name: str, message_id: int, rate_hz: float) -> MessageRequest:
    stall_ns = ns(max(_MIN_STALL_S, _STALL_PERIODS / rate_hz))
    return MessageRequest(name, MESSAGE_INTERVAL, message_id, 1e6 / rate_hz, stall_ns=stall_ns)
