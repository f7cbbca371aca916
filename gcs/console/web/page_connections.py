"""Pages that are connected, each with a short queue of messages.

Messages are encoded once for all pages. A page that does not read fast enough loses its queue and gets a
snapshot when it reads again, so the memory of a page is bounded and no other page waits for it.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Final

from gcs.console.web.listener import CLIENT_SHARE

_MAX_QUEUED: Final = 16


class Client:
    """One page.

    Parameters
    ----------
    snapshot : callable
        Returns everything that a page shows.
    address : str
        Client that has opened it.
    may_operate : bool
        True if its token is for orders.
    """

    def __init__(self, snapshot: Callable[[], bytes], address: str = "", *, may_operate: bool = True) -> None:
        self.address = address
        self.may_operate = may_operate
        self.used = 0
        """Number of the last use of this page, among the uses of all pages; 0: somebody only opened it."""
        self.is_ended = False
        """True if its place is given to another page."""
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

    def end(self) -> None:
        """Give its place to another page."""
        self.is_ended = True
        self._has_news.set()

    async def next(self) -> bytes | None:
        """Return the next message: a snapshot at first, and after a loss; None at its end."""
        await self._has_news.wait()
        if self.is_ended:
            return None
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

    A page that somebody uses is never the first to go. When there are too many, of one client or of all, one
    that may only view gives its place to another, then one that nobody has used, then the one that was used
    longest ago.

    Parameters
    ----------
    snapshot : callable
        Returns everything that a page shows.
    limit : int
        Number of pages that may be open; one client may have `CLIENT_SHARE` of them.
    """

    def __init__(self, snapshot: Callable[[], bytes], limit: int) -> None:
        self._snapshot = snapshot
        self._limit = limit
        self._clients: dict[Client, None] = {}
        self._uses = 0

    def __len__(self) -> int:
        return len(self._clients)

    def join(self, address: str = "", *, may_operate: bool = True) -> Client | None:
        """Add a page; return None if all places are taken by pages that come before it."""
        client = Client(self._snapshot, address, may_operate=may_operate)
        of_client = [one for one in self._clients if one.address == address]
        for others, limit in (
            (of_client, int(self._limit * CLIENT_SHARE)),
            (list(self._clients), self._limit),
        ):
            if len(others) < limit:
                continue
            first = min(others, key=lambda one: (one.may_operate, one.used))  # the oldest of equals
            if first.may_operate and not may_operate:
                return None
            self.leave(first)
            first.end()
        self._clients[client] = None
        return client

    def use(self, client: Client) -> None:
        """Note that somebody uses a page."""
        self._uses += 1
        client.used = self._uses

    def leave(self, client: Client) -> None:
        """Remove a page."""
        self._clients.pop(client, None)

    def send(self, message: bytes) -> None:
        """Queue a message for every page."""
        for client in self._clients:
            client.put(message)
