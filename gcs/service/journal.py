"""Journal: one file with the state, written every few seconds, from which a restarted service continues.

It is replaced atomically (temporary file, fsync, rename). After SIGKILL or a power cut the newest version or
the one before it is there, never a part. It has a format version, a checksum, and the fingerprint of its
mission file and seed. If any of them is wrong, the service starts without it and says why. A journal moves no
aircraft: a route counts only when the vehicle's onboard mission reads back equal.
"""

from __future__ import annotations

import hashlib
import os
from functools import partial
from pathlib import Path

import msgspec

from gcs.core.snapshot import encode_state
from gcs.errors import JournalError
from gcs.files import read_bytes
from gcs.io.background_writer import BackgroundWriter
from gcs.io.private_files import make_private, private
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Effect,
    Event,
    MissionEnded,
    NoticeCode,
    OrderAnswer,
    Plan,
    Proposal,
    Snapshot,
    Tick,
    UploadReport,
)
from gcs.service.service import Service

VERSION = 4
_MAX_BYTES = 64 * 1024 * 1024
WRITE_PERIOD_NS = 5 * NS_PER_S
"""Longest time between two versions."""
MIN_WRITE_INTERVAL_NS = NS_PER_S // 2
"""Shortest time between two versions, after changes of the state other than a plan."""
_CLOSE_TIMEOUT_S = 5.0


class _Head(msgspec.Struct, frozen=True, kw_only=True):
    """The first line."""

    journal: int
    """Version of the format."""
    mission: str
    fingerprint: str
    """Of the mission file and the seed."""
    t_ns: int
    """Time of the snapshot."""
    checksum: str
    """Of the snapshot, which follows the line, and its time."""


_head_decoder = msgspec.json.Decoder(_Head)


def fingerprint(config_text: str, seed: int) -> str:
    """Return a hash that is equal for runs with the same mission file and seed."""
    return hashlib.sha256(f"{seed}\n{config_text}".encode()).hexdigest()


def _checksum(snapshot: Snapshot) -> str:
    return hashlib.sha256(f"{snapshot.t_ns}\n".encode() + snapshot.data).hexdigest()


class Journal:
    """The file of one mission.

    Parameters
    ----------
    path : Path
        The folder is created if it does not exist.
    """

    def __init__(self, path: Path, mission: str, belongs_to: str) -> None:
        self.path = path
        self._mission = mission
        self.belongs_to = belongs_to
        """Fingerprint of the mission file and the seed."""

    def write(self, snapshot: Snapshot) -> None:
        """Replace the journal, and wait for the disk.

        Raises
        ------
        JournalError
            When it cannot be written; the previous file stays.
        """
        head = _Head(
            journal=VERSION,
            mission=self._mission,
            fingerprint=self.belongs_to,
            t_ns=snapshot.t_ns,
            checksum=_checksum(snapshot),
        )
        temporary = self.path.with_name(f"{self.path.name}.{os.getpid()}.new")
        try:
            make_private(self.path.parent, exist_ok=True)
            with open(temporary, "wb", opener=private) as file:
                file.write(msgspec.json.encode(head) + b"\n" + snapshot.data)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(self.path)
        except OSError as error:
            raise JournalError(str(self.path), f"cannot be written: {error.strerror}") from None

    def read(self) -> Snapshot | None:
        """Return the stored snapshot, or None without a journal.

        Raises
        ------
        JournalError
            When it is damaged, of another version, or of another mission.
        """
        try:
            data = read_bytes(self.path, _MAX_BYTES)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise JournalError(str(self.path), f"cannot be read: {error.strerror}") from None
        first, _, body = data.partition(b"\n")
        try:
            head = _head_decoder.decode(first)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            raise JournalError(str(self.path), "is damaged, or no journal") from None
        if head.journal != VERSION:
            raise JournalError(str(self.path), f"has version {head.journal}, this service reads {VERSION}")
        snapshot = Snapshot(head.t_ns, body)
        if _checksum(snapshot) != head.checksum:
            raise JournalError(str(self.path), "is damaged: its checksum differs")
        if head.fingerprint != self.belongs_to:
            raise JournalError(
                str(self.path), f"belongs to another mission file or seed ({head.mission}); it is not used"
            )
        return snapshot


class JournalSink:
    """Writes the journal on its own thread: at once for plans and uploads, within 0.5 s for other changes."""

    def __init__(self, service: Service, journal: Journal) -> None:
        self._service = service
        self._engine = service.engine
        self._journal = journal
        self.writer = BackgroundWriter("journal", 2, NoticeCode.DISK_BLOCKED)
        self._error: JournalError | None = None
        """Error of the last attempt to write."""
        self._written_t_ns: int | None = None
        self._is_due = False
        """True if the next version is written as soon as the one before is."""
        self._is_changed = False
        self._checked_t_ns = 0
        self._uploads: set[int] = set()
        """Vehicles with an upload in progress that the journal has."""
        self._untaskable: dict[int, str] = {}
        self._failed = False

    def event(self, event: Event) -> None:
        """Write the journal when it is due: once for all plans and uploads of the event before."""
        if isinstance(event, Tick):
            self._check(event.t_ns)
        if self._is_due and self.writer.is_idle:
            self.write(event.t_ns)

    def _check(self, t_ns: int) -> None:
        """Find out whether the journal is due."""
        self._report_change()
        uploads = self._engine.state.tasking.uploads.keys()
        if uploads - self._uploads:
            self._is_due = True  # A mission that the journal does not know would be taken for another's.
        self._uploads &= uploads
        if t_ns - self._checked_t_ns >= MIN_WRITE_INTERVAL_NS:
            self._checked_t_ns = t_ns
            before = self._untaskable
            self._untaskable = self._engine.untaskable()  # a pilot may have changed a mode
            self._is_changed = self._is_changed or self._untaskable != before
        since_ns = t_ns - (self._written_t_ns or 0)
        if since_ns >= WRITE_PERIOD_NS or (self._is_changed and since_ns >= MIN_WRITE_INTERVAL_NS):
            self.write(t_ns)

    def effect(self, t_ns: int, effect: Effect) -> None:  # noqa: ARG002
        """Note a change of the state."""
        if isinstance(effect, Plan):
            # Uploads of the plan may begin before it is written: a route counts after a restart only when the
            # vehicle reads back the same mission.
            self._is_due = True
        elif isinstance(effect, AgentStatus | UploadReport | OrderAnswer | Proposal | MissionEnded):
            self._is_changed = True

    def write(self, t_ns: int) -> None:
        """Queue the state for the writer; a failure becomes an alarm and is tried again."""
        self._written_t_ns = t_ns
        snapshot = Snapshot(t_ns, encode_state(self._engine.state))
        is_queued = self.writer.put(partial(self._store, snapshot))
        self._is_changed = not is_queued
        if is_queued:
            self._is_due = False
            self._uploads = set(self._engine.state.tasking.uploads)

    def close(self) -> None:
        """Wait at most 5 s until the journal is written, and report a failure."""
        self.writer.drain(_CLOSE_TIMEOUT_S)
        self._report_change()

    def _store(self, snapshot: Snapshot) -> None:
        try:
            self._journal.write(snapshot)
        except JournalError as error:
            self._error = error
        else:
            self._error = None

    def _report_change(self) -> None:
        error = self._error
        if (error is not None) is self._failed:
            return
        self._failed = error is not None
        if error is not None:
            self._service.on_notice("journal", NoticeCode.JOURNAL_UNWRITTEN, problem=str(error))
        else:
            self._service.on_notice("journal", NoticeCode.JOURNAL_WRITTEN)
