"""A recorder on a thread of its own: a disk that is slow, full or away stops no flight."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Any, Final, Self

from gcs.errors import RecordingError
from gcs.io.output import Writer
from gcs.io.recording.writer import Recorder
from gcs.model import Effect, Event, Truth

_HAND_OVER_S: Final = 0.1
"""How often records are handed to the thread; with the recorder's flush period, less than a second."""
_BATCH: Final = 512
_MAX_WAITING: Final = 300_000
"""Records that wait for the disk at most: half a minute of the heaviest traffic, hours of a small swarm."""
_CLOSE_S: Final = 30.0


class RecorderThread:
    """Hands records to a recorder on a thread of its own, in order.

    Every record is written, or the recording ends with an error: a recording with a hole could not be
    replayed.

    Parameters
    ----------
    recorder : Recorder
        Used by nobody else from now on.
    """

    def __init__(self, recorder: Recorder) -> None:
        self.writer = Writer("recording", _MAX_WAITING, "alarm", tells_error=False)
        self._recorder = recorder
        recorder.notify = self.writer.tell
        self._batch: list[tuple[Callable[..., None], tuple[Any, ...]]] = []
        self._due_s = monotonic()
        self._handed = self._written = 0
        self._ended = False

    @property
    def folder(self) -> Path:
        """Where it records now: another folder when the first was deleted."""
        return self._recorder.folder

    def event(self, event: Event) -> None:
        """Record what goes into the fold; call it before the fold works it.

        Raises
        ------
        RecordingError
            If the recording cannot be written any further; also by the methods below.
        """
        if len(self._batch) >= _BATCH or monotonic() >= self._due_s:
            self._hand_over()
        self._batch.append((self._recorder.event, (event,)))

    def effect(self, t_ns: int, effect: Effect, payload: bytes = b"") -> None:
        """Record what came out of the fold at `t_ns`; `payload` is its JSON where there is one already."""
        self._batch.append((self._recorder.effect, (t_ns, effect, payload)))

    def truth(self, truth: Truth) -> None:
        """Record the truth of a simulated world."""
        self._batch.append((self._recorder.truth, (truth,)))

    def close(self) -> None:
        """Write what waits and finish the files; does nothing after an error that was raised before."""
        if self._ended:
            return
        self._hand_over()
        self.writer.put(self._recorder.close)
        is_written = self.writer.drain(_CLOSE_S)
        self._check()
        self._ended = True
        if not is_written:
            raise self._too_slow()

    def _hand_over(self) -> None:
        batch, self._batch = self._batch, []
        self._due_s = monotonic() + _HAND_OVER_S
        self._handed += len(batch)
        if self._handed - self._written > _MAX_WAITING:
            self._ended = True
            self.writer.fail(self._too_slow())
        else:
            self.writer.put(partial(self._write, batch))
        self._check()

    def _check(self) -> None:
        error = self.writer.error
        if error is not None:
            self._ended = True
            raise (
                error if isinstance(error, RecordingError) else RecordingError(str(self.folder), repr(error))
            )

    def _too_slow(self) -> RecordingError:
        return RecordingError(str(self.folder), "cannot be written any further (the disk takes nothing)")

    def _write(self, batch: list[tuple[Callable[..., None], tuple[Any, ...]]]) -> None:
        for record, arguments in batch:
            record(*arguments)
        self._written += len(batch)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
