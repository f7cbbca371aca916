"""Calls to the event loop from other threads, such as those of zenoh."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import TypeVarTuple

_Parts = TypeVarTuple("_Parts")


def on_loop(loop: asyncio.AbstractEventLoop, callback: Callable[[*_Parts], object], *parts: *_Parts) -> None:
    """Call a function on the event loop, from any thread; do nothing after the end of the loop."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(callback, *parts)
