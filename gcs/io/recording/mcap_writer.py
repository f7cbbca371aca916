"""Writes an MCAP (https://mcap.dev/spec), for a fraction of the library's time for each message.

The library packs a message field by field, through eight Python calls; a flight has hundreds of messages a
second, and that was two thirds of what recording cost. Here messages come packed, many at once
(`gcs.io.recording.packing`), and the index of a chunk is made of arrays. Everything that is written once is
left to the library's records, and the file is the library's writer's, byte for byte: that is how this one is
tested.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO, TypeAlias

import numpy as np
import numpy.typing as npt
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

Channels: TypeAlias = npt.NDArray[np.uint16]
Times: TypeAlias = npt.NDArray[np.uint64]

_MAGIC = b"\x89MCAP0\r\n"
_HEAD_BYTES = 9
"""Opcode and length of a record; the length counts from behind them."""
_COMPRESSION = b"zstd"
_CHUNK = struct.Struct("<BQQQQII4sQ")
"""Opcode, length, first and last log time, bytes, their checksum, length and name of the compression, bytes
when compressed; these follow."""
_INDEX = struct.Struct("<BQHI")
"""Opcode, length, channel, bytes of entries; the entries follow."""
_FOOTER = struct.Struct("<BQQQ")


class McapWriter:
    """Writes one file: `start` first, `finish` last; every method may raise OSError.

    Parameters
    ----------
    file : BinaryIO
        Open for writing, and empty.
    chunk_bytes : int
        A chunk that has grown past this is compressed and written.
    level : int
        Of the compression, as Zstandard counts.
    """

    def __init__(self, file: BinaryIO, chunk_bytes: int, level: int) -> None:
        self._file, self._chunk_bytes = file, chunk_bytes
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._chunks: list[ChunkIndex] = []
        self._compress = zstandard.ZstdCompressor(level).compress
        self._counts: dict[int, int] = {}
        """Messages of each channel."""
        self._chunk: list[bytes] = []
        self._size = 0
        """Bytes of the chunk."""
        self._entries: list[tuple[Channels, Times]] = []
        """Of the chunk: channel of each message, and its log time and place."""

    def start(self, profile: str, library: str) -> None:
        """Begin the file; `library` says who writes it."""
        self._file.write(_MAGIC + _bytes_of(Header(profile, library)))

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file into it."""
        offset = self._file.tell()
        record = _bytes_of(Attachment(0, 0, name, media_type, data))
        self._file.write(record)
        self._attachments.append(AttachmentIndex(offset, len(record), 0, 0, len(data), name, media_type))

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Put a table into it."""
        offset = self._file.tell()
        record = _bytes_of(Metadata(name, dict(metadata)))
        self._file.write(record)
        self._metadata.append(MetadataIndex(offset, len(record), name))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Announce a schema; return its number."""
        number = len(self._schemas) + 1
        self._schemas.append(Schema(number, data, encoding, name))
        self._append(_bytes_of(self._schemas[-1]))
        return number

    def register_channel(self, topic: str, message_encoding: str, schema: int) -> int:
        """Announce a channel; return its number."""
        number = len(self._channels) + 1
        self._channels.append(Channel(number, topic, message_encoding, {}, schema))
        self._append(_bytes_of(self._channels[-1]))
        return number

    def add_messages(self, messages: bytes, channels: Channels, places: Times) -> None:
        """Write messages that are packed already, whole: a chunk ends behind those that fill it.

        `channels` (n,) has each one's channel, `places` (n, 2) its log time and where in `messages` it
        begins.
        """
        self._entries.append((channels, places + np.array([0, self._size], np.uint64)))
        self._append(messages)
        if self._size > self._chunk_bytes:
            self._end_chunk()

    def _append(self, record: bytes) -> None:
        self._chunk.append(record)
        self._size += len(record)

    def flush(self) -> None:
        """End the chunk and hand everything to the operating system."""
        self._end_chunk()
        self._file.flush()

    def finish(self) -> None:
        """End the chunk, and write the index of the file."""
        self._end_chunk()
        self._file.write(_bytes_of(DataEnd(0)))
        start = self._file.tell()
        groups: list[tuple[Opcode, list[Any]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        summary, offsets = b"", b""
        for opcode, records in groups:
            group = b"".join(map(_bytes_of, records))
            offsets += _bytes_of(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offset_start = start + len(summary)
        summary += offsets
        crc = zlib.crc32(_FOOTER.pack(Opcode.FOOTER, 20, start, offset_start), zlib.crc32(summary))
        self._file.write(summary + _bytes_of(Footer(start, offset_start, crc)) + _MAGIC)

    def _end_chunk(self) -> None:
        """Compress and write what has gathered, and where each message lies in it."""
        if not self._entries:
            return
        data = b"".join(self._chunk)
        self._chunk, self._size = [], 0
        channels, places = map(np.concatenate, zip(*self._entries, strict=True))
        self._entries = []
        first_ns, last_ns = int(places[:, 0].min()), int(places[:, 0].max())
        packed = self._compress(data)
        fields = first_ns, last_ns, len(data), zlib.crc32(data), len(_COMPRESSION), _COMPRESSION, len(packed)
        head = _CHUNK.pack(Opcode.CHUNK, _CHUNK.size - _HEAD_BYTES + len(packed), *fields)
        chunk_bytes = len(head) + len(packed)
        offset, index, offsets = self._file.tell(), b"", {}
        for channel, one in _by_channel(channels, places):
            offsets[channel] = offset + chunk_bytes + len(index)
            index += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(one), channel, len(one)) + one
            self._counts[channel] = self._counts.get(channel, 0) + len(one) // 16
        for part in (head, packed, index):
            self._file.write(part)
        self._chunks.append(
            ChunkIndex(
                chunk_length=chunk_bytes,
                chunk_start_offset=offset,
                compression=_COMPRESSION.decode(),
                compressed_size=len(packed),
                message_end_time=last_ns,
                message_index_length=len(index),
                message_index_offsets=offsets,
                message_start_time=first_ns,
                uncompressed_size=len(data),
            )
        )

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


def _by_channel(channels: Channels, places: Times) -> Iterator[tuple[int, bytes]]:
    """Yield channels in the order of their first messages, each with the packed places of its messages."""
    packed = places[np.argsort(channels, kind="stable")].tobytes()
    ends = (16 * np.cumsum(np.bincount(channels))).tolist()
    for channel in dict.fromkeys(channels.tolist()):
        yield channel, packed[ends[channel - 1] : ends[channel]]


def _bytes_of(record: Any) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())
