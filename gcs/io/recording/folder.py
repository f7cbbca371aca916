"""Layout of a recording's folder: file names, parts, and metadata of the run.

A recording is a folder::

    run.mcap        every event, effect and truth as JSON with schemas (https://mcap.dev), for Foxglove
    link.tlog       MAVLink traffic in both directions, for QGroundControl, Mission Planner, MAVExplorer
    mission.toml    the mission file that was flown
    versions.json   versions of the software that a result depends on
    firmware        files and logs of real firmware, a folder for each vehicle (``gcs demo --sitl``)

A long run is split into parts: ``run-002.mcap`` with ``link-002.tlog``, and so on. Each MCAP file also holds
the mission file (attachment), the versions and the `Run` (metadata).
"""

from __future__ import annotations

import contextlib
import fcntl
import platform
import re
import struct
import zlib
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import BinaryIO, Final

RUNS_FOLDER: Final = Path("runs")
"""Default folder of recordings and journals."""
MCAP_NAME = "run.mcap"
TLOG_NAME = "link.tlog"
CONFIG_NAME = "mission.toml"
VERSIONS_NAME = "versions.json"
FIRMWARE_NAME: Final = "firmware"
PROFILE: Final = "swarm-gcs"
VERSIONS_METADATA = "versions"
RUN_METADATA = "run"
FORMAT_METADATA = "format"
FORMAT_VERSION = 3
"""Version of the records in a recording; it changes when they cannot be read as before."""
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
_PART: Final = re.compile(r"run-(\d+)\.mcap")
_RECORD_HEADER: Final = struct.Struct("<BQ")
"""Opcode and length of an MCAP record."""
_PREAMBLE_OPCODES: Final = frozenset({0x01, 0x03, 0x04, 0x09, 0x0C})
"""Header, schema, channel, attachment and metadata (https://mcap.dev/spec)."""
_LIBRARIES: Final = (
    "swarm-gcs", "numpy", "scipy", "numba", "llvmlite", "pymavlink", "eclipse-zenoh", "mcap",
    "msgspec", "zstandard",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Run:
    """Parameters of a run that are not in its mission file."""

    scenario: str
    """Name in the mission file."""
    seed: int


def versions() -> dict[str, str]:
    """Return the versions of all libraries that a result depends on, of Python, and the processor."""
    found = {}
    for library in _LIBRARIES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[library] = metadata.version(library)
    machine = {"machine": platform.machine(), "processor": _processor()}
    return found | {"python": platform.python_version()} | machine


def _processor() -> str:
    """Return the target of compiled kernels: the model, and a checksum of its instruction sets."""
    from llvmlite import binding  # loads LLVM

    sets = str(binding.get_host_cpu_features().flatten())
    return f"{binding.get_host_cpu_name()}-{zlib.crc32(sets.encode()):08x}"


def part_paths(folder: Path) -> list[Path]:
    """Return the MCAP files of a recording in order; the first one even if it is missing."""
    numbered = [(int(match[1]), path) for path in folder.iterdir() if (match := _PART.fullmatch(path.name))]
    return [folder / MCAP_NAME, *(path for _, path in sorted(numbered))]


def remove_empty(folder: Path) -> bool:
    """Delete the recording of a process that was killed before it wrote a record.

    A recording with a record or MAVLink traffic, and one that another process is writing, are kept.

    Returns
    -------
    bool
        True if an empty recording was deleted.

    Raises
    ------
    OSError
        If the folder cannot be read, or a file cannot be deleted.
    """
    if not folder.is_dir() or len(part_paths(folder)) > 1:
        return False
    mcap = folder / MCAP_NAME
    tlog = folder / TLOG_NAME
    if not mcap.is_file() or (tlog.exists() and tlog.stat().st_size > 0):
        return False
    with mcap.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # the recorder holds this lock
        except OSError:
            return False
        if _has_records(file):
            return False
        for name in (MCAP_NAME, TLOG_NAME, CONFIG_NAME, VERSIONS_NAME):
            (folder / name).unlink(missing_ok=True)
    return True


def _has_records(file: BinaryIO) -> bool:
    """Return True if the file has a record, or is no MCAP."""
    if not MCAP_MAGIC.startswith(file.read(len(MCAP_MAGIC))):
        return True
    while len(header := file.read(_RECORD_HEADER.size)) == _RECORD_HEADER.size:
        opcode, length = _RECORD_HEADER.unpack(header)
        if opcode not in _PREAMBLE_OPCODES:
            return True
        file.seek(min(length, 2**62), 1)
    return False
