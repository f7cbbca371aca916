"""Preflight checks on demand: `gcs preflight` in a process of its own.

The process reaches the vehicles through the running service, as the command does when an operator starts it.
So neither the checks nor a defect in them delays the flight.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
import time
from typing import Any, Final

import msgspec

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
        self._running: asyncio.Task[dict[str, Any]] | None = None
        self._last: dict[str, Any] | None = None

    def last(self) -> dict[str, Any]:
        """Return the last result, and whether checks are running."""
        is_running = self._running is not None and not self._running.done()
        return {"possible": self._mission_file is not None, "running": is_running, "result": self._last}

    async def run(self) -> dict[str, Any]:
        """Run the checks, or wait for those that run already; return as `last` does."""
        if self._mission_file is not None:
            if self._running is None or self._running.done():
                self._running = asyncio.create_task(_checked(self._mission_file))
            self._last = await asyncio.shield(self._running)
        return self.last()


async def _checked(mission_file: str) -> dict[str, Any]:
    """Return the object that `gcs preflight --json` prints, or an object with `error`."""
    command = (*_COMMAND, mission_file, "--json", "--wait", str(_WAIT_S))
    begun = {"at_ms": time.time_ns() // 1_000_000}
    process = await asyncio.create_subprocess_exec(
        *command,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        printed, errors = await asyncio.wait_for(process.communicate(), _TIMEOUT_S)
    except TimeoutError:
        return begun | {"error": f"gcs preflight did not end within {_TIMEOUT_S:.0f} s"}
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
    try:
        return begun | msgspec.json.decode(printed, type=dict[str, Any])
    except msgspec.DecodeError:
        text = errors.decode(errors="replace").strip()
        return begun | {"error": text[-_MAX_ERROR:] or f"gcs preflight ended with {process.returncode}"}
