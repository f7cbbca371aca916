"""Parameters of vehicles: a visit that reads them by name, or sets one and reads it back."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.io.vehicles.session import VehicleSession
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.parameters import ParameterReader, ParameterSetter, is_bytewise

_ARMED = dialect.MAV_MODE_FLAG_SAFETY_ARMED


class ParameterTalk:
    """One vehicle: its parameters, read by name; one of them set before, where a value is given.

    Parameters
    ----------
    names : sequence of str
        What to read.
    value : float or None
        To be given to the first of them.
    armed_too : bool
        True if an armed vehicle is to be changed as well.
    """

    def __init__(
        self,
        vehicle: int,
        names: Sequence[str],
        value: float | None,
        encode: Callable[[Message], bytes],
        *,
        armed_too: bool = False,
    ) -> None:
        self.vehicle = vehicle
        self._names, self._value, self._encode, self._armed_too = tuple(names), value, encode, armed_too
        self._bytewise: bool | None = None
        self._armed = False
        self._setting: ParameterSetter | None = None
        self._reading: ParameterReader | None = None
        self._refusal = ""

    @property
    def is_done(self) -> bool:
        """True if all has been read, or nothing can be done."""
        return bool(self._refusal) or (self._reading is not None and self._reading.is_done)

    @property
    def ok(self) -> bool:
        """True if every value is known, and that which was to be set is as wanted."""
        return self.is_done and all(row[1] for row in self.rows())

    def rows(self) -> list[tuple[str, bool, float | None, str]]:
        """Return (name, whether it is as asked, its value if known, how it went) of each parameter."""
        values = {} if self._reading is None else self._reading.values
        if self._bytewise is None:
            return [(name, False, None, "vehicle not heard") for name in self._names]
        if self._refusal:
            return [(name, False, None, self._refusal) for name in self._names]
        if self._setting is not None and (self._setting.outcome is None or not self._setting.outcome[0]):
            _, why = self._setting.outcome or (False, "not finished in time: what it holds is not known")
            return [(name, False, values.get(name), why) for name in self._names]
        if self._reading is None or not self._reading.is_done:
            return [(name, False, None, "not finished in time") for name in self._names]
        return [self._row(name, values.get(name)) for name in self._names]

    def _row(self, name: str, value: float | None) -> tuple[str, bool, float | None, str]:
        if value is None:
            return name, False, None, "no such parameter, or no answer"
        if self._setting is None:
            return name, True, value, ""
        assert self._setting.outcome is not None
        return name, True, value, self._setting.outcome[1]

    def poll(self, t_ns: int) -> list[bytes]:
        """Let time pass; returns frames to send, none before a heartbeat has told whose firmware it is."""
        if self._bytewise is None or self.is_done:
            return []
        if self._value is not None and self._setting is None:
            self._setting = ParameterSetter(
                self.vehicle, self._names[0], self._value, self._bytewise, self._encode
            )
        if self._setting is not None and self._setting.outcome is None:
            if self._armed and not self._armed_too:
                self._refusal = "armed: land and disarm it first, or say --armed"
                return []
            return self._setting.poll(t_ns)
        if self._reading is None:  # what is set counts when it is read back anew
            names = [(name,) for name in self._names]
            self._reading = ParameterReader(self.vehicle, names, self._bytewise, self._encode)
        return self._reading.poll(t_ns)

    def receive(self, message: Message, _t_ns: int) -> list[bytes]:
        """Take a message of the vehicle; returns no frames."""
        if message.get_type() == "HEARTBEAT":
            self._bytewise = is_bytewise(message.autopilot, None)
            self._armed = bool(message.base_mode & _ARMED)
        for task in (self._setting, self._reading):
            if task is not None:
                task.receive(message)
        return []


def ask_parameters(
    config: Config,
    source: str,
    vehicles: Sequence[int],
    names: Sequence[str],
    value: float | None,
    *,
    wait_s: float,
    link: str | None,
    armed_too: bool = False,
) -> list[ParameterTalk]:
    """Read parameters of some vehicles of a mission, or set one; returns how it went for each.

    Raises
    ------
    ConfigError, LinkError
        When the keys cannot be used, or a port cannot be had.
    """
    visit = VehicleSession(
        config, source, [dialect.MAVLINK_MSG_ID_PARAM_VALUE], link, writes=value is not None
    )
    talks = [ParameterTalk(v, names, value, visit.fleet.encoder(v), armed_too=armed_too) for v in vehicles]
    asyncio.run(visit.run(talks, wait_s))
    return talks
