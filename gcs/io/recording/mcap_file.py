"""MCAP files (https://mcap.dev/spec): a magic number, and then records of opcode, length and content.

Lengths in a file are not trusted: no record of more than `MAX_CHUNK_BYTES` is read.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final, TypeAlias

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError

from gcs.errors import RecordingError
from gcs.files import open_regular
from gcs.io.recording.chunks import MAX_CHUNK_BYTES
from gcs.io.recording.folder import MCAP_MAGIC, MCAP_NAME, part_paths

HEAD: Final = struct.Struct("<BQ")
"""Opcode and length of a record."""
LIBRARY_ERRORS = (
    McapError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
    RuntimeError,
    KeyError,
    OverflowError,
    MemoryError,
)
"""Exceptions that the MCAP and compression libraries raise on damaged bytes."""

McapRecord: TypeAlias = tuple[int, int, bytes]
"""Opcode, offset of the next record, content."""


class DamageError(Exception):
    """The file ends or is invalid from here on."""


def mcap_paths(path: Path) -> list[Path]:
    """Return the MCAP files of a recording in order; a single file is returned as it is.

    Raises
    ------
    RecordingError
        If there is none.
    """
    try:
        paths = part_paths(path) if path.is_dir() else [path]
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror}") from None
    if path.is_dir() and len(paths) == 1 and not paths[0].exists():
        raise RecordingError(str(path), f"has no recording: there is no {MCAP_NAME} in it")
    return paths


def recording_bytes(path: Path) -> int:
    """Return the size of all MCAP files of a recording in bytes.

    Raises
    ------
    RecordingError
        If one cannot be read.
    """
    try:
        return sum(part.stat().st_size for part in mcap_paths(path))
    except OSError as error:
        raise RecordingError(error.filename or str(path), f"cannot be read: {error.strerror}") from None


def open_mcap(path: Path) -> BinaryIO:
    """Open an MCAP file.

    Raises
    ------
    RecordingError
        If it cannot be read, or does not begin as an MCAP does.
    """
    try:
        file = open_regular(path)
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror}") from None
    magic = file.read(len(MCAP_MAGIC))
    file.seek(0)
    if not MCAP_MAGIC.startswith(magic):
        file.close()
        raise RecordingError(str(path), "is no recording: it does not begin as an MCAP does")
    return file


def stream(content: bytes) -> Any:
    """Return content in the form that the library reads."""
    return ReadDataStream(io.BytesIO(content))


def mcap_records(file: BinaryIO, offset: int = 0) -> Iterator[McapRecord]:
    """Yield the records of a file from an offset on; 0: from its beginning."""
    file.seek(offset)
    if not offset and file.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
        raise DamageError("cut off in its first bytes")
    while True:
        offset = file.tell()
        head = file.read(HEAD.size)
        if not head:
            raise DamageError(
                f"cut off: the run did not end in order (last whole part ends at byte {offset})"
            )
        if len(head) < HEAD.size:
            raise DamageError(f"cut off at byte {offset}")
        opcode, length = HEAD.unpack(head)
        if length > MAX_CHUNK_BYTES:
            raise DamageError(f"damaged at byte {offset}: a part claims {length} bytes")
        content = file.read(length)
        if len(content) < length:
            raise DamageError(f"cut off at byte {offset + HEAD.size + len(content)}")
        yield opcode, file.tell(), content


def mcap_heads(file: BinaryIO) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, offset and length of the content of each record; nothing else is read."""
    at = len(MCAP_MAGIC)
    size = file.seek(0, io.SEEK_END)
    while at + HEAD.size <= size:
        file.seek(at)
        opcode, length = HEAD.unpack(file.read(HEAD.size))
        at += HEAD.size
        yield opcode, at, length
        at += length


def content_at(file: BinaryIO, offset: int, length: int) -> bytes:
    """Return the content of a record.

    Raises
    ------
    DamageError
        If it is too long.
    """
    if length > MAX_CHUNK_BYTES:
        raise DamageError(f"a part claims {length} bytes")
    file.seek(offset)
    return file.read(length)
