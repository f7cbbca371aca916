"""What we ask of each vehicle, until it gives it: rates of messages, its version, its home.

Sources: https://mavlink.io/en/messages/common.html, MAV_CMD_SET_MESSAGE_INTERVAL (511) and
MAV_CMD_REQUEST_MESSAGE (512). A COMMAND_ACK names the command, not the message that it was about, so of each
command one request is on its way at a time. A message asked for is its own answer; a rate is watched after
its ACK, since a late ACK of the request before may have been taken for it, and an autopilot may change its
rates by itself: when the stream dries up it is asked for again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.fleet.telemetry_table import DUE_NS, Row, new_row
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.commands import MESSAGE_INTERVAL, REQUEST_MESSAGE, command_long
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer, ns

_FOR_EVER: Final = RetryPolicy(wait_s=1.0, max_wait_s=5.0, max_tries=0)
_HOME: Final = RetryPolicy(wait_s=2.0, max_wait_s=2.0, max_tries=0)
_MAX_REFUSALS: Final = 3
_DRY_S: Final = 3.0
_DRY_PERIODS: Final = 5
_NEVER_NS: Final = 2**63 - 1


@dataclass(slots=True)
class _Want:
    shows: str
    """Message type that it is about."""
    command: int
    param1: float
    param2: float = 0.0
    policy: RetryPolicy = _FOR_EVER
    dry_ns: int = 0
    """For a rate: without the message for so long it is asked for again."""
    give_up: bool = True
    """Whether refusals end it; home is refused until the vehicle has one."""
    met: bool = False
    refusals: int = 0
    seen_t_ns: int = 0


class StreamRequests:
    """The questions to one vehicle. At most two are on their way at a time, one of each command.

    When there may be something new to ask, `DUE_NS` in the vehicle's row says so.
    """

    def __init__(
        self, system_id: int, own: tuple[int, int], position_rate_hz: float, row: Row | None = None
    ) -> None:
        self._row = new_row() if row is None else row
        self._system_id, self._own = system_id, own
        self._wants = (
            _rate("GLOBAL_POSITION_INT", dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, position_rate_hz),
            _rate("MISSION_CURRENT", dialect.MAVLINK_MSG_ID_MISSION_CURRENT, 1.0),
            _Want("AUTOPILOT_VERSION", REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
            _Want(
                "HOME_POSITION",
                REQUEST_MESSAGE,
                dialect.MAVLINK_MSG_ID_HOME_POSITION,
                policy=_HOME,
                give_up=False,
            ),
        )
        self._in_flight: dict[int, tuple[_Want, RetryTimer]] = {}
        self.idle_until_ns = 0
        """Before then nothing is due, unless something is heard."""
        self.round_trip_s = 0.0
        """From a rate's request to its ACK; 0 before that was measured."""
        self._is_plain = True
        """True if no rate was asked for twice, so that an ACK answers the request on its way."""

    def begin(self) -> None:
        """Ask for everything: on contact, after a reboot, after a silence."""
        self._in_flight.clear()
        self._look_again()
        for want in self._wants:
            want.met, want.refusals = False, 0

    def _look_again(self) -> None:
        self.idle_until_ns = self._row[DUE_NS] = 0

    def poll(self, t_ns: int) -> list[Message]:
        """Questions that are due."""
        if t_ns < self.idle_until_ns:
            return []
        out = []
        for number in (MESSAGE_INTERVAL, REQUEST_MESSAGE):
            if number not in self._in_flight:
                want = next((w for w in self._wants if w.command == number and not _given(w, t_ns)), None)
                if want is None:
                    continue
                want.met = False
                self._in_flight[number] = (want, RetryTimer(self._request(want), want.policy, t_ns))
            timer = self._in_flight[number][1]
            if timer.start_try(t_ns):
                out.append(timer.request)
        self.idle_until_ns = min(self._next_t_ns(number) for number in (MESSAGE_INTERVAL, REQUEST_MESSAGE))
        return out

    def _next_t_ns(self, number: int) -> int:
        """When something about one command can be due, if nothing is heard until then."""
        if number in self._in_flight:
            return self._in_flight[number][1].next_t_ns
        rates = (w for w in self._wants if w.command == number and w.dry_ns and w.refusals < _MAX_REFUSALS)
        return min((w.seen_t_ns + w.dry_ns for w in rates), default=_NEVER_NS)

    def heard(self, name: str, t_ns: int) -> None:
        """Note that a message of type `name` came."""
        for want in self._wants:
            if want.shows == name:
                want.seen_t_ns = max(want.seen_t_ns, t_ns)
                if want.command == REQUEST_MESSAGE:
                    self._met(want)

    def acknowledged(self, ack: Message, t_ns: int) -> str:
        """Take a COMMAND_ACK; returns the message type that the vehicle finally refuses to give.

        Not one that comes all the same: PX4 refuses a rate for MISSION_CURRENT, and sends it once a second.
        """
        number, result = ack.command, ack.result
        want, timer = self._in_flight.get(number, (None, None))
        ours = ack.target_system in (0, self._own[0]) and ack.target_component in (0, self._own[1])
        if want is None or not ours or result == dialect.MAV_RESULT_IN_PROGRESS:
            return ""
        if timer is not None and number == MESSAGE_INTERVAL:
            took_s = timer.round_trip_s(t_ns)
            self._is_plain &= took_s is not None
            self.round_trip_s = took_s if took_s and self._is_plain else self.round_trip_s
        if result == dialect.MAV_RESULT_ACCEPTED:
            if number == MESSAGE_INTERVAL:
                want.seen_t_ns = t_ns
                self._met(want)
            return ""
        if not want.give_up or result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
            return ""
        want.refusals += 1
        if want.refusals < _MAX_REFUSALS:
            return ""
        self._met(want)
        comes_by_itself = want.seen_t_ns > 0 and t_ns - want.seen_t_ns <= want.dry_ns
        return "" if comes_by_itself else want.shows

    def _met(self, want: _Want) -> None:
        want.met = True
        self._look_again()
        if want.command in self._in_flight and self._in_flight[want.command][0] is want:
            del self._in_flight[want.command]

    def _request(self, want: _Want) -> Message:
        return command_long(self._system_id, want.command, want.param1, want.param2)


def _rate(name: str, message_id: int, rate_hz: float) -> _Want:
    dry_ns = ns(max(_DRY_S, _DRY_PERIODS / rate_hz))
    return _Want(name, MESSAGE_INTERVAL, message_id, 1e6 / rate_hz, dry_ns=dry_ns)


def _given(want: _Want, t_ns: int) -> bool:
    """Whether there is nothing to ask: met, and if it is a rate that was granted, still flowing."""
    dried_up = 0 < want.dry_ns < t_ns - want.seen_t_ns and want.refusals < _MAX_REFUSALS
    return want.met and not dried_up
