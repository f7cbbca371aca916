"""Signals to a running command: SIGINT and SIGTERM end it, SIGHUP takes its terminal away."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable

from gcs.io.background_writer import QueuedText


def fly_on_after_hangup(view: QueuedText) -> Callable[[], object]:
    """Continue without a terminal on SIGHUP; return a function that undoes this."""
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGHUP, view.hang_up)
    return lambda: loop.remove_signal_handler(signal.SIGHUP)


def wait_for_interrupt(*stops: asyncio.Event) -> Callable[[], None]:
    """Set one more of `stops` with each SIGINT or SIGTERM; return a function that undoes this."""
    loop = asyncio.get_running_loop()

    def interrupt() -> None:
        next((stop for stop in stops if not stop.is_set()), stops[-1]).set()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, interrupt)

    def undo() -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)

    return undo
