"""Messages to systemd (https://www.freedesktop.org/software/systemd/man/sd_notify.html), if it starts us.

A unit with ``Type=notify`` counts as started when the program says so. With ``WatchdogSec`` a program that
gives no sign of life in time is killed and started again: one whose event loop no longer runs.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import AsyncIterator
from typing import Final

_PER_PERIOD: Final = 3
"""Signs of life in the time of the watchdog."""


@contextlib.asynccontextmanager
async def watched() -> AsyncIterator[None]:
    """Say that the program has started, give signs of life, and say at last that it ends."""
    _send("READY=1")
    watchdog_us = os.environ.get("WATCHDOG_USEC", "")
    period_s = int(watchdog_us) / 1e6 / _PER_PERIOD if watchdog_us.isdecimal() else 0.0
    signs = asyncio.create_task(_give_signs(period_s)) if period_s else None
    try:
        yield
    finally:
        if signs is not None:
            signs.cancel()
        _send("STOPPING=1")


async def _give_signs(period_s: float) -> None:
    while True:
        _send("WATCHDOG=1")
        await asyncio.sleep(period_s)


def _send(message: str) -> None:
    """Send a message; it is dropped if systemd did not start the program, or does not read."""
    path = os.environ.get("NOTIFY_SOCKET", "")
    if not path:
        return
    address = f"\0{path[1:]}" if path.startswith("@") else path
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as to:
        to.setblocking(False)
        to.sendto(message.encode(), address)
