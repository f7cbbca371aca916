"""Pages that are connected, each with a short queue of messages.

Messages are encoded once for all pages. A page that does not read fast enough loses its queue and gets a
snapshot when it reads again, so the memory of a page is bounded and no other page waits for it.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Final

MAX_CLIENTS: Final = 200
_MAX_QUEUED: Final = 16


class Client:
    """One page."""

    def __init__(self, snapshot: Callable[[], bytes]) -> None:
        self.dropped = 0
        """Messages that the page lost because it did not read."""
        self._snapshot = snapshot
        self._queue: deque[bytes] = deque()
        self._is_behind = True
        self._has_news = asyncio.Event()
        self._has_news.set()

    def put(self, message: bytes) -> None:
        """Queue a message; if the queue is full, drop it for a snapshot."""
        if not self._is_behind:
            self._queue.append(message)
            if len(self._queue) > _MAX_QUEUED:
                self.dropped += len(self._queue)
                self._queue.clear()
                self._is_behind = True
        self._has_news.set()

    async def next(self) -> bytes:
        """Return the next message: a snapshot at first, and after a loss."""
        await self._has_news.wait()
        if self._is_behind:
            self._is_behind = False
            message = self._snapshot()
        else:
            message = self._queue.popleft()
        if not self._queue:
            self._has_news.clear()
        return message


class Clients:
    """All pages.

    Parameters
    ----------
    snapshot : callable
        Returns everything that a page shows.
    """

    def __init__(self, snapshot: Callable[[], bytes]) -> None:
        self._snapshot = snapshot
        self._clients: set[Client] = set()

    def __len__(self) -> int:
        return len(self._clients)

    @property
    def is_full(self) -> bool:
        """True if no other page may connect."""
        return len(self._clients) >= MAX_CLIENTS

    def join(self) -> Client:
        """Add a page."""
        client = Client(self._snapshot)
        self._clients.add(client)
        return client

    def leave(self, client: Client) -> None:
        """Remove a page."""
        self._clients.discard(client)

    def send(self, message: bytes) -> None:
        """Queue a message for every page."""
        for client in self._clients:
            client.put(message)
