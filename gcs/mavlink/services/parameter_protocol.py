"""Parameter protocol with one vehicle: `ParameterReader`, `ParameterSetter`. Sans-I/O.

https://mavlink.io/en/services/parameter.html. A value travels as a float32. ArduPilot converts it (C cast),
PX4 copies its bytes, to be read by `param_type`. AUTOPILOT_VERSION's capabilities name it, else the
firmware. A vehicle does not answer for an unknown name: after the last try it counts as absent, even if only
the link lost it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import (
    AUTOPILOT_COMPONENT_ID,
    HEADER_BYTES_V1,
    HEADER_BYTES_V2,
    MAGIC_V2,
    Message,
)
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer
from gcs.model import system_of
from gcs.safe_text import printable

_RETRY_POLICY: Final = RetryPolicy(wait_s=0.5, max_wait_s=2.0, max_tries=5)
_MAX_IN_FLIGHT: Final = 6
"""A telemetry radio carries as many requests and answers in half a second."""
_FORMATS: Final = {
    dialect.MAV_PARAM_TYPE_UINT8: "<Bxxx",
    dialect.MAV_PARAM_TYPE_INT8: "<bxxx",
    dialect.MAV_PARAM_TYPE_UINT16: "<Hxx",
    dialect.MAV_PARAM_TYPE_INT16: "<hxx",
    dialect.MAV_PARAM_TYPE_UINT32: "<I",
    dialect.MAV_PARAM_TYPE_INT32: "<i",
}
_BYTEWISE: Final[int] = dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
_C_CAST: Final[int] = dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST


def is_bytewise(autopilot: int, capabilities: int | None) -> bool:
    """Return True if a vehicle sends the bytes of an integer rather than its value."""
    if capabilities is not None and capabilities & (_BYTEWISE | _C_CAST):
        return bool(capabilities & _BYTEWISE)
    return bool(autopilot == dialect.MAV_AUTOPILOT_PX4)


def decode_value(message: Message, bytewise: bool) -> float:
    """Return the value of a PARAM_VALUE."""
    form = _FORMATS.get(message.param_type)
    if form is None or not bytewise:
        return float(message.param_value)
    # From the bytes as they came: a float in between may change those of a NaN.
    frame = bytes(message.get_msgbuf())
    at = HEADER_BYTES_V2 if frame[0] == MAGIC_V2 else HEADER_BYTES_V1
    return float(struct.unpack_from(form, frame, at)[0])


def encode_value(value: float, param_type: int, bytewise: bool) -> float:
    """Return the float that carries a value in a PARAM_SET."""
    form = _FORMATS.get(param_type)
    if form is None or not bytewise:
        return value
    return float(struct.unpack("<f", struct.pack(form, round(value)))[0])


def value_problem(value: float, param_type: int) -> str:
    """Return why a value does not fit a MAV_PARAM_TYPE; empty if it does."""
    if not math.isfinite(value):
        return "is no finite number"
    form = _FORMATS.get(param_type)
    if form is None:
        return ""
    bits = 8 * struct.calcsize(form.rstrip("x"))
    low, high = (0, 2**bits - 1) if form[1].isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    if value == round(value) and low <= value <= high:
        return ""
    return f"does not fit: it is a whole number of {low} ... {high}"


class ParameterReader:
    """Reads named parameters of one vehicle, a few at a time.

    Parameters
    ----------
    names : iterable of tuple of str
        Names. A tuple lists the names of one parameter in newer and older firmware: one answer suffices.

    Attributes
    ----------
    values : dict of str to float
        Values received.
    types : dict of str to int
        Their MAV_PARAM_TYPE.
    """

    def __init__(
        self,
        vehicle: int,
        names: Iterable[tuple[str, ...]],
        bytewise: bool,
        encode: Callable[[Message], bytes],
    ) -> None:
        self.values: dict[str, float] = {}
        self.types: dict[str, int] = {}
        self._to = (system_of(vehicle), AUTOPILOT_COMPONENT_ID)
        self._bytewise = bytewise
        self._encode = encode
        self._same = {name: same for same in names for name in same}
        self._waiting = list(self._same)
        self._timers: dict[str, RetryTimer] = {}

    @property
    def is_done(self) -> bool:
        """True if every name was answered or its tries are used up."""
        return not self._waiting and not self._timers

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send."""
        for name in [name for name, timer in self._timers.items() if timer.is_exhausted(t_ns)]:
            del self._timers[name]
        while self._waiting and len(self._timers) < _MAX_IN_FLIGHT:
            name = self._waiting.pop(0)
            request = dialect.MAVLink_param_request_read_message(*self._to, name.encode("ascii"), -1)
            self._timers[name] = RetryTimer(request, _RETRY_POLICY, t_ns)
        return [self._encode(timer.request) for timer in self._timers.values() if timer.start_try(t_ns)]

    def receive(self, message: Message) -> None:
        """Process a message of the vehicle."""
        if (
            message.get_type() != "PARAM_VALUE"
            or (message.get_srcSystem(), message.get_srcComponent()) != self._to
        ):
            return
        name = printable(str(message.param_id))
        if name in self._timers or name in self.values:
            self._timers.pop(name, None)
            for other in self._same[name]:
                if other != name:
                    self._timers.pop(other, None)
                    self._waiting = [waiting for waiting in self._waiting if waiting != other]
            self.values[name] = decode_value(message, self._bytewise)
            self.types[name] = message.param_type


class ParameterSetter:
    """Sets one parameter of a vehicle: reads its type, sets it, and reads it back.

    `outcome` is (True if the value is set, detail or reason), once it has ended.
    """

    def __init__(
        self, vehicle: int, name: str, value: float, bytewise: bool, encode: Callable[[Message], bytes]
    ) -> None:
        self.outcome: tuple[bool, str] | None = None
        self._name = name
        self._value = value
        self._bytewise = bytewise
        self._encode = encode
        self._to = (system_of(vehicle), AUTOPILOT_COMPONENT_ID)
        self._reading = ParameterReader(vehicle, [(name,)], bytewise, encode)
        self._asking: RetryTimer | None = None

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send."""
        if self.outcome is not None:
            return []
        if self._asking is None:
            frames = self._reading.poll(t_ns)
            if self._reading.is_done:
                self._read(t_ns)
            return frames
        if self._asking.is_exhausted(t_ns):
            why = f"it could not be set to {self._value:g}"
            self.outcome = (False, f"{self._name} stays {self._value_on_vehicle:g}: {why}")
            return []
        return [self._encode(self._asking.request)] if self._asking.start_try(t_ns) else []

    def receive(self, message: Message) -> None:
        """Process a message of the vehicle."""
        self._reading.receive(message)
        if self._asking is not None and self._asking.sent and self._is_set():
            self.outcome = (True, f"{self._name} = {self._value:g}")

    def _read(self, t_ns: int) -> None:
        if self._name not in self._reading.values:
            self.outcome = (False, f"{self._name}: no such parameter, or no answer")
        elif self._is_set():
            self.outcome = (True, f"{self._name} = {self._value:g}, as it was")
        elif problem := value_problem(self._value, self._reading.types[self._name]):
            self.outcome = (
                False,
                f"{self._name} stays {self._value_on_vehicle:g}: {self._value:g} {problem}",
            )
        else:
            kind = self._reading.types[self._name]
            value = encode_value(self._value, kind, self._bytewise)
            request = dialect.MAVLink_param_set_message(*self._to, self._name.encode("ascii"), value, kind)
            self._asking = RetryTimer(request, _RETRY_POLICY, t_ns)

    @property
    def _value_on_vehicle(self) -> float:
        return self._reading.values[self._name]

    def _is_set(self) -> bool:
        held = self._reading.values.get(self._name, math.nan)
        return math.isclose(held, self._value, rel_tol=1e-6, abs_tol=1e-6)
