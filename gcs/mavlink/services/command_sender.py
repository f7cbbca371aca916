"""One command to one vehicle, repeated until the vehicle's own heartbeat shows that it was done. Sans-I/O.

Source: https://mavlink.io/en/services/command.html. An ACK says that a command was understood, not that the
vehicle now does it; so an errand ends well when two heartbeats in a row show what was asked for (one may
cross with an earlier command that is still under way on a slow link), and badly when the vehicle refuses it
several times or nothing comes of it. What the vehicle says meanwhile in STATUSTEXT is its reason.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import mode_name
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, GCS_COMPONENT_ID, GCS_SYSTEM_ID, Message
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer
from gcs.safe_text import printable

PATIENCE: Final = RetryPolicy(wait_s=1.0, wait_max_s=3.0, tries=10)
_REFUSALS: Final = 3
_HEARTBEATS: Final = 2
_ARMED: Final[int] = dialect.MAV_MODE_FLAG_SAFETY_ARMED
_WARNING: Final[int] = dialect.MAV_SEVERITY_WARNING


class Shown(NamedTuple):
    """What a heartbeat shows."""

    mode: str
    armed: bool


class CommandSender:
    """A COMMAND_LONG on its way.

    Parameters
    ----------
    question : Message
        The command.
    wanted : callable
        Whether what a heartbeat shows is what was asked for.
    encode : callable
        Message to frame for this vehicle, such as `Fleet.encoder`.
    """

    def __init__(
        self,
        question: Message,
        wanted: Callable[[Shown], bool],
        encode: Callable[[Message], bytes],
        t_ns: int,
        own: tuple[int, int] = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
    ) -> None:
        self.outcome: tuple[bool, str] | None = None
        """(whether it was done, how or why not), once it has ended."""
        self._vehicle: int = question.target_system
        self._command: int = question.command
        self._wanted, self._encode, self._own = wanted, encode, own
        self._asking = RetryTimer(question, PATIENCE, t_ns)
        self._shown = self._refusals = 0
        self._said = self._put_off = ""

    def poll(self, t_ns: int) -> list[bytes]:
        """Let time pass; returns the frames to send."""
        if self.outcome is not None:
            return []
        if self._asking.unanswered(t_ns):
            nothing = f"{self._put_off or 'no answer'} to {self._asking.sent} commands"
            self.outcome = (False, self._said or nothing)
            return []
        # A mode that is shown once already is not asked for again before the next heartbeat.
        return [self._encode(self._asking.question)] if not self._shown and self._asking.due(t_ns) else []

    def receive(self, message: Message) -> None:
        """Take a message of the vehicle."""
        if self.outcome is not None or message.get_srcSystem() != self._vehicle:
            return
        match message.get_type():
            case "HEARTBEAT" if message.get_srcComponent() == AUTOPILOT_COMPONENT_ID:
                self._on_heartbeat(message)
            case "COMMAND_ACK":
                self._on_ack(message)
            case "STATUSTEXT" if message.severity <= _WARNING:
                self._said = printable(str(message.text))

    def _on_heartbeat(self, message: Message) -> None:
        shown = Shown(mode_name(message), bool(message.base_mode & _ARMED))
        self._shown = self._shown + 1 if self._asking.sent and self._wanted(shown) else 0
        if self._shown >= _HEARTBEATS:
            self.outcome = (True, f"{shown.mode}, {'armed' if shown.armed else 'disarmed'}")

    def _on_ack(self, message: Message) -> None:
        mine = message.target_system in (0, self._own[0]) and message.target_component in (0, self._own[1])
        if not mine or message.command != self._command:
            return
        if message.result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
            self._put_off = (
                "TEMPORARILY_REJECTED"  # it may do so later: PX4 says so of AUTO without a mission
            )
            return
        if message.result in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS):
            return
        self._refusals += 1
        if self._refusals >= _REFUSALS:
            name = dialect.enums["MAV_RESULT"].get(message.result)
            result = name.name.removeprefix("MAV_RESULT_") if name is not None else str(message.result)
            self.outcome = (False, f"{result}: {self._said}" if self._said else result)
