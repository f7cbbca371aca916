"""COMMAND_LONG: the messages, and `CommandSender`, which repeats one until it is done. Sans-I/O.

Sources: https://mavlink.io/en/services/command.html, https://mavlink.io/en/messages/common.html#mav_commands.

A COMMAND_ACK says that a command was understood, not that it is done. A command has succeeded when a
heartbeat after its ACK shows it; that heartbeat is requested. Without an ACK, two heartbeats in a row are
needed (one may cross with an earlier command on a slow link), and also in AUTO, which PX4 leaves again if it
rejects its mission. A command has failed after several refusals, or when its tries are used up. The
vehicle's STATUSTEXT gives the reason. A command to fly on ends when a pilot or a failsafe chooses a mode.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import AutopilotProfile, mode_name, profile_of
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.frames.codec import (
    AUTOPILOT_COMPONENT_ID,
    OWN_IDS,
    Message,
    is_for,
)
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer
from gcs.model import system_of
from gcs.safe_text import printable

SET_MODE: Final[int] = dialect.MAV_CMD_DO_SET_MODE
MESSAGE_INTERVAL: Final[int] = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
REQUEST_MESSAGE: Final[int] = dialect.MAV_CMD_REQUEST_MESSAGE
COMMAND_RETRY_POLICY: Final = RetryPolicy(wait_s=1.0, max_wait_s=3.0, max_tries=10)
_MAX_REFUSALS: Final = 3
_MIN_CONFIRMATIONS: Final = 2
_HEARTBEAT: Final[int] = dialect.MAVLINK_MSG_ID_HEARTBEAT
_ARMED: Final[int] = dialect.MAV_MODE_FLAG_SAFETY_ARMED
_WARNING: Final[int] = dialect.MAV_SEVERITY_WARNING


def command_long(vehicle: int, number: int, *params: float) -> Message:
    """Return a COMMAND_LONG; omitted parameters are 0."""
    filled = (*params, *([0.0] * (7 - len(params))))
    return dialect.MAVLink_command_long_message(
        system_of(vehicle), AUTOPILOT_COMPONENT_ID, number, 0, *filled
    )


def set_current_item(vehicle: int, profile: AutopilotProfile, item: int) -> Message:
    """Return the message that makes a vehicle fly to a mission item from where it is.

    MISSION_SET_CURRENT, not the command DO_SET_MISSION_CURRENT: with that one ArduPlane starts the leg at the
    waypoint before (`GCS_MAVLink_Plane.cpp`: `next_wp_crosstrack` is cleared too late). The message may be
    repeated. Its answer is MISSION_CURRENT with the number as sent. ArduPlane takes 0 for its first item:
    then 0 answers nothing else.
    """
    named = item if item > profile.home_items else 0
    return dialect.MAVLink_mission_set_current_message(system_of(vehicle), AUTOPILOT_COMPONENT_ID, named)


def set_mode(vehicle: int, autopilot: int, name: str) -> Message:
    """Return the command that sets the mode; the heartbeat shows the result.

    Raises
    ------
    KeyError
        The autopilot is unknown, or has no such mode.
    """
    profile = profile_of(autopilot)
    if profile is None:
        raise KeyError(autopilot)
    custom = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    return command_long(vehicle, SET_MODE, custom, *profile.mode_numbers(name))


@dataclass(slots=True)
class CommandSender:
    """Sends one COMMAND_LONG until a heartbeat shows it as done."""

    timer: RetryTimer
    """Of the command."""
    mode: str = ""
    """Mode that shows it as done; empty for any."""
    armed: bool | None = None
    """Arming state that shows it as done; None for any."""
    before: str = ""
    """Mode at the begin of a command that ends when another one is chosen meanwhile; empty: it does not."""
    outcome: tuple[bool, str] | None = None
    """(True if done, detail or reason), once it has ended."""
    confirmations: int = 0
    """Heartbeats in a row that show it as done."""
    refusals: int = 0
    rejection: str = ""
    """Result of the last temporary rejection."""
    statustext: str = ""
    """Last warning of the vehicle."""
    is_accepted: bool = False
    """True after an ACK that accepts the command."""
    wants_heartbeat: bool = False
    """True if a heartbeat is requested next: the regular one may be a second away."""

    @classmethod
    def begin(
        cls, request: Message, t_ns: int, *, mode: str = "", armed: bool | None = None, before: str = ""
    ) -> CommandSender:
        """Return the sender of a command that is done in a mode, or in an arming state."""
        return cls(RetryTimer(request, COMMAND_RETRY_POLICY, t_ns), mode, armed, before)

    def poll(self, t_ns: int, encode: Callable[[Message], bytes]) -> list[bytes]:
        """Advance the timers; return the frames to send, framed by an encoder of the vehicle."""
        if self.outcome is not None:
            return []
        if self.timer.is_exhausted(t_ns):
            nothing = f"{self.rejection or 'no answer'} to {self.timer.sent} commands"
            self.outcome = (False, self.statustext or nothing)
            return []
        if self.wants_heartbeat:
            self.wants_heartbeat = False
            return [encode(command_long(self.timer.request.target_system, REQUEST_MESSAGE, _HEARTBEAT))]
        # A mode shown once is not commanded again before the next heartbeat.
        return [encode(self.timer.request)] if not self.confirmations and self.timer.start_try(t_ns) else []

    def receive(self, message: Message) -> None:
        """Process a message of the vehicle."""
        if self.outcome is not None or message.get_srcSystem() != self.timer.request.target_system:
            return
        match message.get_type():
            case "HEARTBEAT" if message.get_srcComponent() == AUTOPILOT_COMPONENT_ID:
                self._on_heartbeat(message)
            case "COMMAND_ACK":
                self._on_ack(message)
            case "STATUSTEXT" if message.severity <= _WARNING:
                self.statustext = printable(str(message.text))

    def _on_heartbeat(self, message: Message) -> None:
        mode = mode_name(message)
        armed = bool(message.base_mode & _ARMED)
        is_done = self.mode in ("", mode) and self.armed in (None, armed)
        self.confirmations = self.confirmations + 1 if self.timer.sent and is_done else 0
        if self.before and mode not in (self.before, self.mode, LOITER):
            self.outcome = (False, f"{mode} was chosen meanwhile")
            return
        if self.confirmations >= (1 if self.is_accepted and self.mode != AUTO else _MIN_CONFIRMATIONS):
            self.outcome = (True, f"{mode}, {'armed' if armed else 'disarmed'}")

    def _on_ack(self, message: Message) -> None:
        is_ours = is_for(message, OWN_IDS)
        if not is_ours or message.command != self.timer.request.command:
            return
        if message.result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
            self.rejection = (
                "TEMPORARILY_REJECTED"  # it may do so later: PX4 says so of AUTO without a mission
            )
            return
        if message.result == dialect.MAV_RESULT_ACCEPTED:
            self.wants_heartbeat |= not self.is_accepted
            self.is_accepted = True
            return
        if message.result == dialect.MAV_RESULT_IN_PROGRESS:
            return
        self.refusals += 1
        if self.refusals >= _MAX_REFUSALS:
            name = dialect.enums["MAV_RESULT"].get(message.result)
            result = name.name.removeprefix("MAV_RESULT_") if name is not None else str(message.result)
            self.outcome = (False, f"{result}: {self.statustext}" if self.statustext else result)
