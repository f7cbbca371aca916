"""Recorder: writes every event, effect and truth of a run; parts of bounded size, space kept free.

A message's ``sequence`` counts all records of the run. So the order of consumption is known although times
may be equal or run back. ``log_time`` is the time of the run.

Messages wait in a compressed chunk of at most 1 MB, which a flush ends. The recorder flushes once a second:
after SIGKILL or on a full disk everything older than that is readable. A flush does not wait for the disk (no
fsync), so a power cut may cost more. A write may block: a service records on a thread
(`gcs.io.recording.recorder_thread`).

A new part begins with an event when a file has grown past `DiskBudget.rotate_bytes`. This bounds memory too,
since the index of an MCAP is kept until its file is finished.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from errno import ENOTDIR
from math import inf
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Final, Self

from gcs.errors import RecordingError
from gcs.io.private_files import make_private, new_folder, private
from gcs.io.recording.disk_space import DiskSpace
from gcs.io.recording.folder import CONFIG_NAME, MCAP_NAME, TLOG_NAME, VERSIONS_NAME, Run, part_paths
from gcs.io.recording.part import PendingRecord, RecordingPart
from gcs.io.recording.topics import Recordable
from gcs.model import Effect, Event, NoticeCode, Notify, Parameter, Snapshot, Truth

_ROTATE_BYTES: Final = 500_000_000
"""Size that viewers in a browser can load, and that every file system can hold."""
_FLUSH_PERIOD_S: Final = 0.8
"""With the time until a record gets here, less than the second that a crash may cost."""
_MAX_PENDING: Final = 512
"""Records that wait for a flush. They are written to the new folder if the current one is deleted."""
_LOW_SPACE_FRACTION: Final = 0.8
"""Part of the disk budget from which on an alarm is raised."""


@dataclass(frozen=True, slots=True)
class DiskBudget:
    """Disk space that a recording may use."""

    rotate_bytes: int = _ROTATE_BYTES
    """Size of an MCAP or tlog at which the next part begins. It is checked every 512 records and at each
    flush."""
    max_bytes: float = inf
    """Maximum size of all parts together."""
    min_free_bytes: float = 0.0
    """Space that is left free for the journal and other programs."""


class Recorder:
    """Writes a recording.

    The recorder raises an alarm at four fifths of its budget, or if little more than the minimum is free. At
    the limit it finishes the recording and raises `RecordingError`. It never deletes a record.

    Parameters
    ----------
    folder : Path
        Created if it does not exist. A folder with a recording is refused.
    config_text : str
        The mission file.
    versions : mapping
        Version of each library that a result depends on.
    run : Run, optional
        Parameters that are not in the mission file.
    budget : DiskBudget, optional
        Disk space that the recording may use.

    Raises
    ------
    RecordingError
        If the folder cannot be written; also by every method, such as on a full disk. Flushed records
        stay readable.
    """

    def __init__(
        self,
        folder: Path,
        config_text: str,
        versions: Mapping[str, str],
        run: Run | None = None,
        budget: DiskBudget | None = None,
    ) -> None:
        self.folder = folder
        self.notify: Notify = _ignore
        """Called with notices for the operator."""
        self._metadata = config_text, dict(versions), run
        self._budget = budget or DiskBudget()
        self.space: DiskSpace | None = None
        """None before the first flush."""
        self._finished_bytes = 0
        """Size of earlier parts."""
        self._sequence = 0
        """Number of records that are written."""
        self._pending: list[PendingRecord] = []
        self._part_count = 0
        self._is_part_full = self._is_closed = False
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
                str(folder), "has a recording already; choose another folder or move it away"
            ) from None
        except OSError as error:
            raise RecordingError(
                str(folder), f"cannot be written: {error.strerror}; choose another folder"
            ) from None
        self._new_files = [
            folder / name for name in (CONFIG_NAME, VERSIONS_NAME) if not (folder / name).exists()
        ]
        """Text files that did not exist before."""
        try:
            self._begin_folder()
        except OSError as error:
            failure = self._fail(error)
            self._discard()
            raise failure from None

    def _begin_folder(self) -> None:
        config_text, versions, _ = self._metadata
        for name, text in (
            (CONFIG_NAME, config_text),
            (VERSIONS_NAME, json.dumps(versions, indent=2) + "\n"),
        ):
            with open(self.folder / name, "w", encoding="utf-8", opener=private) as file:
                file.write(text)
        self._part.begin(*self._metadata)

    def _next_part(self) -> RecordingPart:
        self._part_count += 1
        names = [Path(name) for name in (MCAP_NAME, TLOG_NAME)]
        if self._part_count > 1:
            names = [name.with_stem(f"{name.stem}-{self._part_count:03}") for name in names]
        return RecordingPart(*(self.folder / name for name in names))

    def record_event(self, event: Event) -> None:
        """Record an event; call it before the engine processes the event."""
        if self._is_part_full:
            self._rotate()
        elif monotonic() >= self._flush_at_s:
            self.flush()
        self._add(event, event.t_ns)

    def record_effect(self, t_ns: int, effect: Effect, payload: bytes = b"") -> None:
        """Record an effect of the engine.

        Parameters
        ----------
        t_ns : int
            Time of the event that caused the effect.
        effect : Effect
            The effect.
        payload : bytes
            The effect as JSON; empty if it is not encoded yet.
        """
        self._add(effect, t_ns, payload)

    def record_truth(self, truth: Truth) -> None:
        """Record the ground truth of a simulated world."""
        self._add(truth, truth.t_ns)

    def record_snapshot(self, snapshot: Snapshot) -> None:
        """Record the state before the next event."""
        self._add(snapshot, snapshot.t_ns)

    def flush(self) -> None:
        """Hand everything recorded so far to the operating system; `record_event` does so once a second."""
        if self._is_closed:
            return
        try:
            self._replace_missing_folder()
            self._write_pending()
            self._part.flush()
            self._check_space()
        except OSError as error:
            raise self._fail(error) from None
        self._flush_at_s = monotonic() + _FLUSH_PERIOD_S

    def _replace_missing_folder(self) -> None:
        """Continue in a new folder if the current one was deleted or moved away."""
        if self._part.is_in_place():
            return
        self._part.abandon()
        lost = self.folder
        self.folder = new_folder(self.folder.parent, self.folder.name)
        self._part_count = self._finished_bytes = 0
        self._part = self._next_part()
        self._begin_folder()
        self.notify(NoticeCode.RECORDING_MOVED, lost=str(lost), folder=str(self.folder))

    def _check_space(self) -> None:
        """Raise an alarm while disk space is low; finish the recording when the budget is used up."""
        used = self._finished_bytes + sum(self._part.file_bytes)
        disk = os.statvfs(self.folder)
        free = disk.f_bavail * disk.f_frsize
        budget = self._budget
        if used >= budget.max_bytes or free < budget.min_free_bytes:
            self._is_closed = True
            self._part.finish()
            why = f"it has {used / 1e9:.2f} GB (recording.max_gb)"
            if free < budget.min_free_bytes:
                why = f"its disk has {free / 1e6:.0f} MB left (recording.min_free_mb)"
            raise RecordingError(str(self.folder), f"ended: {why}; the recording is complete")
        is_low = used >= _LOW_SPACE_FRACTION * budget.max_bytes or free < budget.min_free_bytes / (
            1.0 - _LOW_SPACE_FRACTION
        )
        if is_low != (self.space is not None and self.space.is_low):
            self.notify(
                NoticeCode.DISK_LOW if is_low else NoticeCode.DISK_FREE,
                folder=str(self.folder),
                used_gb=used / 1e9,
                free_mb=free / 1e6,
                max_gb=budget.max_bytes / 1e9,
                min_free_mb=budget.min_free_bytes / 1e6,
            )
        self.space = DiskSpace(used, free, is_low)

    def close(self) -> None:
        """Finish the files; do nothing if the recording has ended.

        A recording without a record is deleted, so that the next start may use the folder.
        """
        if self._is_closed:
            return
        self._is_closed = True
        if not self._sequence and not self._pending:
            self._part.abandon()
            self._discard()
            return
        try:
            self._write_pending()
            self._part.finish()
        except OSError as error:
            raise self._fail(error) from None

    def _rotate(self) -> None:
        """Finish the current part and begin the next."""
        try:
            self._replace_missing_folder()
            self._write_pending()
            self._finished_bytes += self._part.finish()
            self._part = self._next_part()
            self._part.begin(*self._metadata)
        except OSError as error:
            raise self._fail(error) from None
        self._is_part_full = False

    def _discard(self) -> None:
        """Delete the files of this recorder, and the folder if it is empty then."""
        with contextlib.suppress(OSError):
            for path in (*self._part.paths, *self._new_files):
                path.unlink(missing_ok=True)
            self.folder.rmdir()

    def _add(self, record: Recordable, t_ns: int, payload: bytes = b"") -> None:
        if self._is_closed:
            raise RecordingError(str(self.folder), "is closed")
        self._pending.append((record, t_ns, payload))
        if len(self._pending) >= _MAX_PENDING:
            try:
                self._write_pending()
            except OSError as error:
                raise self._fail(error) from None

    def _write_pending(self) -> None:
        pending = self._pending
        self._pending = []
        self._part.add(pending, self._sequence)
        self._sequence += len(pending)
        self._is_part_full = max(self._part.file_bytes) > self._budget.rotate_bytes

    def _fail(self, error: OSError) -> RecordingError:
        """Close the files unfinished: there may be no space for an index. Return the error to raise."""
        self._is_closed = True
        self._part.abandon()
        return RecordingError(
            str(self.folder),
            f"cannot be written any further ({error.strerror}); earlier records stay readable",
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _ignore(_code: NoticeCode, /, **_parameters: Parameter) -> None:
    """Notify nobody."""
