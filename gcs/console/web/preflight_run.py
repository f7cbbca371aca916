"""Preflight checks on demand: `gcs preflight` in a process of its own.

The process reaches the vehicles through the running service, as the command does when an operator starts it.
So neither the checks nor a defect in them delays the flight.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
import time
from typing import Final

import msgspec

from gcs.console.view.page_records import PreflightReply, PreflightRun

_COMMAND: Final = ("nice", "-n", "10", sys.executable, "-P", "-m", "gcs", "preflight")
_WAIT_S: Final = 15
"""Time in which vehicles may answer."""
_TIMEOUT_S: Final = 90.0
_MAX_ERROR: Final = 500


class PreflightDesk:
    """Runs the checks, one run at a time.

    Parameters
    ----------
    mission_file : str or None
        Mission file of the service; None: nothing can be checked, as in a replay.
    """

    def __init__(self, mission_file: str | None) -> None:
        self._mission_file = mission_file
        self._running: asyncio.Task[PreflightRun] | None = None
        self._last: PreflightRun | None = None

    def last(self) -> PreflightReply:
        """Return the last result, and whether checks are running."""
        is_running = self._running is not None and not self._running.done()
        return PreflightReply(self._mission_file is not None, is_running, self._last)

    async def run(self) -> PreflightReply:
        """Run the checks, or wait for those that run already; return as `last` does."""
        if self._mission_file is not None:
            if self._running is None or self._running.done():
                self._running = asyncio.create_task(_checked(self._mission_file))
            self._last = await asyncio.shield(self._running)
        return self.last()


async def _checked(mission_file: str) -> PreflightRun:
    """Return what `gcs preflight --json` prints, or why there is nothing."""
    command = (*_COMMAND, mission_file, "--json", "--wait", str(_WAIT_S))
    at_ms = time.time_ns() // 1_000_000
    process = await asyncio.create_subprocess_exec(
        *command,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        printed, errors = await asyncio.wait_for(process.communicate(), _TIMEOUT_S)
    except TimeoutError:
        return PreflightRun(at_ms=at_ms, error=f"gcs preflight did not end within {_TIMEOUT_S:.0f} s")
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
    try:
        return msgspec.structs.replace(msgspec.json.decode(printed, type=PreflightRun), at_ms=at_ms)
    except msgspec.DecodeError:
        text = errors.decode(errors="replace").strip()
        error = text[-_MAX_ERROR:] or f"gcs preflight ended with {process.returncode}"
        return PreflightRun(at_ms=at_ms, error=error)
