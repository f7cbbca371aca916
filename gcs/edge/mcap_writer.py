"""Writes an MCAP (https://mcap.dev/spec), for a fraction of the library's time for each message.

The library packs a message field by field, through eight Python calls; a flight has hundreds of messages a
second, and that was two thirds of what recording cost. Here a message is one `pack` and its index entry two
numbers. Everything that is written once is left to the library's records, and the file is the library's
writer's, byte for byte: that is how this one is tested.
"""

from __future__ import annotations

import struct
import sys
import zlib
from array import array
from collections.abc import Mapping
from typing import Any, BinaryIO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
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

_MAGIC = b"\x89MCAP0\r\n"
_MESSAGE = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time; the message's data follow."""
_MESSAGE_FIELDS = _MESSAGE.size - struct.calcsize("<BQ")
_INDEX = struct.Struct("<BQHI")
"""Opcode, length, channel, bytes of entries; the entries follow."""
_FOOTER = struct.Struct("<BQQQ")


class McapWriter:
    """Writes one file: `start` first, `finish` last; every method but `add_message` may raise OSError.

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
        self._chunk = bytearray()
        self._entries: dict[int, array[int]] = {}
        """Of the chunk, for each channel: log time and place of each message, one after the other."""

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
        self._chunk += _bytes_of(self._schemas[-1])
        return number

    def register_channel(self, topic: str, message_encoding: str, schema: int) -> int:
        """Announce a channel; return its number."""
        number = len(self._channels) + 1
        self._channels.append(Channel(number, topic, message_encoding, {}, schema))
        self._chunk += _bytes_of(self._channels[-1])
        return number

    def add_message(self, channel: int, t_ns: int, data: bytes, sequence: int) -> None:
        """Write a message, logged and published at `t_ns`; raises OSError when a chunk cannot be written."""
        chunk = self._chunk
        entries = self._entries.get(channel)
        if entries is None:
            entries = self._entries[channel] = array("Q")
        entries.append(t_ns)
        entries.append(len(chunk))
        chunk += _MESSAGE.pack(Opcode.MESSAGE, _MESSAGE_FIELDS + len(data), channel, sequence, t_ns, t_ns)
        chunk += data
        if len(chunk) > self._chunk_bytes:
            self._end_chunk()

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
        data, self._chunk = bytes(self._chunk), bytearray()
        entries, self._entries = self._entries, {}
        first_ns = min(min(one[::2]) for one in entries.values())
        last_ns = max(max(one[::2]) for one in entries.values())
        packed = self._compress(data)
        chunk = _bytes_of(Chunk("zstd", packed, last_ns, first_ns, zlib.crc32(data), len(data)))
        offset, index, offsets = self._file.tell(), b"", {}
        for channel, one in entries.items():
            offsets[channel] = offset + len(chunk) + len(index)
            index += _index_of(channel, one)
            self._counts[channel] = self._counts.get(channel, 0) + len(one) // 2
        self._file.write(chunk + index)
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=offset,
                compression="zstd",
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


def _index_of(channel: int, entries: array[int]) -> bytes:
    """Return the record that says where the messages of a channel lie in a chunk."""
    if sys.byteorder == "big":
        entries.byteswap()
    data = entries.tobytes()
    return _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(data), channel, len(data)) + data


def _bytes_of(record: Any) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())
