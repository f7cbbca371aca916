"""A run's recording: everything that went into the fold and everything that came out, in order.

A recording is a folder::

    run.mcap        every event, effect and truth (https://mcap.dev), as JSON with schemas, for Foxglove
    link.tlog       the MAVLink traffic both ways, for QGroundControl, Mission Planner and MAVExplorer
    mission.toml    the mission file that was flown
    versions.json   of everything that a result depends on

In the MCAP a message's ``sequence`` counts all records of the run, so that the order in which the consumer
took them stays known whatever their times; ``log_time`` is the run's time. The mission file is also attached
to it; the versions are its metadata, and so is `Run`: what the run was started with beside that file.

A long run is split into parts (``run-002.mcap`` with ``link-002.tlog`` and so on): the next one begins, with
an event, when a file of the last has grown past a size. Each part is a whole file of its kind with all of
the above in it. That also bounds the memory: an MCAP's index is kept until its file is finished.

Messages gather in a compressed chunk, of a megabyte at most, that `flush` writes: called once a second, it
leaves all but the last second readable after SIGKILL or on a full disk. It does not wait for the disk itself
(no fsync): a power cut may cost more. A write may block all the same: a service records on a thread
(`gcs.io.recording.writer_thread`).
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
import platform
import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from errno import ENOTDIR
from importlib import metadata
from math import inf
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import TYPE_CHECKING, Self

from gcs.errors import RecordingError
from gcs.io.private_files import make_private, new_folder, private
from gcs.io.recording.mcap_writer import McapWriter
from gcs.io.recording.schemas import json_schema
from gcs.io.zenoh.messages import TOPICS, Recordable
from gcs.model import Effect, Event, Level, Picture, Truth

if TYPE_CHECKING:
    from gcs.io.recording.packing import UploadQueue

MCAP_NAME, TLOG_NAME, CONFIG_NAME, VERSIONS_NAME = "run.mcap", "link.tlog", "mission.toml", "versions.json"
PROFILE = "swarm-gcs"
VERSIONS_METADATA, RUN_METADATA = "versions", "run"
ROTATE_BYTES = 500_000_000
"""Size of a part. Viewers in a browser read it in one go, and every file system holds it."""
_CHUNK_BYTES = 1024 * 1024
_LEVEL = 1
"""Of Zstandard: for a second of records it is twice as fast as the usual 3, and the file is smaller."""
_BUFFER_BYTES = 256 * 1024
_WAITING = 512
"""Records that are written at once, unless a flush comes before; then there is a look at the size."""
_LOW = 0.8
"""Of the room: from here on it is low."""
_FLUSH_PERIOD_S = 0.8
"""With the time until a record gets here, less than the second that a crash may cost."""
_PART = re.compile(r"run-(\d+)\.mcap")
_LIBRARIES = (
    "swarm-gcs", "numpy", "scipy", "numba", "llvmlite", "pymavlink", "eclipse-zenoh", "mcap",
    "msgspec", "zstandard",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class DiskBudget:
    """What a recording may take of its disk."""

    rotate_bytes: int = ROTATE_BYTES
    """A part whose MCAP or tlog has grown past this is finished, and the next one begins. It may be larger by
    what comes within one look at the size: 512 records or a flush."""
    max_bytes: float = inf
    """Of all parts together."""
    min_free_bytes: float = 0.0
    """What is left free for the journal and other programs."""


@dataclass(frozen=True, slots=True)
class Run:
    """What a run was started with, beside its mission file."""

    scenario: str
    """Name in the mission file."""
    seed: int


def versions() -> dict[str, str]:
    """Versions of everything that a result depends on, and the processor that kernels are compiled for."""
    found = {}
    for library in _LIBRARIES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[library] = metadata.version(library)
    machine = {"machine": platform.machine(), "processor": _processor()}
    return found | {"python": platform.python_version()} | machine


def _processor() -> str:
    """Name what kernels are compiled for: the model, and a checksum of its instruction sets."""
    from llvmlite import binding  # loads LLVM

    sets = str(binding.get_host_cpu_features().flatten())
    return f"{binding.get_host_cpu_name()}-{zlib.crc32(sets.encode()):08x}"


def part_paths(folder: Path) -> list[Path]:
    """MCAP files of a recording in order; its first is named even where it is missing."""
    numbered = [(int(match[1]), path) for path in folder.iterdir() if (match := _PART.fullmatch(path.name))]
    return [folder / MCAP_NAME, *(path for _, path in sorted(numbered))]


class Recorder:
    """Writes a recording.

    Parameters
    ----------
    folder : Path
        Made when it is not there. One that holds a recording already is refused: a flight is never
        overwritten.
    config_text : str
        The mission file, as it was read.
    versions : mapping
        Version of each thing that a result depends on.
    run : Run, optional
        What else is needed to fly, or replay, the same again.
    room : Room, optional
        What it may take of the disk. At four fifths, and when little more is free than what must be, there is
        an alarm; at the end the recording is finished, and `RecordingError` raised. Nothing is ever deleted.

    Raises
    ------
    RecordingError
        When the folder cannot be written; also by every method, such as on a full disk. What was flushed
        before stays readable.
    """

    def __init__(
        self,
        folder: Path,
        config_text: str,
        versions: Mapping[str, str],
        run: Run | None = None,
        room: DiskBudget | None = None,
    ) -> None:
        self.folder = folder
        self.tell: Callable[[Level, str], None] = lambda _level, _text: None
        """Takes what an operator should know while the recording goes on."""
        self._about = config_text, dict(versions), run
        self._room = room or DiskBudget()
        self._finished_bytes = 0
        """Of earlier parts."""
        self._is_low = False
        self._sequence = 0
        self._waiting: list[UploadQueue] = []
        """To be written: many at once cost a third of one by one."""
        self._parts = 0
        self._full = self._closed = False
        self._flush_at_s = monotonic() + _FLUSH_PERIOD_S
        try:
            if folder.exists() and not folder.is_dir():
                raise NotADirectoryError(ENOTDIR, "it is a file")
            make_private(folder, exist_ok=True)
            if len(part_paths(folder)) > 1:
                raise FileExistsError
            self._part = self._next_part()
        except FileExistsError:
            raise RecordingError(
                str(folder), "holds a recording already; choose another folder or move it away"
            ) from None
        except OSError as error:
            raise RecordingError(
                str(folder), f"cannot be written: {error.strerror}; choose another folder"
            ) from None
        self._own = [folder / name for name in (CONFIG_NAME, VERSIONS_NAME) if not (folder / name).exists()]
        """Files beside the parts that were not there before."""
        try:
            self._begin_folder()
        except OSError as error:
            failure = self._failed(error)
            self._discard()
            raise failure from None

    def _begin_folder(self) -> None:
        config_text, versions, _ = self._about
        for name, text in (
            (CONFIG_NAME, config_text),
            (VERSIONS_NAME, json.dumps(versions, indent=2) + "\n"),
        ):
            with open(self.folder / name, "w", encoding="utf-8", opener=private) as file:
                file.write(text)
        self._part.begin(*self._about)

    def _next_part(self) -> _Part:
        self._parts += 1
        names = [Path(name) for name in (MCAP_NAME, TLOG_NAME)]
        if self._parts > 1:
            names = [name.with_stem(f"{name.stem}-{self._parts:03}") for name in names]
        return _Part(*(self.folder / name for name in names))

    def event(self, event: Event) -> None:
        """Record what goes into the fold; call it before the fold works it."""
        if self._full:
            self._rotate()
        elif monotonic() >= self._flush_at_s:
            self.flush()
        self._add(event, event.t_ns)

    def effect(self, t_ns: int, effect: Effect, payload: bytes = b"") -> None:
        """Record what came out of the fold at `t_ns`; `payload` is its JSON where there is one already."""
        self._add(effect, t_ns, payload)

    def truth(self, truth: Truth) -> None:
        """Record the truth of a simulated world."""
        self._add(truth, truth.t_ns)

    def flush(self) -> None:
        """Hand everything recorded so far to the operating system; `event` does it in time."""
        if self._closed:
            return
        try:
            self._look_after_folder()
            self._write_out()
            self._part.flush()
            self._look_after_room()
        except OSError as error:
            raise self._failed(error) from None
        self._flush_at_s = monotonic() + _FLUSH_PERIOD_S

    def _look_after_folder(self) -> None:
        """Go on in a new folder when this one was deleted or moved away."""
        if self._part.is_in_place():
            return
        self._part.abandon()
        lost, self.folder = self.folder, new_folder(self.folder.parent, self.folder.name)
        self._parts = self._finished_bytes = 0
        self._part = self._next_part()
        self._begin_folder()
        self.tell("alarm", f"{lost} was deleted or moved away; the recording goes on in {self.folder}")

    def _look_after_room(self) -> None:
        """Tell when room runs low; finish the recording when there is none."""
        used = self._finished_bytes + self._part.total_bytes
        disk = os.statvfs(self.folder)
        free, room = disk.f_bavail * disk.f_frsize, self._room
        if used >= room.max_bytes or free < room.min_free_bytes:
            self._closed = True
            self._part.finish()
            why = f"it has {used / 1e9:.2f} GB (recording.max_gb)"
            if free < room.min_free_bytes:
                why = f"its disk has {free / 1e6:.0f} MB left (recording.min_free_mb)"
            raise RecordingError(str(self.folder), f"ended: {why}; what was recorded is complete")
        is_low = used >= _LOW * room.max_bytes or free < room.min_free_bytes / (1.0 - _LOW)
        if is_low and not self._is_low:
            self.tell(
                "alarm",
                f"room runs low: {self.folder} has {used / 1e9:.2f} GB, its disk {free / 1e6:.0f} MB free; "
                f"it ends at {room.max_bytes / 1e9:.6g} GB, or {room.min_free_bytes / 1e6:.0f} MB free: make "
                "room",
            )
        self._is_low = is_low

    def close(self) -> None:
        """Finish the files; closing again, or after a failure, does nothing.

        A recording without a record is deleted: the start failed, and the next one may use the folder.
        """
        if self._closed:
            return
        if not self._sequence and not self._waiting:
            self._closed = True
            self._part.abandon()
            self._discard()
            return
        try:
            self._write_out()
            self._part.finish()
        except OSError as error:
            raise self._failed(error) from None
        self._closed = True

    def _rotate(self) -> None:
        """Finish this part and begin the next."""
        try:
            self._look_after_folder()
            self._write_out()
            self._part.finish()
            self._finished_bytes += self._part.total_bytes
            self._part = self._next_part()
            self._part.begin(*self._about)
        except OSError as error:
            raise self._failed(error) from None
        self._full = False

    def _discard(self) -> None:
        """Delete what this recorder has made."""
        with contextlib.suppress(OSError):
            for path in (*self._part.paths, *self._own):
                path.unlink(missing_ok=True)
            self.folder.rmdir()  # when nothing else is in it

    def _add(self, record: Recordable, t_ns: int, payload: bytes = b"") -> None:
        if self._closed:
            raise RecordingError(str(self.folder), "is closed")
        self._waiting.append((record, t_ns, payload))
        if len(self._waiting) >= _WAITING:
            try:
                self._write_out()
            except OSError as error:
                raise self._failed(error) from None

    def _write_out(self) -> None:
        """Write what waits, and look at the size."""
        waiting, self._waiting = self._waiting, []
        self._part.add(waiting, self._sequence)
        self._sequence += len(waiting)
        self._full = self._part.size > self._room.rotate_bytes

    def _failed(self, error: OSError) -> RecordingError:
        """Leave the files as they are now: finishing them would write on a disk that is full."""
        self._closed = True
        self._part.abandon()
        return RecordingError(
            str(self.folder),
            f"cannot be written any further ({error.strerror}); what was recorded before stays readable",
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Part:
    """One MCAP file and the tlog of the same time; every method may raise OSError."""

    def __init__(self, mcap_path: Path, tlog_path: Path) -> None:
        self.paths = (mcap_path, tlog_path)
        self._files: list[io.FileIO] = []
        try:
            for path in self.paths:
                self._files.append(open(path, "xb", buffering=0, opener=private))  # noqa: SIM115  kept
        except OSError:
            for path, file in zip(self.paths, self._files, strict=False):
                file.close()
                path.unlink()
            raise
        with contextlib.suppress(
            OSError
        ):  # not every file system can; `gcs.io.recording.unfinished` looks for it
            fcntl.flock(self._files[0], fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._inode = os.fstat(self._files[0].fileno()).st_ino
        self.total_bytes = 0
        """Of both files when they were looked at last."""
        self._mcap, self._tlog = (io.BufferedWriter(file, _BUFFER_BYTES) for file in self._files)
        self._writer = McapWriter(self._mcap, _CHUNK_BYTES, _LEVEL)

    @property
    def size(self) -> int:
        """Bytes of the larger file; what waits in a chunk is not counted."""
        return max(self._mcap.tell(), self._tlog.tell())

    def is_in_place(self) -> bool:
        """Return True if the MCAP is where it was made."""
        try:
            return self.paths[0].stat().st_ino == self._inode
        except FileNotFoundError:
            return False

    def begin(self, config_text: str, versions: dict[str, str], run: Run | None) -> None:
        """Say what the run is and announce every topic with its schema, used or not."""
        from gcs.io.recording.packing import Packer  # loads numba, which whoever only reads can do without

        self._writer.start(PROFILE, PROFILE)
        self._writer.add_attachment(CONFIG_NAME, "application/toml", config_text.encode())
        self._writer.add_metadata(VERSIONS_METADATA, versions)
        if run is not None:
            self._writer.add_metadata(RUN_METADATA, {"scenario": run.scenario, "seed": str(run.seed)})
        self._mcap.flush()
        channels: dict[type | str, int] = {}
        for record_type, topic in TOPICS.items():
            schema = self._writer.register_schema(
                f"gcs.{record_type.__name__}", "jsonschema", json_schema(record_type)
            )
            if record_type is Picture:
                for name in (f"{topic}/agents", f"{topic}/targets"):
                    channels[name] = self._writer.register_channel(name, "json", schema)
            else:
                channels[record_type] = self._writer.register_channel(topic, "json", schema)
        self._packer = Packer(channels)

    def add(self, records: Sequence[UploadQueue], sequence: int) -> None:
        """Write records, numbered from `sequence` on, which wraps."""
        for piece in self._packer.pack(records, sequence):
            self._writer.add_messages(piece.messages, piece.channels, piece.places)
            self._tlog.write(piece.log)

    def flush(self) -> None:
        """Hand everything to the operating system."""
        self._writer.flush()
        self._tlog.flush()
        self.total_bytes = self._mcap.tell() + self._tlog.tell()

    def finish(self) -> None:
        """Write the index and close."""
        self._writer.finish()
        self.total_bytes = self._mcap.tell() + self._tlog.tell()
        self._mcap.close()
        self._tlog.close()

    def abandon(self) -> None:
        """Close without writing any more."""
        for file in self._files:
            file.close()
