"""Recordings that were begun and hold nothing: a service was killed before its first record was written."""

from __future__ import annotations

import fcntl
import struct
from pathlib import Path
from typing import BinaryIO, Final

from gcs.io.recording.writer import CONFIG_NAME, MCAP_NAME, TLOG_NAME, VERSIONS_NAME, part_paths

_MAGIC: Final = b"\x89MCAP0\r\n"
_HEAD: Final = struct.Struct("<BQ")
_BEFORE_RECORDS: Final = frozenset({0x01, 0x03, 0x04, 0x09, 0x0C})
"""Header, schemas, channels, attachments and metadata (https://mcap.dev/spec)."""


def remove_empty(folder: Path) -> bool:
    """Delete the recording in a folder if nothing was recorded, and nobody writes it; True if it was there.

    Raises
    ------
    OSError
        When it cannot be read or deleted.
    """
    if not folder.is_dir() or len(part_paths(folder)) > 1:
        return False
    mcap, tlog = folder / MCAP_NAME, folder / TLOG_NAME
    if not mcap.is_file() or (tlog.exists() and tlog.stat().st_size > 0):
        return False
    with mcap.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # a recorder holds it for as long as it lives
        except OSError:
            return False
        if _holds_records(file):
            return False
        for name in (MCAP_NAME, TLOG_NAME, CONFIG_NAME, VERSIONS_NAME):
            (folder / name).unlink(missing_ok=True)
    return True


def _holds_records(file: BinaryIO) -> bool:
    """Return True unless the file ends, whole or cut off, before its first record, and is an MCAP so far."""
    if not _MAGIC.startswith(file.read(len(_MAGIC))):
        return True
    while len(head := file.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        if opcode not in _BEFORE_RECORDS:
            return True
        file.seek(min(length, 2**62), 1)
    return False
