"""File of signing keys, and the file of signing times next to it.

A key file is TOML, for its owner alone (mode 600), and is replaced whole and atomically::

    default = "64 hex digits"              # all vehicles without a key of their own

    [links]
    "serial:/dev/ttyUSB0:57600" = "..."    # all vehicles on this endpoint; or a ground station's endpoint

    [vehicles]
    3 = "..."                              # system id; "2:3" on network 2

    [pending]
    3 = "..."                              # new key of a rotation; the vehicle may have it already

The signing time (``keys.toml.time``) must never decrease, or vehicles reject our frames. It is written ahead
of the time in use, so that a crash loses nothing. Stream times belong to the stored Unix time; after a
crash they are advanced (`TimeFile.read`).
"""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from gcs.config import Table, convert, decode_toml
from gcs.endpoints import parse_endpoint
from gcs.errors import ConfigError, LinkError
from gcs.files import read_bytes, read_text
from gcs.mavlink.frames.signing import KEY_BYTES, NS_PER_TICK, Keys
from gcs.mistake_codes import MistakeCode
from gcs.model import NS_PER_S, vehicle_name, vehicle_of

MAX_ADVANCE_NS: Final = 30 * NS_PER_S
"""Greatest advance of the stream times after a crash: three save periods."""

_MAX_BYTES: Final = 4_000_000
_HEAD: Final = "# MAVLink signing keys: secret. They allow to command the vehicles.\n"


class _KeyTable(Table, frozen=True, kw_only=True):
    default: str = ""
    links: dict[str, str] = msgspec.field(default_factory=dict)
    vehicles: dict[str, str] = msgspec.field(default_factory=dict)
    pending: dict[str, str] = msgspec.field(default_factory=dict)


class _TimeTable(Table, frozen=True, kw_only=True):
    timestamp: int
    streams: dict[str, int] = msgspec.field(default_factory=dict)
    unix_ns: int = 0


@dataclass(slots=True)
class KeyFile:
    """Content of a key file."""

    path: Path
    default: bytes | None = field(default=None, repr=False)
    links: dict[str, bytes] = field(default_factory=dict, repr=False)
    vehicles: dict[int, bytes] = field(default_factory=dict, repr=False)
    pending: dict[int, bytes] = field(default_factory=dict, repr=False)

    @property
    def keys(self) -> Keys:
        """The keys in use."""
        return Keys(dict(self.vehicles), dict(self.links), self.default)

    def save(self) -> None:
        """Replace the file; raises `ConfigError` if it cannot be written."""
        parts = [_HEAD]
        if self.default is not None:
            parts.append(f'default = "{self.default.hex()}"\n')
        named = {vehicle_name(vehicle): key for vehicle, key in sorted(self.vehicles.items())}
        waiting = {vehicle_name(vehicle): key for vehicle, key in sorted(self.pending.items())}
        for title, keys in (("links", self.links), ("vehicles", named), ("pending", waiting)):
            if keys:
                parts.append(f"\n[{title}]\n" + "".join(f'"{n}" = "{k.hex()}"\n' for n, k in keys.items()))
        try:
            write_secret(self.path, "".join(parts).encode())
        except OSError as error:
            raise ConfigError(
                str(self.path), "", MistakeCode.NO_ACCESS, f"cannot be written: {error.strerror}"
            ) from None


def read_keys(path: Path) -> KeyFile:
    """Read a key file.

    Raises
    ------
    ConfigError
        When it cannot be read, is readable by others, or has an invalid key. The text has no key.
    """
    source = str(path)
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise ConfigError(
                source,
                "",
                MistakeCode.INVALID_FILE,
                "is a folder: expected a key file, as `gcs keys new` makes one",
            )
        if mode & (stat.S_IRWXG | stat.S_IRWXO):
            problem = f"others may read these keys (mode {stat.S_IMODE(mode):o}): chmod 600 {path}"
            raise ConfigError(source, "", MistakeCode.INSECURE, problem)
        text = read_text(path, _MAX_BYTES)
    except FileNotFoundError:
        raise ConfigError(
            source, "", MistakeCode.NOT_FOUND, f"there is no such key file: `gcs keys new {path}` makes one"
        ) from None
    except OSError as error:
        raise ConfigError(source, "", MistakeCode.NO_ACCESS, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(source, "", MistakeCode.INVALID_FILE, "not valid TOML") from None
    try:
        raw = decode_toml(text, source)
    except ConfigError:  # Its text would show a key.
        raise ConfigError(source, "", MistakeCode.INVALID_FILE, "not valid TOML") from None
    table = convert(raw, _KeyTable, source)
    return KeyFile(
        path,
        _key(source, "default", table.default) if table.default else None,
        {_link_name(source, name): _key(source, f"links.{name}", v) for name, v in table.links.items()},
        _vehicle_keys(source, "vehicles", table.vehicles),
        _vehicle_keys(source, "pending", table.pending),
    )


def _vehicle_keys(source: str, table: str, entries: Mapping[str, str]) -> dict[int, bytes]:
    found = {}
    for name, value in entries.items():
        try:
            vehicle = vehicle_of(name)
        except ValueError:
            problem = 'expected a system id, or "network:system id"'
            raise ConfigError(source, f"{table}.{name}", MistakeCode.WRONG_TYPE, problem) from None
        found[vehicle] = _key(source, f"{table}.{name}", value)
    return found


def _link_name(source: str, name: str) -> str:
    try:
        return str(parse_endpoint(name))
    except LinkError as error:
        raise ConfigError(source, f"links.{name}", MistakeCode.WRONG_TYPE, error.problem) from None


def _key(source: str, where: str, text: str) -> bytes:
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES or not any(key):
        raise ConfigError(
            source,
            where,
            MistakeCode.WRONG_TYPE,
            f"expected a key: {2 * KEY_BYTES} hex digits, not all of them 0",
        )
    return key


def write_secret(path: Path, data: bytes) -> None:
    """Replace a file atomically, with mode 600."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.new")
    temporary.unlink(missing_ok=True)
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


class TimeFile:
    """File of the signing time, and that of each stream."""

    def __init__(self, keys: Path) -> None:
        self.path = keys.with_name(keys.name + ".time")

    def read(self, unix_ns: int) -> tuple[int, dict[str, int]]:
        """Return the first signing time, and those of the streams; zero and none without a file.

        After a crash the stream times advance by the time since they were written, at most by
        `MAX_ADVANCE_NS`, and by that much if the clock was set back: frames accepted before the crash are
        older, and new frames are later.

        Parameters
        ----------
        unix_ns : int
            Unix time now, nanoseconds.

        Raises
        ------
        ConfigError
            When it is damaged.
        """
        try:
            table = msgspec.json.decode(read_bytes(self.path, _MAX_BYTES), type=_TimeTable)
        except FileNotFoundError:
            return 0, {}
        except OSError as error:
            raise ConfigError(
                str(self.path), "", MistakeCode.NO_ACCESS, f"cannot be read: {error.strerror}"
            ) from None
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            problem = "is damaged; with a right clock it can be deleted: vehicles follow the later time"
            raise ConfigError(str(self.path), "", MistakeCode.INVALID_FILE, problem) from None
        if not table.unix_ns:
            return table.timestamp, table.streams
        passed_ns = unix_ns - table.unix_ns
        advance = (passed_ns if 0 <= passed_ns <= MAX_ADVANCE_NS else MAX_ADVANCE_NS) // NS_PER_TICK
        return table.timestamp, {stream: time + advance for stream, time in table.streams.items()}

    def write(self, timestamp: int, streams: Mapping[str, int], unix_ns: int = 0) -> None:
        """Replace the file; raises `OSError`.

        Parameters
        ----------
        timestamp : int
            First signing time after a restart.
        streams : mapping
            Signing time of each stream.
        unix_ns : int
            Unix time now in nanoseconds; 0 at the end of a run, for final stream times.
        """
        table = _TimeTable(timestamp=timestamp, streams=dict(streams), unix_ns=unix_ns)
        write_secret(self.path, msgspec.json.encode(table))
