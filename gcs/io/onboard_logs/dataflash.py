"""ArduPilot's DataFlash logs (``.bin``).

Each message begins with A3 95 and its number; FMT messages (number 128) name its fields and their types.
Messages: https://ardupilot.org/plane/docs/logmessages.html, types: `AP_Logger/LogStructure.h`. Bytes outside
messages are skipped. pymavlink's reader is not used: it does not end on some damaged logs.
"""

from __future__ import annotations

import contextlib
import math
import mmap
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.io.onboard_logs.onboard_telemetry import OnboardTelemetry

HEAD: Final = b"\xa3\x95"
_FMT: Final = 128
_FMT_FIELDS: Final = struct.Struct("<BB4s16s64s")
_TYPES: Final = {
    "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "q": "q", "Q": "Q", "f": "f", "d": "d",
    "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "n": "4s", "N": "16s", "Z": "64s", "a": "64s",
    "g": "e",
}  # fmt: skip
"""`struct` type of each type of ArduPilot."""
_SCALES: Final = {"c": 1e-2, "C": 1e-2, "e": 1e-2, "E": 1e-2, "L": 1e-7}
_TEXTS: Final = "nNZ"
_WEEK_S: Final = 604_800
_GPS_EPOCH_S: Final = 315_964_800
_LEAP_S: Final = 18
"""GPS time is ahead of UTC by so much since 2017."""
_MIN_FIX: Final = 3
_ID_PARAMETERS: Final = ("MAV_SYSID", "SYSID_THISMAV")
_HOME: Final = 1
"""Type of an ORGN message of the home position."""
_ARMED_EVENTS: Final = {10: True, 11: False}
_VEHICLES: Final = {
    "ArduCopter": dialect.MAV_TYPE_QUADROTOR,
    "ArduRover": dialect.MAV_TYPE_GROUND_ROVER,
    "Rover": dialect.MAV_TYPE_GROUND_ROVER,
    "ArduSub": dialect.MAV_TYPE_SUBMARINE,
}


def read_dataflash(path: Path) -> OnboardTelemetry:
    """Read a DataFlash log.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    reader = _Reader()
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        for name, values in _messages(data, reader.handlers):
            with contextlib.suppress(TypeError, ValueError):  # a damaged format has other types
                reader.handlers[name](values)
    return reader.telemetry


@dataclass(frozen=True, slots=True)
class _Format:
    """Form of a kind of messages."""

    name: str
    length: int
    """With the head."""
    fields: struct.Struct | None
    """None if the kind is not wanted, or its types are not known."""
    columns: tuple[str, ...] = ()
    types: str = ""

    def values(self, data: bytes) -> dict[str, Any]:
        """Return the values of a message, by the names of its fields."""
        assert self.fields is not None
        found = dict(zip(self.columns, self.fields.unpack_from(data), strict=False))
        for name, kind in zip(self.columns, self.types, strict=False):
            if kind in _SCALES:
                found[name] *= _SCALES[kind]
            elif kind in _TEXTS:
                found[name] = found[name].split(b"\0")[0].decode("ascii", "replace")
        return found


def _messages(data: mmap.mmap, wanted: Mapping[str, object]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the messages of the wanted kinds; other bytes are skipped."""
    formats = {_FMT: _Format("FMT", 3 + _FMT_FIELDS.size, None)}
    at = data.find(HEAD)
    while 0 <= at <= len(data) - 3:
        kind = formats.get(data[at + 2])
        end = at + (kind.length if kind else 0)
        if kind is None or end > len(data) or data[at : at + 2] != HEAD:
            at = data.find(HEAD, at + 1)
            continue
        content = data[at + 3 : end]
        if kind.name == "FMT":
            made = _format(content, wanted)
            formats.setdefault(content[0], made)
        elif kind.fields is not None:
            yield kind.name, kind.values(content)
        at = end


def _format(content: bytes, wanted: Mapping[str, object]) -> _Format:
    """Return the form of messages that an FMT message states."""
    _, length, *texts = _FMT_FIELDS.unpack(content)
    name, types, columns = (text.split(b"\0")[0].decode("ascii", "replace") for text in texts)
    length = max(length, 3)
    if name not in wanted or not set(types) <= _TYPES.keys():
        return _Format(name, length, None)
    fields = struct.Struct("<" + "".join(_TYPES[one] for one in types))
    if fields.size != length - 3:
        return _Format(name, length, None)
    return _Format(name, length, fields, tuple(columns.split(",")), types)


class _Reader:
    """Makes telemetry of the messages of one log, in their order."""

    def __init__(self) -> None:
        self.telemetry = OnboardTelemetry(1, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA)
        self.handlers: dict[str, Callable[[dict[str, Any]], None]] = {
            "GPS": self._on_gps,
            "PARM": self._on_parameter,
            "POS": self._on_position,
            "XKF1": self._on_velocity,
            "NKF1": self._on_velocity,
            "MODE": self._on_mode,
            "ARM": lambda of: self._set_armed(of, armed=bool(of.get("ArmState"))),
            "STAT": lambda of: self._set_armed(of, armed=bool(of.get("Armed"))),
            "EV": self._on_event,
            "BAT": self._on_battery,
            "ORGN": self._on_origin,
            "MISE": lambda of: self.telemetry.add_item(_t_ns(of), int(of.get("CNum", 0))),
            "MSG": self._on_text,
        }
        self._velocity_m_s = (0.0, 0.0, 0.0)
        self._mode = 0
        self._armed = False

    def _on_gps(self, of: dict[str, Any]) -> None:
        """Take the time of GPS, once."""
        if self.telemetry.shift_ns or of.get("Status", 0) < _MIN_FIX or not of.get("GWk"):
            return
        utc_s = _GPS_EPOCH_S + of["GWk"] * _WEEK_S - _LEAP_S
        self.telemetry.shift_ns = utc_s * 1_000_000_000 + int(of.get("GMS", 0)) * 1_000_000 - _t_ns(of)

    def _on_parameter(self, of: dict[str, Any]) -> None:
        value = of.get("Value", math.nan)
        if of.get("Name") in _ID_PARAMETERS and 1.0 <= value <= 255.0:
            self.telemetry.system_id = int(value)

    def _on_position(self, of: dict[str, Any]) -> None:
        place = [of.get(name, math.nan) for name in ("Lat", "Lng", "Alt", "RelHomeAlt")]
        if not all(map(math.isfinite, place)):
            return
        lat_deg, lon_deg, alt_m, height_m = place
        self.telemetry.add_position(_t_ns(of), (lat_deg, lon_deg), alt_m, height_m, self._velocity_m_s)
        self.telemetry.add_state(_t_ns(of), self._mode, armed=self._armed)

    def _on_velocity(self, of: dict[str, Any]) -> None:
        if of.get("C", 0) == 0:  # of the first estimator
            north, east, down = (float(of.get(name, 0.0)) for name in ("VN", "VE", "VD"))
            self._velocity_m_s = north, east, down

    def _on_mode(self, of: dict[str, Any]) -> None:
        self._mode = int(of.get("ModeNum", of.get("Mode", 0)))
        self.telemetry.add_state(_t_ns(of), self._mode, armed=self._armed)

    def _on_event(self, of: dict[str, Any]) -> None:
        armed = _ARMED_EVENTS.get(of.get("Id", 0))
        if armed is not None:
            self._set_armed(of, armed=armed)

    def _set_armed(self, of: dict[str, Any], *, armed: bool) -> None:
        self._armed = armed
        self.telemetry.add_state(_t_ns(of), self._mode, armed=armed)

    def _on_battery(self, of: dict[str, Any]) -> None:
        if of.get("Inst", 0) == 0:
            volt, ampere, percent = (float(of.get(name, math.nan)) for name in ("Volt", "Curr", "RemPct"))
            self.telemetry.add_battery(_t_ns(of), volt, ampere, percent)

    def _on_origin(self, of: dict[str, Any]) -> None:
        if of.get("Type") == _HOME and {"Lat", "Lng", "Alt"} <= of.keys() and math.isfinite(of["Alt"]):
            self.telemetry.add_home(_t_ns(of), (of["Lat"], of["Lng"]), of["Alt"])

    def _on_text(self, of: dict[str, Any]) -> None:
        text = str(of.get("Message", ""))
        self.telemetry.add_text(_t_ns(of), text)
        self.telemetry.vehicle_type = _VEHICLES.get(text.split(" ")[0], self.telemetry.vehicle_type)


def _t_ns(of: dict[str, Any]) -> int:
    """Return the time of a message since the boot of the autopilot."""
    return int(of.get("TimeUS", 0)) * 1000
