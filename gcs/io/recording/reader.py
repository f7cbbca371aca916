"""Reads a recording back into the records that went into it, in the order in which they were consumed.

An MCAP (https://mcap.dev/spec) is a magic number and then records of (1-byte opcode, 8-byte length,
content). Messages lie in compressed chunks with a checksum each, so a chunk is read whole or not at all. A
recording that was cut off (SIGKILL, full disk) or damaged is read up to the break; then comes a last record
whose value is a `Damage`, which says what is wrong and where. Nothing here trusts a length: memory stays
below a few times `MAX_CHUNK_BYTES`, whatever the file says.

The parts of a long run are read one after the other as what they are: one run. A part that is missing is a
gap in the numbers of the records, and found by that.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Statistics

from gcs.errors import RecordingError, WireError
from gcs.files import open_regular
from gcs.io.recording.chunks import MAX_CHUNK_BYTES, Unpacker, UnpackingError
from gcs.io.recording.folder import (
    CONFIG_NAME,
    MCAP_MAGIC,
    MCAP_NAME,
    RUN_METADATA,
    VERSIONS_METADATA,
    Run,
    part_paths,
)
from gcs.io.zenoh.messages import TOPICS, Recordable, decode
from gcs.model import Picture

_MAX_OTHERS = 200_000
"""Records of a chunk that are no messages: schemas and channels, of which there may be 65,536 each."""
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time of a message, before its content."""
_BROKEN = (
    McapError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
    RuntimeError,
    KeyError,
    OverflowError,
    MemoryError,
)
"""What the libraries of MCAP and its compressions raise on damaged bytes."""


@dataclass(frozen=True, slots=True)
class Damage:
    """Where a recording breaks off, and why."""

    problem: str
    records: int
    """How many records were read before."""
    offset: int
    """Byte of the file behind the last good part."""
    file: str = ""
    """Name of that file."""


@dataclass(frozen=True, slots=True)
class Record:
    """One record of a run."""

    sequence: int
    """Its place in the order of consumption; wraps at 2**32."""
    t_ns: int
    """Time of the run."""
    value: Recordable | Damage
    payload: bytes = b""
    """The value as it was written."""


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """What a recording says of itself."""

    config_text: str
    versions: dict[str, str]
    run: Run | None = None
    """None when it does not say."""


_Part: TypeAlias = tuple[int, int, bytes]
"""(opcode, offset behind it, content)"""


class _BreaksOffError(Exception):
    """The file ends or makes no sense from here on."""


def is_recording(path: Path) -> bool:
    """Whether a path is a folder, or a file that begins as an MCAP does.

    Raises
    ------
    RecordingError
        When it cannot be read.
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
) -> Iterator[Record]:
    """Read a recording: its folder with all its parts, or one MCAP file.

    `progress` is told now and then how many bytes have been read. Records that are not of the types `only`
    are counted and passed over.

    Yields
    ------
    Record
        In the order of consumption. When the recording is damaged, the last one's value is a `Damage`.

    Raises
    ------
    RecordingError
        When there is no such file or it is no MCAP at all.
    """
    state, before = _Reading(only), 0
    paths = mcap_paths(path)
    for number, file_path in enumerate(paths):
        with _opened(file_path) as file:
            problem = ""
            try:
                yield from _part_records(file, state, before, progress)
            except _BreaksOffError as error:
                problem = str(error)
            except _BROKEN as error:
                problem = f"damaged behind byte {state.offset} ({error or type(error).__name__})"
            if problem:
                if len(paths) > 1:
                    problem = f"{file_path.name}, part {number + 1} of {len(paths)}: {problem}"
                damage = Damage(problem, state.count, state.offset, file_path.name)
                yield Record(state.sequence, state.t_ns, damage)
                return
            before += file.tell()


def _part_records(
    file: BinaryIO, state: _Reading, before: int, progress: Callable[[int], None] | None
) -> Iterator[Record]:
    state.begin()
    for opcode, offset, content in _parts(file):
        if opcode == Opcode.CHUNK:
            yield from state.chunk(content)
        elif opcode == Opcode.STATISTICS:
            state.check_count(Statistics.read(_stream(content)).message_count)
        elif opcode == Opcode.FOOTER:
            _check_end(file)
            return
        state.offset = offset
        if progress is not None:
            progress(before + offset)


def read_info(path: Path) -> RecordingInfo:
    """Return what a recording was made with: mission file, versions, seed; empty where damage hides them.

    Raises
    ------
    RecordingError
        When there is no such file or it is no MCAP at all.
    """
    config_text, versions, run = "", {}, None
    with _opened(mcap_paths(path)[0]) as file:
        try:
            for opcode, _, content in _parts(file):
                if opcode == Opcode.ATTACHMENT:
                    attachment = Attachment.read(_stream(content))
                    if attachment.name == CONFIG_NAME and _attachment_is_whole(content):
                        config_text = attachment.data.decode("utf-8")
                elif opcode == Opcode.METADATA:
                    metadata = Metadata.read(_stream(content))
                    if metadata.name == VERSIONS_METADATA:
                        versions = dict(metadata.metadata)
                    elif metadata.name == RUN_METADATA:
                        run = Run(metadata.metadata["scenario"], int(metadata.metadata["seed"]))
                elif opcode == Opcode.CHUNK:
                    break
        except (_BreaksOffError, *_BROKEN):
            pass
    return RecordingInfo(config_text, versions, run)


class _Reading:
    """What is known after the parts read so far."""

    def __init__(self, only: Collection[type]) -> None:
        self.count = self.sequence = self.t_ns = self.offset = 0
        self._only = only
        self._before = 0
        """Records of earlier parts."""
        self._types: dict[int, type | None] = {}
        """What a channel holds that is asked for."""
        self._unpacker = Unpacker()

    def begin(self) -> None:
        """Begin a part: numbers go on, all else is its own."""
        self._before, self.offset = self.count, 0
        self._unpacker = Unpacker()
        self._types.clear()

    def chunk(self, content: bytes) -> Iterator[Record]:
        """Yield the records of one chunk."""
        try:
            data = self._unpacker.unpack(Chunk.read(_stream(content)))
        except UnpackingError as error:
            raise _BreaksOffError(f"damaged behind byte {self.offset}: {error}") from None
        at = others = 0
        while at < len(data):
            opcode, length = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if length > len(data) - at:
                raise _BreaksOffError(f"damaged behind byte {self.offset}: a chunk ends within a record")
            if opcode == Opcode.MESSAGE:
                record = self._message(data, at, at + length)
                if record is not None:
                    yield record
                at += length
                continue
            others += 1
            if others > _MAX_OTHERS:
                what = f"a chunk has more than {_MAX_OTHERS} records that are no messages"
                raise _BreaksOffError(f"damaged behind byte {self.offset}: {what}")
            if opcode == Opcode.CHANNEL:
                channel = Channel.read(_stream(data[at : at + length]))
                held = _type_of(channel.topic)
                self._types[channel.id] = held if held in self._only else None
            at += length

    def check_count(self, count: int) -> None:
        """Hold what was read against what the index says was written."""
        found = self.count - self._before
        if count != found:
            raise _BreaksOffError(f"records are missing: {count} were written, {found} could be read")

    def _message(self, data: bytes, at: int, end: int) -> Record | None:
        channel_id, sequence, t_ns, _ = _MESSAGE.unpack_from(data, at)
        if self.count and sequence != self.sequence:
            raise _BreaksOffError(
                f"records are missing behind byte {self.offset}: after number {self.sequence - 1} comes "
                f"number {sequence}"
            )
        self.sequence = (sequence + 1) & 0xFFFFFFFF
        self.count += 1
        self.t_ns = t_ns
        record_type = self._types[channel_id]
        if record_type is None:
            return None  # of a later version, or not asked for
        payload = data[at + _MESSAGE.size : end]
        try:
            value: Recordable = decode(f"record {sequence}", payload, record_type)
        except WireError as error:
            raise _BreaksOffError(str(error)) from None
        return Record(sequence, t_ns, value, payload)


def _parts(file: BinaryIO) -> Iterator[_Part]:
    magic = file.read(len(MCAP_MAGIC))
    if magic != MCAP_MAGIC:
        raise _BreaksOffError("cut off in its first bytes")
    while True:
        offset = file.tell()
        head = file.read(_HEAD.size)
        if not head:
            raise _BreaksOffError(
                f"cut off: the run did not end in order (last whole part ends at byte {offset})"
            )
        if len(head) < _HEAD.size:
            raise _BreaksOffError(f"cut off at byte {offset}")
        opcode, length = _HEAD.unpack(head)
        if length > MAX_CHUNK_BYTES:
            raise _BreaksOffError(f"damaged at byte {offset}: a part claims {length} bytes")
        content = file.read(length)
        if len(content) < length:
            raise _BreaksOffError(f"cut off at byte {offset + _HEAD.size + len(content)}")
        yield opcode, file.tell(), content


def _check_end(file: BinaryIO) -> None:
    if file.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
        raise _BreaksOffError("cut off in its last bytes; every record was read")


def mcap_paths(path: Path) -> list[Path]:
    """Return the MCAP files, in order, of a recording that is named by one of them or by its folder.

    Raises
    ------
    RecordingError
        When there is none.
    """
    try:
        paths = part_paths(path) if path.is_dir() else [path]
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror}") from None
    if path.is_dir() and len(paths) == 1 and not paths[0].exists():
        raise RecordingError(str(path), f"holds no recording: there is no {MCAP_NAME} in it")
    return paths


def recording_bytes(path: Path) -> int:
    """Size of all MCAP files of a recording.

    Raises
    ------
    RecordingError
        When one cannot be read.
    """
    try:
        return sum(part.stat().st_size for part in mcap_paths(path))
    except OSError as error:
        raise RecordingError(error.filename or str(path), f"cannot be read: {error.strerror}") from None


def _opened(path: Path) -> BinaryIO:
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


def _stream(content: bytes) -> Any:
    return ReadDataStream(io.BytesIO(content))


def _attachment_is_whole(content: bytes) -> bool:
    """Check the checksum, which the library passes over: over everything before itself."""
    return zlib.crc32(content[:-4]) == int.from_bytes(content[-4:], "little")


def _type_of(topic: str) -> type | None:
    for record_type, name in TOPICS.items():
        if topic == name or (record_type is Picture and topic in (f"{name}/agents", f"{name}/targets")):
            return record_type
    return None
