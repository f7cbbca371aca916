"""Index of a recording: reads chunks by their times and kinds, without the rest.

A message index behind each chunk has the times and offsets of its messages by channel. What is behind damage
is left out.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, Final

from mcap.opcode import Opcode
from mcap.records import MessageIndex

from gcs.io.recording.mcap_file import (
    HEAD,
    LIBRARY_ERRORS,
    DamageError,
    content_at,
    mcap_heads,
    mcap_paths,
    open_mcap,
    stream,
)
from gcs.io.recording.reader import Record, RunReader, SnapshotPlace
from gcs.model import Snapshot

_CHUNK_TIMES: Final = struct.Struct("<QQ")
"""Log times of the first and the last message of a chunk, at its head."""
_CHANNEL: Final = struct.Struct("<H")


def read_end_t_ns(path: Path) -> int | None:
    """Return the time of the last record; None if the last part has none.

    Raises
    ------
    RecordingError
        If there is no such file, or it is not an MCAP.
    """
    end_t_ns = None
    with open_mcap(mcap_paths(path)[-1]) as file, contextlib.suppress(DamageError, *LIBRARY_ERRORS):
        for opcode, at, _ in mcap_heads(file):
            if opcode == Opcode.CHUNK:
                _, end_t_ns = _CHUNK_TIMES.unpack(content_at(file, at, _CHUNK_TIMES.size))
    return end_t_ns


def snapshot_places(path: Path) -> tuple[SnapshotPlace, ...]:
    """Return the places of all snapshots of a recording, in order; those behind damage are left out.

    Only the message indices behind the chunks are read.

    Raises
    ------
    RecordingError
        If there is no such file, or it is not an MCAP.
    """
    places: list[SnapshotPlace] = []
    for part, file_path in enumerate(mcap_paths(path)):
        with open_mcap(file_path) as file, contextlib.suppress(DamageError, *LIBRARY_ERRORS):
            places += _snapshots_of_part(file, part)
    return tuple(places)


def read_indexed(path: Path, only: Collection[type], spacing_ns: int = 0) -> Iterator[Record]:
    """Read the records of some types, in order, and skip all others by the message indices.

    That is faster than `read` for rare types. Chunks without them are not decompressed. What is behind damage
    is left out. With `spacing_ns`, records that follow one of their topic within that time are skipped.

    Raises
    ------
    RecordingError
        If there is no such file, or it is not an MCAP.
    """
    for file_path in mcap_paths(path):
        with open_mcap(file_path) as file, contextlib.suppress(DamageError, *LIBRARY_ERRORS):
            reader = RunReader(only)
            for chunk, entries in _indexed_chunks(file, reader, spacing_ns):
                content = content_at(file, *chunk)
                yield from reader.read_messages(content, sorted(offset for _, offset in entries))


def _snapshots_of_part(file: BinaryIO, part: int) -> Iterator[SnapshotPlace]:
    for (at, _), entries in _indexed_chunks(file, RunReader((Snapshot,))):
        for t_ns, _ in entries:
            yield SnapshotPlace(t_ns, part, at - HEAD.size)


def _indexed_chunks(
    file: BinaryIO, reader: RunReader, spacing_ns: int = 0
) -> Iterator[tuple[tuple[int, int], list[tuple[int, int]]]]:
    """Yield offset and length of each chunk with requested messages, and their times and offsets in it."""
    due_ns: dict[int, int] = {}
    chunk = (0, 0)
    entries = list[tuple[int, int]]()
    for opcode, at, length in mcap_heads(file):
        if opcode in (Opcode.CHUNK, Opcode.DATA_END) and entries:
            yield chunk, entries
            entries = []
        if opcode == Opcode.CHUNK:
            if chunk == (0, 0):  # the first chunk has the channels
                for _ in reader.read_chunk(content_at(file, at, length)):
                    pass
            chunk = at, length
        elif opcode == Opcode.DATA_END:
            return
        elif opcode == Opcode.MESSAGE_INDEX and reader.requests(_channel(file, at)):
            index = MessageIndex.read(stream(content_at(file, at, length)))
            for t_ns, offset in index.records:
                if t_ns >= due_ns.get(index.channel_id, 0):
                    due_ns[index.channel_id] = t_ns + spacing_ns
                    entries.append((t_ns, offset))
    if entries:
        yield chunk, entries


def _channel(file: BinaryIO, at: int) -> int:
    channel: int = _CHANNEL.unpack(content_at(file, at, _CHANNEL.size))[0]
    return channel
