"""Reader of recordings: all records, or some kinds, in the order of consumption.

An MCAP (https://mcap.dev/spec) is a magic number and then records of (1-byte opcode, 8-byte length,
content). Messages are in compressed chunks with a checksum. A chunk is read completely or not at all. If a
recording was cut off (SIGKILL, full disk) or damaged, the last record's value is a `Damage` with the place
and the reason. Lengths in the file are not trusted: memory stays below a few times `MAX_CHUNK_BYTES`.

The parts of a long run are read as one run. A missing part shows as a gap in the record numbers.
"""

from __future__ import annotations

import contextlib
import io
import struct
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Statistics

from gcs.errors import RecordingError, WireError
from gcs.files import open_regular
from gcs.io.record_json import decode
from gcs.io.recording.chunks import Unpacker, UnpackingError
from gcs.io.recording.folder import (
    CONFIG_NAME,
    FORMAT_METADATA,
    FORMAT_VERSION,
    MCAP_MAGIC,
    RUN_METADATA,
    VERSIONS_METADATA,
    Run,
)
from gcs.io.recording.mcap_file import (
    HEAD,
    LIBRARY_ERRORS,
    DamageError,
    mcap_paths,
    mcap_records,
    open_mcap,
    stream,
)
from gcs.io.recording.topics import TOPICS, Recordable
from gcs.model import Picture, Snapshot

_MAX_DEFINITIONS = 200_000
"""Maximum schemas and channels in a chunk. The format allows 65,536 of each."""
_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time of a message; its content follows."""


@dataclass(frozen=True, slots=True)
class Damage:
    """Place where a recording becomes unreadable, and the reason."""

    problem: str
    records: int
    """Number of records before the damage."""
    offset: int
    """Byte of the file after the last valid part."""
    file: str = ""
    """Name of the damaged file."""


@dataclass(frozen=True, slots=True)
class Record:
    """A record of a run."""

    sequence: int
    """Number in the order of consumption, modulo 2**32."""
    t_ns: int
    """Time of the run."""
    value: Recordable | Damage
    payload: bytes = b""
    """The value as JSON, as it was written."""


@dataclass(frozen=True, slots=True)
class SnapshotPlace:
    """Place of a snapshot in a recording."""

    t_ns: int
    part: int
    """Number of the MCAP file, from 0."""
    offset: int
    """Byte of that file at which its chunk begins."""


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """Metadata of a recording."""

    config_text: str
    versions: dict[str, str]
    run: Run | None = None
    """None if the recording does not have it."""


def is_recording(path: Path) -> bool:
    """Return True if the path is a folder, or a file with the magic number of an MCAP.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """
    if path.is_dir():
        return True
    try:
        with open_regular(path) as file:
            return file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror}") from None


def read(
    path: Path,
    progress: Callable[[int], None] | None = None,
    only: Collection[type] = frozenset(TOPICS),
    start: SnapshotPlace | None = None,
) -> Iterator[Record]:
    """Read a recording: its folder with all its parts, or one MCAP file.

    Parameters
    ----------
    path : Path
        Folder or file.
    progress : callable, optional
        Called after each chunk with the number of bytes read so far.
    only : collection of types
        Types of records to return. Other records are counted, but not decoded.
    start : SnapshotPlace, optional
        First record to return, a snapshot; by default the first of the recording.

    Yields
    ------
    Record
        In the order of consumption. If the recording is damaged, the last value is a `Damage`.

    Raises
    ------
    RecordingError
        If there is no such file, it is not an MCAP, or it has another format version.
    """
    state = RunReader(only if start is None else {*only, Snapshot})
    before = 0
    paths = mcap_paths(path)
    _check_format(paths[0])
    for number, file_path in enumerate(paths):
        with open_mcap(file_path) as file:
            problem = ""
            if start is not None and number < start.part:
                before += file.seek(0, io.SEEK_END)
                continue
            at_snapshot = start if start is not None and number == start.part else None
            try:
                yield from _part_records(file, state, before, progress, at_snapshot)
            except DamageError as error:
                problem = str(error)
            except LIBRARY_ERRORS as error:
                problem = f"damaged behind byte {state.offset} ({error or type(error).__name__})"
            if problem:
                if len(paths) > 1:
                    problem = f"{file_path.name}, part {number + 1} of {len(paths)}: {problem}"
                damage = Damage(problem, state.count, state.offset, file_path.name)
                yield Record(state.sequence, state.t_ns, damage)
                return
            before += file.tell()


def _part_records(
    file: BinaryIO,
    state: RunReader,
    before: int,
    progress: Callable[[int], None] | None,
    start: SnapshotPlace | None,
) -> Iterator[Record]:
    state.begin()
    if start is not None:
        state.begin_at(
            start, next(content for code, _, content in mcap_records(file) if code == Opcode.CHUNK)
        )
    for opcode, offset, content in mcap_records(file, 0 if start is None else start.offset):
        if opcode == Opcode.CHUNK:
            yield from state.read_chunk(content)
        elif opcode == Opcode.STATISTICS:
            state.check_count(Statistics.read(stream(content)).message_count)
        elif opcode == Opcode.FOOTER:
            _check_end(file)
            return
        state.offset = offset
        if progress is not None:
            progress(before + offset)


def _check_format(path: Path) -> None:
    """Refuse a recording of another format version; accept a file whose beginning is cut off or damaged.

    Raises
    ------
    RecordingError
        If the version differs; the text names the version of the software that reads the recording.
    """
    found = ""
    is_whole = False
    software = ""
    with open_mcap(path) as file, contextlib.suppress(DamageError, *LIBRARY_ERRORS):
        for opcode, _, content in mcap_records(file):
            if opcode == Opcode.METADATA:
                metadata = Metadata.read(stream(content))
                if metadata.name == FORMAT_METADATA:
                    found = metadata.metadata["version"]
                elif metadata.name == VERSIONS_METADATA:
                    software = metadata.metadata.get("swarm-gcs", "")
                    is_whole = True
            elif opcode == Opcode.CHUNK:
                break
    if is_whole and found != str(FORMAT_VERSION):
        made_by = f"swarm-gcs {software}, which recorded it" if software else "the version that recorded it"
        raise RecordingError(
            str(path),
            f"has recording format {found or '1'}; this version reads format {FORMAT_VERSION}. "
            f"Read it with {made_by}",
        )


def read_info(path: Path) -> RecordingInfo:
    """Return the mission file, versions and run parameters of a recording; empty where it is damaged.

    Raises
    ------
    RecordingError
        If there is no such file, it is not an MCAP, or it has another format version.
    """
    config_text = ""
    versions = {}
    run = None
    path = mcap_paths(path)[0]
    _check_format(path)
    with open_mcap(path) as file:
        try:
            for opcode, _, content in mcap_records(file):
                if opcode == Opcode.ATTACHMENT:
                    attachment = Attachment.read(stream(content))
                    if attachment.name == CONFIG_NAME and _is_attachment_valid(content):
                        config_text = attachment.data.decode("utf-8")
                elif opcode == Opcode.METADATA:
                    metadata = Metadata.read(stream(content))
                    if metadata.name == VERSIONS_METADATA:
                        versions = dict(metadata.metadata)
                    elif metadata.name == RUN_METADATA:
                        run = Run(metadata.metadata["scenario"], int(metadata.metadata["seed"]))
                elif opcode == Opcode.CHUNK:
                    break
        except (DamageError, *LIBRARY_ERRORS):
            pass
    return RecordingInfo(config_text, versions, run)


class RunReader:
    """State after the parts read so far."""

    def __init__(self, only: Collection[type]) -> None:
        self.count = self.sequence = self.t_ns = self.offset = 0
        self._only = only
        self._before = 0
        """Number of records in earlier parts."""
        self._types: dict[int, type | None] = {}
        """Record type of each channel; None if it is not requested."""
        self._unpacker = Unpacker()
        self._start_t_ns: int | None = None
        """Time of the snapshot to begin with; None once it was read."""
        self._begins_at_first = True

    def begin(self) -> None:
        """Start a part; record numbers continue."""
        self._before = self.count
        self.offset = 0
        self._begins_at_first = True
        self._unpacker = Unpacker()
        self._types.clear()

    def begin_at(self, start: SnapshotPlace, first_chunk: bytes) -> None:
        """Begin a part at a snapshot; its first chunk has the channels."""
        for _ in self.read_chunk(first_chunk):
            pass
        self.count = 0
        self._start_t_ns = start.t_ns
        self._begins_at_first = False

    def read_chunk(self, content: bytes) -> Iterator[Record]:
        """Yield the records of one chunk."""
        data = self._unpacked(content)
        at = definitions = 0
        while at < len(data):
            opcode, length = HEAD.unpack_from(data, at)
            at += HEAD.size
            if length > len(data) - at:
                raise DamageError(f"damaged behind byte {self.offset}: a chunk ends within a record")
            if opcode == Opcode.MESSAGE:
                record = self._message(data, at, at + length)
                if self._start_t_ns is not None and _is_snapshot(record, self._start_t_ns):
                    self._start_t_ns = None
                if record is not None and self._start_t_ns is None:
                    yield record
                at += length
                continue
            definitions += 1
            if definitions > _MAX_DEFINITIONS:
                what = f"a chunk has more than {_MAX_DEFINITIONS} records that are no messages"
                raise DamageError(f"damaged behind byte {self.offset}: {what}")
            if opcode == Opcode.CHANNEL:
                channel = Channel.read(stream(data[at : at + length]))
                held = _type_of(channel.topic)
                self._types[channel.id] = held if held in self._only else None
            at += length

    def requests(self, channel: int) -> bool:
        """Return True if the records of a channel are requested."""
        return self._types.get(channel) is not None

    def read_messages(self, content: bytes, offsets: Iterable[int]) -> Iterator[Record]:
        """Yield the records at some offsets of a chunk; those between are not counted."""
        data = self._unpacked(content)
        for at in offsets:
            _, length = HEAD.unpack_from(data, at)
            self.count = 0
            record = self._message(data, at + HEAD.size, at + HEAD.size + length)
            if record is not None:
                yield record

    def check_count(self, count: int) -> None:
        """Compare the number of messages with the number in the file's statistics."""
        found = self.count - self._before
        if count != found and self._begins_at_first:
            raise DamageError(f"records are missing: {count} were written, {found} could be read")

    def _unpacked(self, chunk: bytes) -> bytes:
        try:
            return self._unpacker.unpack(Chunk.read(stream(chunk)))
        except UnpackingError as error:
            raise DamageError(f"damaged behind byte {self.offset}: {error}") from None

    def _message(self, data: bytes, at: int, end: int) -> Record | None:
        channel_id, sequence, t_ns, _ = _MESSAGE.unpack_from(data, at)
        if self.count and sequence != self.sequence:
            raise DamageError(
                f"records are missing behind byte {self.offset}: after number {self.sequence - 1} comes "
                f"number {sequence}"
            )
        self.sequence = (sequence + 1) & 0xFFFFFFFF
        self.count += 1
        self.t_ns = t_ns
        record_type = self._types[channel_id]
        if record_type is None:
            return None  # from a later version, or not requested
        payload = data[at + _MESSAGE.size : end]
        try:
            value: Recordable = decode(f"record {sequence}", payload, record_type)
        except WireError as error:
            raise DamageError(str(error)) from None
        return Record(sequence, t_ns, value, payload)


def _is_snapshot(record: Record | None, t_ns: int) -> bool:
    return record is not None and record.t_ns == t_ns and isinstance(record.value, Snapshot)


def _check_end(file: BinaryIO) -> None:
    if file.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
        raise DamageError("cut off in its last bytes; every record was read")


def _is_attachment_valid(content: bytes) -> bool:
    """Return True if the checksum, which the library ignores, is that of all bytes before it."""
    return zlib.crc32(content[:-4]) == int.from_bytes(content[-4:], "little")


def _type_of(topic: str) -> type | None:
    for record_type, name in TOPICS.items():
        if topic == name or (record_type is Picture and topic in (f"{name}/agents", f"{name}/targets")):
            return record_type
    return None
