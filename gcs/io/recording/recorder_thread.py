"""Recording on a thread, so that a slow, full or missing disk does not delay the event loop."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Any, Final, Self

from gcs.errors import RecordingError
from gcs.io.background_writer import BackgroundWriter
from gcs.io.recording.disk_space import DiskSpace
from gcs.io.recording.recorder import Recorder
from gcs.model import Effect, Event, NoticeCode, Snapshot, Truth

_HAND_OVER_PERIOD_S: Final = 0.1
"""With the flush period of the recorder, less than the second that a crash may cost."""
_BATCH_SIZE: Final = 512
_MAX_WAITING_RECORDS: Final = 300_000
"""Half a minute of the heaviest traffic, hours of a small swarm."""
_CLOSE_TIMEOUT_S: Final = 30.0


class RecorderThread:
    """Runs a recorder on its own thread; records stay in order.

    The recording ends with an error rather than lose a record, since a recording with a gap cannot be
    replayed. After such an error every method raises `RecordingError`.

    Parameters
    ----------
    recorder : Recorder
        Not to be used by the caller any more.
    """

    def __init__(self, recorder: Recorder) -> None:
        self.writer = BackgroundWriter(
            "recording", _MAX_WAITING_RECORDS, NoticeCode.DISK_BLOCKED, reports_error=False
        )
        self._recorder = recorder
        recorder.notify = self.writer.notify
        self._batch: list[tuple[Callable[..., None], tuple[Any, ...]]] = []
        self._hand_over_at_s = monotonic()
        self._handed_over_count = self._written_count = 0
        self._has_ended = False

    @property
    def folder(self) -> Path:
        """Current folder; it changes if the first one was deleted or moved away."""
        return self._recorder.folder

    @property
    def space(self) -> DiskSpace | None:
        """Space of the recording; None before the first flush."""
        return self._recorder.space

    def record_event(self, event: Event) -> None:
        """Record an event; call it before the engine processes the event.

        Raises
        ------
        RecordingError
            If the recording cannot be written any further.
        """
        if len(self._batch) >= _BATCH_SIZE or monotonic() >= self._hand_over_at_s:
            self._hand_over()
        self._batch.append((self._recorder.record_event, (event,)))

    def record_effect(self, t_ns: int, effect: Effect, payload: bytes = b"") -> None:
        """Record an effect at time `t_ns`; `payload` is its JSON, or empty if it is not encoded yet."""
        self._batch.append((self._recorder.record_effect, (t_ns, effect, payload)))

    def record_truth(self, truth: Truth) -> None:
        """Record the ground truth of a simulated world."""
        self._batch.append((self._recorder.record_truth, (truth,)))

    def record_snapshot(self, snapshot: Snapshot) -> None:
        """Record the state before the next event."""
        self._batch.append((self._recorder.record_snapshot, (snapshot,)))

    def close(self) -> None:
        """Write all records and finish the files; do nothing if the recording has ended."""
        if self._has_ended:
            return
        self._hand_over()
        self.writer.put(self._recorder.close)
        is_written = self.writer.drain(_CLOSE_TIMEOUT_S)
        self._raise_error()
        self._has_ended = True
        if not is_written:
            raise self._disk_stuck_error()

    def _hand_over(self) -> None:
        batch = self._batch
        self._batch = []
        self._hand_over_at_s = monotonic() + _HAND_OVER_PERIOD_S
        self._handed_over_count += len(batch)
        if self._handed_over_count - self._written_count > _MAX_WAITING_RECORDS:
            self._has_ended = True
            self.writer.fail(self._disk_stuck_error())
        else:
            self.writer.put(partial(self._write, batch))
        self._raise_error()

    def _raise_error(self) -> None:
        error = self.writer.error
        if error is not None:
            self._has_ended = True
            raise (
                error if isinstance(error, RecordingError) else RecordingError(str(self.folder), repr(error))
            )

    def _disk_stuck_error(self) -> RecordingError:
        return RecordingError(str(self.folder), "cannot be written any further (the disk blocks)")

    def _write(self, batch: list[tuple[Callable[..., None], tuple[Any, ...]]]) -> None:
        for record, arguments in batch:
            record(*arguments)
        self._written_count += len(batch)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
