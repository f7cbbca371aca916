"""Limit on wrong tokens: each client may try a few, and then one a second.

Tokens of a client beyond that are refused unread, the right one too. But a client that had the right token is
never refused: nobody can lock an operator out from another address. The answer to a wrong token is delayed.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any, Final

from gcs.console.view.page_records import Role
from gcs.console.web.console_access import Access
from gcs.console.web.listener import client_of

BURST: Final = 10
_PER_S: Final = 1.0
_DELAY_S: Final = 1.0
_MAX_CLIENTS: Final = 1000


class TooManyAttemptsError(Exception):
    """A client has tried too many wrong tokens; this one was not looked at."""


class Attempts:
    """Checks tokens, and counts the wrong ones of each client.

    Parameters
    ----------
    access : Access
        The right tokens.
    """

    def __init__(self, access: Access) -> None:
        self._access = access
        self._wrong: dict[str, tuple[float, float]] = {}
        """Wrong tokens by client, less those that time has forgiven, and when that was."""
        self._known: dict[str, None] = {}
        """Clients that had the right token."""

    async def role(self, token: str, host: str) -> Role | None:
        """Return the role of a token; None for a wrong one.

        Raises
        ------
        TooManyAttemptsError
            When the client has tried too many wrong ones.
        """
        client = client_of(host)
        now_s = time.monotonic()
        count, at_s = self._wrong.get(client, (0.0, now_s))
        count = max(0.0, count - _PER_S * (now_s - at_s))
        if count > BURST - 1 and client not in self._known:
            raise TooManyAttemptsError
        role = self._access.role(token)
        if role is not None:
            _put(self._known, client, None)
            return role
        _put(self._wrong, client, (count + 1.0, now_s))
        await asyncio.sleep(_DELAY_S)
        return None


def _put(entries: dict[str, Any], client: str, value: Any) -> None:
    """Put an entry last; forget the first ones of too many."""
    entries.pop(client, None)
    entries[client] = value
    while len(entries) > _MAX_CLIENTS:
        del entries[next(iter(entries))]
