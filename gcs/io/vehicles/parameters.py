"""Parameters of vehicles: a session that reads them by name, or sets one and reads it back."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.io.vehicles.session import NOT_HEARD, VehicleSession
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.parameter_protocol import ParameterReader, ParameterSetter, is_bytewise

_ARMED = dialect.MAV_MODE_FLAG_SAFETY_ARMED


class ParameterTask:
    """Parameters of one vehicle, read by name; the first is set before if a value is given.

    Parameters
    ----------
    names : sequence of str
        Parameters to read.
    value : float or None
        New value of the first.
    armed_too : bool
        True to change an armed vehicle as well.
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
        self._names = tuple(names)
        self._value = value
        self._encode = encode
        self._armed_too = armed_too
        self._bytewise: bool | None = None
        self._armed = False
        self._setting: ParameterSetter | None = None
        self._reading: ParameterReader | None = None
        self._refusal = ""

    @property
    def is_done(self) -> bool:
        """True if all parameters were read, or the task was refused."""
        return bool(self._refusal) or (self._reading is not None and self._reading.is_done)

    @property
    def ok(self) -> bool:
        """True if every value is known, and a new value is set."""
        return self.is_done and all(row[1] for row in self.rows())

    def rows(self) -> list[tuple[str, bool, float | None, str]]:
        """Return (name, True if as requested, value if known, detail) of each parameter."""
        values = {} if self._reading is None else self._reading.values
        if self._bytewise is None:
            return [(name, False, None, NOT_HEARD) for name in self._names]
        if self._refusal:
            return [(name, False, None, self._refusal) for name in self._names]
        if self._setting is not None and (self._setting.outcome is None or not self._setting.outcome[0]):
            _, why = self._setting.outcome or (False, "not finished in time: its value is unknown")
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
        """Advance the timers; return the frames to send, none before the first heartbeat."""
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
        if self._reading is None:  # A new value counts after a read-back.
            names = [(name,) for name in self._names]
            self._reading = ParameterReader(self.vehicle, names, self._bytewise, self._encode)
        return self._reading.poll(t_ns)

    def receive(self, message: Message, _t_ns: int) -> list[bytes]:
        """Process a message of the vehicle; return no frames."""
        if message.get_type() == "HEARTBEAT":
            self._bytewise = is_bytewise(message.autopilot, None)
            self._armed = bool(message.base_mode & _ARMED)
        for task in (self._setting, self._reading):
            if task is not None:
                task.receive(message)
        return []


def access_parameters(
    config: Config,
    source: str,
    vehicles: Sequence[int],
    names: Sequence[str],
    value: float | None,
    *,
    wait_s: float,
    link: str | None,
    armed_too: bool = False,
) -> list[ParameterTask]:
    """Read parameters of vehicles, or set one; return the task of each vehicle.

    Raises
    ------
    ConfigError, LinkError
        The keys cannot be used, or a port cannot be opened.
    """
    session = VehicleSession.of_mission(
        config, source, [dialect.MAVLINK_MSG_ID_PARAM_VALUE], link, writes=value is not None
    )
    tasks = [ParameterTask(v, names, value, session.fleet.encoder(v), armed_too=armed_too) for v in vehicles]
    asyncio.run(session.run(tasks, wait_s))
    return tasks
