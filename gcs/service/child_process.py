"""Child process of the service, such as the console: started again after pauses when it ends.

The process has a session of its own: signals of the terminal do not reach it. It ends when its standard input
closes, which the kernel does when this process ends, however that happens. On standard output it prints
`Report` as JSON, one a line. The last line of its standard error says why it has failed.

A process that ends is started again after a pause that grows with each end. One that has run for
`STEADY_S` begins with the first pause again. After `MAX_STARTS` in a row it is left alone, with an alarm.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections import deque
from collections.abc import AsyncIterator, Collection, Mapping, Sequence
from typing import Final

import msgspec

from gcs.model import NoticeCode, NoticeContent, Parameter

MAX_STARTS: Final = 6
FIRST_PAUSE_S: Final = 0.5
"""Doubled with each end."""
STEADY_S: Final = 60.0
_END_S: Final = 3.0
"""Time to end; then it is killed."""
_LAST_WORDS_S: Final = 0.5
"""Time to read what an ended process has printed."""
_MAX_NOTICES: Final = 100
_MAX_ERROR: Final = 300
_MAX_LINE: Final = 64 * 1024


class Report(msgspec.Struct, frozen=True, omit_defaults=True):
    """Line of a child process: it is ready, or a notice about it."""

    ready: bool = False
    code: NoticeCode | None = None
    parameters: Mapping[str, Parameter] = {}


_decode_report: Final = msgspec.json.Decoder(Report).decode


class ChildProcess:
    """A supervised process.

    Parameters
    ----------
    name : str
        Name in notices.
    command : sequence of str
        Program and arguments.
    descriptors : collection of int
        Open files that it inherits, with the same numbers.
    """

    def __init__(self, name: str, command: Sequence[str], descriptors: Collection[int] = ()) -> None:
        self.name = name
        self.process: asyncio.subprocess.Process | None = None
        """The running one."""
        self._command = tuple(command)
        self._descriptors = tuple(descriptors)
        self._starts = 0
        self._last_line = ""
        self._has_failed = False
        """True from its end until it is ready again."""
        self._notices: deque[NoticeContent] = deque(maxlen=_MAX_NOTICES)

    def notice(self) -> NoticeContent | None:
        """Return the next notice, if any."""
        return self._notices.popleft() if self._notices else None

    async def run(self) -> None:
        """Run the process, again and again; return when it is left alone."""
        while True:
            self._starts += 1
            began_s = time.monotonic()
            error = await self._run_once()
            if time.monotonic() - began_s >= STEADY_S:
                self._starts = 1
            self._has_failed = True
            if self._starts >= MAX_STARTS:
                break
            pause_s = FIRST_PAUSE_S * 2.0 ** (self._starts - 1)
            self._notify(NoticeCode.PROCESS_ENDED, error=error, pause_s=pause_s)
            await asyncio.sleep(pause_s)
        self._notify(NoticeCode.PROCESS_GIVEN_UP, error=error, starts=self._starts)

    async def close(self) -> None:
        """End the process; kill it if it does not end."""
        process = self.process
        if process is None or process.returncode is not None:
            return
        if process.stdin is not None:
            process.stdin.close()
        try:
            await asyncio.wait_for(process.wait(), _END_S)
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()

    async def _run_once(self) -> str:
        """Run the process until it ends; return why it did."""
        self._last_line = ""
        try:
            process = await asyncio.create_subprocess_exec(
                *self._command,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
                start_new_session=True,
                pass_fds=self._descriptors,
                limit=_MAX_LINE,
            )
        except OSError as error:
            return f"cannot be started: {error.strerror}"
        self.process = process
        assert process.stdout is not None
        assert process.stderr is not None
        readers = [
            asyncio.create_task(self._read_reports(process.stdout)),
            asyncio.create_task(self._read_errors(process.stderr)),
        ]
        try:
            code = await process.wait()
            await asyncio.wait(readers, timeout=_LAST_WORDS_S)  # what it has started may keep them open
        finally:
            for reader in readers:
                reader.cancel()
        how = how_ended(code)
        return f"{how}: {self._last_line}" if self._last_line else how

    async def _read_reports(self, stream: asyncio.StreamReader) -> None:
        async for line in _lines(stream):
            with contextlib.suppress(msgspec.DecodeError):
                report = _decode_report(line)
                if report.ready and self._has_failed:
                    self._has_failed = False
                    self._notify(NoticeCode.PROCESS_AGAIN)
                if report.code is not None:
                    self._notify(report.code, **report.parameters)

    async def _read_errors(self, stream: asyncio.StreamReader) -> None:
        async for line in _lines(stream):
            self._last_line = line.decode(errors="replace").strip()[:_MAX_ERROR] or self._last_line

    def _notify(self, code: NoticeCode, /, **parameters: Parameter) -> None:
        self._notices.append((code, parameters))


async def _lines(stream: asyncio.StreamReader) -> AsyncIterator[bytes]:
    """Yield lines until the stream ends; one that is too long is dropped."""
    while True:
        try:
            line = await stream.readline()
        except ValueError:  # longer than the limit
            continue
        if not line:
            return
        yield line


def how_ended(code: int) -> str:
    """Return the return code of a process in words."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"
