"""Writing on a background thread: terminals, pipes and disks may block at any time.

A terminal blocks on Ctrl-S, a pipe without a reader, a disk when it is busy or gone. The event loop hands
work to a `BackgroundWriter` and goes on.
"""

from __future__ import annotations

import io
import os
import select
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Final, TextIO, cast

from rich.console import Console

from gcs.io.terminal import ERRORS
from gcs.model import NoticeCode, NoticeContent, Parameter

_STUCK_S: Final = 3.0
"""A write that takes longer causes a notice."""
_MAX_PIECES: Final = 1000
"""Lines or frames queued for a terminal; more are dropped."""
_DRAIN_S: Final = 5.0
"""Wait at the end for a blocked terminal."""


class BackgroundWriter:
    """Runs jobs that may block, in order, on its own thread.

    A job that raises ends the output: its error is kept, and later jobs are dropped.

    Parameters
    ----------
    name : str
        Name of the output in notices.
    max_waiting : int
        Maximum number of queued jobs, including the one in progress.
    blocked : NoticeCode
        Notice that a job takes long.
    reports_error : bool
        False if the user of the writer reports the error.
    """

    def __init__(
        self,
        name: str,
        max_waiting: int,
        blocked: NoticeCode = NoticeCode.OUTPUT_BLOCKED,
        *,
        reports_error: bool = True,
    ) -> None:
        self.name = name
        self.error: BaseException | None = None
        """Error that ended the output."""
        self.dropped = 0
        """Jobs that were dropped."""
        self._max_waiting = max_waiting
        self._blocked = blocked
        self._jobs: deque[Callable[[], None]] = deque()
        """The first one is in progress."""
        self._changed = threading.Condition()
        self._began_s = 0.0
        self._is_error_reported = not reports_error
        self._is_stuck_reported = False
        self._notices: deque[NoticeContent] = deque()
        threading.Thread(target=self._work, name=f"write {name}", daemon=True).start()

    @property
    def is_idle(self) -> bool:
        """True if everything is written."""
        return not self._jobs

    def put(self, job: Callable[[], None]) -> bool:
        """Queue a job; return False if the queue is full, or an error ended the output."""
        with self._changed:
            if self.error is not None or len(self._jobs) >= self._max_waiting:
                self.dropped += 1
                return False
            if not self._jobs:
                self._began_s = monotonic()
            self._jobs.append(job)
            self._changed.notify_all()
        return True

    def drain(self, within_s: float) -> bool:
        """Wait until everything is written; return False after `within_s`."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._jobs, within_s)

    def fail(self, error: Exception) -> None:
        """End the output with an error."""
        with self._changed:
            self.error = self.error or error
            while len(self._jobs) > 1:  # the first one is in progress
                self._jobs.pop()

    def notify(self, code: NoticeCode, /, **parameters: Parameter) -> None:
        """Add a notice, from a job."""
        self._notices.append((code, parameters))

    def notice(self) -> NoticeContent | None:
        """Return the next notice, if any."""
        if self._notices:
            return self._notices.popleft()
        with self._changed:
            error = self.error
            stuck_s = monotonic() - self._began_s if self._jobs else 0.0
        if error is not None:
            if self._is_error_reported:
                return None
            self._is_error_reported = True
            reason = (error.strerror if isinstance(error, OSError) else None) or error
            return NoticeCode.OUTPUT_ENDED, {"cause": str(reason)}
        if (stuck_s > _STUCK_S) is self._is_stuck_reported:
            return None
        self._is_stuck_reported = not self._is_stuck_reported
        if self._is_stuck_reported:
            return self._blocked, {"seconds": stuck_s}
        return NoticeCode.OUTPUT_AGAIN, {"dropped": self.dropped}

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._jobs)
                self._began_s = monotonic()
            error: BaseException | None = None
            try:
                self._jobs[0]()  # not kept: what it refers to may be large
            except BaseException as raised:  # A library may panic. The flight continues, with a notice.
                error = raised
            with self._changed:
                self._jobs.popleft()
                if error is not None:
                    self.error = self.error or error
                    self._jobs.clear()
                self._changed.notify_all()


class QueuedText(io.TextIOBase):
    """A text stream whose writes never block.

    Parameters
    ----------
    stream : TextIO
        Destination. Characters that its encoding lacks are written in ASCII, or as a question mark.
    """

    def __init__(self, stream: TextIO) -> None:
        self.writer = BackgroundWriter("view", _MAX_PIECES)
        self._stream = stream
        self._is_terminal = stream.isatty()
        try:
            self._fileno = stream.fileno()
            stream.flush()
        except (OSError, ValueError):  # a stream in memory
            self._fileno = -1

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the stream."""
        return getattr(self._stream, "encoding", None) or "utf-8"

    def isatty(self) -> bool:
        """Return True if it is a terminal."""
        return self._is_terminal

    def fileno(self) -> int:
        """Return the descriptor of the stream."""
        return self._stream.fileno()

    def write(self, text: str) -> int:
        """Queue text; it is dropped if the queue is full."""
        if self._fileno < 0:
            self.writer.put(lambda: self._write_in_memory(text))
        else:
            data = text.encode(self.encoding, ERRORS)
            self.writer.put(lambda: _write_all(self._fileno, data))
        return len(text)

    def _write_in_memory(self, text: str) -> None:
        self._stream.write(text)

    def flush(self) -> None:
        """Do nothing: the thread writes at once."""

    def hang_up(self) -> None:
        """End the output of a terminal that is gone (SIGHUP)."""
        if self._is_terminal:
            self.writer.fail(ConnectionError("the terminal hung up"))


def is_busy(console: Console) -> bool:
    """Return True if a console's last frame is not written, or its output has ended."""
    file = console.file
    return isinstance(file, QueuedText) and (not file.writer.is_idle or file.writer.error is not None)


@contextmanager
def off_loop(console: Console) -> Iterator[QueuedText]:
    """Let a console print on a thread; at the end wait for it, 5 s at most."""
    before = console.file
    text = QueuedText(cast(TextIO, before))
    console.file = cast(TextIO, text)
    try:
        yield text
    finally:
        text.writer.drain(_DRAIN_S)
        if text.writer.error is None and text.writer.is_idle:
            console.file = before


def _write_all(fileno: int, data: bytes) -> None:
    """Write to a descriptor, also one that another program has set not to block."""
    rest = memoryview(data)
    while rest:
        try:
            rest = rest[os.write(fileno, rest) :]
        except BlockingIOError:
            select.select((), (fileno,), ())
