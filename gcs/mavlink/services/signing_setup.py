"""SETUP_SIGNING: gives a vehicle its signing key, and checks that it uses it. Sans-I/O.

SETUP_SIGNING (https://mavlink.io/en/messages/common.html#SETUP_SIGNING) has no answer and carries the key in
the clear. It is sent until the vehicle signs with the key. Then a request signed with the key is sent; its
answer proves both directions. ArduPilot takes no key while armed: nothing is sent then. Frames to a vehicle
that signs with its old key are signed with that key.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Encoder, Frame
from gcs.mavlink.frames.signing import is_signed_by, signed, timestamp_of
from gcs.mavlink.services.retry import ns
from gcs.safe_text import printable

Outcome: TypeAlias = Literal["", "done", "failed"]

_RETRY_NS: Final = ns(1.0)
_ARMED: Final = dialect.MAV_MODE_FLAG_SAFETY_ARMED
_LINK_ID: Final = 0
_NO_KEY_TAKEN: Final = "did not begin to sign with the key: does its firmware sign on this port?"
_HAS_ANOTHER_KEY: Final = (
    "keeps signing with a key that is not in the file: name the file that has it with gcs keys rotate, or "
    "use ArduPilot's first serial port, which takes a new key without the old one"
)


class SigningSetup:
    """Installation of a key on one vehicle.

    Parameters
    ----------
    system_id : int
    key : bytes
        New key.
    old : bytes, optional
        Key that the vehicle has, as far as known.
    next_time : callable
        Takes a time; returns a signing time later than any before. Shared by all installations.
    deadline_ns : int
        Time to give up.
    """

    def __init__(
        self,
        system_id: int,
        key: bytes,
        old: bytes | None,
        next_time: Callable[[int], int],
        deadline_ns: int,
    ) -> None:
        self.system_id = system_id
        self.outcome: Outcome = ""
        self.detail = "was not heard: is it on, with this system id, and is no service on this link?"
        self.sent = 0
        """SETUP_SIGNING frames sent."""
        self._key = key
        self._old = old
        self._next_time = next_time
        self._deadline_ns = deadline_ns
        self._encode = Encoder()
        self._heard = self._is_signed = self._holds_old = self._holds_new = self._has_requested = False
        self._due_ns = 0

    def receive(self, frame: Frame) -> None:
        """Process a frame of any sender."""
        if self.outcome or (frame.system_id, frame.component_id) != (self.system_id, AUTOPILOT_COMPONENT_ID):
            return
        self._is_signed = frame.signed
        self._holds_new = frame.signed and is_signed_by(frame.data, self._key)
        if frame.signed and self._old is not None and not self._holds_new:
            self._holds_old = is_signed_by(frame.data, self._old)
        message = frame.message()
        name = "" if message is None else message.get_type()
        if message is not None and name == "HEARTBEAT" and message.autopilot != dialect.MAV_AUTOPILOT_INVALID:
            self._on_heartbeat(armed=bool(message.base_mode & _ARMED))
        elif message is not None and name == "STATUSTEXT" and "sign" in message.text.lower():
            self.detail = f"said: {printable(message.text)}"
        elif message is not None and name == "COMMAND_ACK" and self._holds_new and self._has_requested:
            self.outcome = "done"
            self.detail = "signs with the key, and accepts frames signed with it"

    def _on_heartbeat(self, *, armed: bool) -> None:
        if armed and not self._holds_new:
            self.outcome = "failed"
            self.detail = "is armed: an autopilot accepts a key on the ground only; disarm it, then try again"
            return
        if not self._heard:
            self._heard = True
            self.detail = _HAS_ANOTHER_KEY if self._is_signed and not self._holds_old else _NO_KEY_TAKEN

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send."""
        if self.outcome or t_ns < self._due_ns:
            return []
        if t_ns >= self._deadline_ns:
            self.outcome = "failed"
            return []
        if not self._heard:
            return []
        self._due_ns = t_ns + _RETRY_NS
        if self._holds_new:
            self._has_requested = True
            self.detail = "signs with the key, but did not answer frames signed with it"
            return [self._signed(self._request(), self._key, t_ns)]
        self.sent += 1
        setup = dialect.MAVLink_setup_signing_message(
            self.system_id, AUTOPILOT_COMPONENT_ID, list(self._key), timestamp_of(t_ns)
        )
        frame = self._encode(setup)
        return [self._signed(frame, self._old, t_ns) if self._old and self._holds_old else frame]

    def _request(self) -> bytes:
        fields = (dialect.MAV_CMD_REQUEST_MESSAGE, 0, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        message = dialect.MAVLink_command_long_message(
            self.system_id, AUTOPILOT_COMPONENT_ID, *fields, 0, 0, 0, 0, 0, 0
        )
        return self._encode(message)

    def _signed(self, frame: bytes, key: bytes, t_ns: int) -> bytes:
        return signed(frame, key, _LINK_ID, self._next_time(t_ns))
