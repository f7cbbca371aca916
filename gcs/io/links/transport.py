"""What every kind of MAVLink endpoint offers to the one who uses it, and asks of him."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Final, Protocol

from gcs.model import Level

_FIRST_WAIT_S: Final = 0.5
_LONGEST_WAIT_S: Final = 10.0


class Listener(Protocol):
    """Takes what an endpoint hears. `peer` is "HOST:PORT", or the device of a serial port."""

    def heard(self, peer: str, data: bytes) -> None:
        """Take a datagram, or what came over a stream up to the end of a frame."""

    def joined(self, peer: str) -> None:
        """Note that a peer connected."""

    def gone(self, peer: str) -> None:
        """Note that a peer's connection ended."""

    def news(self, level: Level, text: str) -> None:
        """Tell the operator."""


class Transport(Protocol):
    """One endpoint. Nothing here blocks the loop; what cannot be sent is dropped and counted."""

    port: int
    """Where it listens; 0 when it does not, or has none."""
    refused: int
    """Sends that the system would not take: full buffer, no route, not connected."""

    def start(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        """Begin to hear."""

    def send(self, peer: str, data: bytes) -> None:
        """Send to a peer that was heard, or to the endpoint's one peer."""

    def close(self) -> None:
        """Stop and let go of everything."""


class Backoff:
    """Waits between tries that grow from half a second to ten."""

    def __init__(self) -> None:
        self._wait_s = _FIRST_WAIT_S

    def worked(self) -> None:
        """Begin again with the shortest wait."""
        self._wait_s = _FIRST_WAIT_S

    async def tries(self) -> AsyncIterator[None]:
        """Yield for ever, with a wait after each but the first."""
        while True:
            yield
            await asyncio.sleep(self._wait_s)
            self._wait_s = min(self._wait_s * 2.0, _LONGEST_WAIT_S)


class Spoken:
    """Says a thing once, until something else is to be said: a link that is down is no news each second."""

    def __init__(self) -> None:
        self._last = ""

    def once(self, listener: Listener, level: Level, text: str) -> None:
        """Say it, unless it was the last thing said."""
        if text != self._last:
            self._last = text
            listener.news(level, text)
