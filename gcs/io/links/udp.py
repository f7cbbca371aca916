"""UDP sockets for MAVLink, read in batches by a thread (`gcs.io.links.recvmmsg`)."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable

from gcs.endpoints import Endpoint
from gcs.io.links.recvmmsg import SocketReader
from gcs.io.links.transport import Backoff, ChangedNotices, Listener, listening_error, refusal
from gcs.model import NoticeCode

BUFFER_BYTES = 4 * 1024 * 1024


class UdpIn:
    """A listening UDP socket.

    Raises
    ------
    LinkError
        It cannot be bound.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        self._socket = _socket()
        try:
            self._socket.bind((endpoint.host, endpoint.port))
        except OSError as error:
            self._socket.close()
            raise listening_error(endpoint, error) from None
        self.port: int = self._socket.getsockname()[1]
        self.refused = 0
        self._reader: SocketReader | None = None

    def start(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        """Start receiving."""
        self._reader = SocketReader(loop, self._socket, listener.heard, _alarm(listener))

    def send(self, peer: str, data: bytes) -> None:
        """Send one datagram to a known peer."""
        host, _, port = peer.rpartition(":")
        try:
            self._socket.sendto(data, (host, int(port)))
        except (OSError, ValueError, OverflowError):
            self.refused += 1

    def close(self) -> None:
        """Stop reading and close the socket."""
        if self._reader is not None:
            self._reader.close()
        self._socket.close()


class UdpOut:
    """A UDP socket connected to one remote address, whose name is resolved off the loop, with retries."""

    port = 0

    def __init__(self, endpoint: Endpoint) -> None:
        self.refused = 0
        self._endpoint = endpoint
        self._socket: socket.socket | None = None
        self._reader: SocketReader | None = None
        self._opening: asyncio.Task[None] | None = None

    def start(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        """Resolve the name, then receive from there only."""
        self._opening = loop.create_task(self._open(loop, listener))

    async def _open(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        notices = ChangedNotices()
        has_failed = False
        remote = self._endpoint
        async for _ in Backoff().tries():
            fresh = _socket()
            try:
                found = await loop.getaddrinfo(
                    remote.host, remote.port, family=socket.AF_INET, type=socket.SOCK_DGRAM
                )
                fresh.connect(found[0][4])
            except OSError as error:
                fresh.close()
                problem = f"cannot be reached ({refusal(error)})"
                notices.notify(listener, NoticeCode.LINK_FAILED, problem=problem)
                has_failed = True
                continue
            if has_failed:
                notices.notify(listener, NoticeCode.LINK_OPEN)
            self._socket = fresh
            self._reader = SocketReader(
                loop, fresh, lambda _, data: listener.heard(remote.remote, data), _alarm(listener)
            )
            return

    def send(self, peer: str, data: bytes) -> None:  # noqa: ARG002  there is but one
        """Send one datagram."""
        if self._socket is None:
            self.refused += 1
            return
        try:
            self._socket.send(data)
        except OSError:
            self.refused += 1

    def close(self) -> None:
        """Stop reading and close the socket."""
        if self._opening is not None:
            self._opening.cancel()
        if self._reader is not None:
            self._reader.close()


def _alarm(listener: Listener) -> Callable[[str], None]:
    notices = ChangedNotices()
    return lambda reason: notices.notify(listener, NoticeCode.LINK_UNREADABLE, cause=reason)


def _socket() -> socket.socket:
    fresh = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    fresh.setblocking(False)
    fresh.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    return fresh
