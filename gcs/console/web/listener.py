"""The listening socket of the console, and bounds on the connections that it accepts.

uvicorn bounds neither the connections of one client nor the time before a request; its one bound on the
number of connections refuses operators as well. So the bounds are here, where TLS handshakes count, too.

- When a client, or all clients, have as many connections as they may, the one that waits longest without a
  request is closed. So nobody is locked out by connections that do nothing.
- A connection has a time for each request, and another for the time between requests.
- What a connection sends is bounded: a burst, and then so much a second.
- Descriptors are left for the service itself: most are not for the console.
"""

from __future__ import annotations

import contextlib
import os
import resource
import socket
import time
from collections.abc import Callable
from typing import Any, Final

from gcs.console.web.console_access import DEFAULT_PORT, Access
from gcs.errors import ConsoleError

MAX_CONNECTIONS: Final = 256
LISTEN_BACKLOG: Final = 64
"""Connections that wait to be accepted, and that are accepted at once."""
_PORTS: Final = 50
"""Ports that are tried from the default one on."""
_SHARE: Final = 4
"""The console takes at most one in so many of the descriptors that the process may have."""
CLIENT_SHARE: Final = 0.75
"""Of the connections, and of the pages: for one client."""
_PAGES: Final = 0.625
"""Of the connections."""
MAX_IDLE_S: Final = 10.0
"""Time in which a request must arrive: after connecting, with TLS, and after each request."""
MAX_BUSY_S: Final = 120.0
"""Time of one request; pages are open for longer."""
_MAX_READ_BYTES: Final = 16 * 1024
_NO_DESCRIPTOR_S: Final = 0.05
_CLOSING: Final = 32
"""Connections that may be closing while others are accepted."""
_REQUEST_BYTES: Final = (1_000_000, 256_000)
"""What a connection may send at once, and in each second."""
_PAGE_BYTES: Final = (16_000, 2_000)
"""Of the connection of an open page."""


def client_of(host: str) -> str:
    """Return the client of an address: an IPv6 network of 64 bits is one client."""
    return host if host.count(":") < 4 else ":".join(host.split(":")[:4])


class Connection(socket.socket):
    """An accepted connection."""

    def __init__(self, accepted: socket.socket, client: str, closed: Callable[[Connection], None]) -> None:
        super().__init__(accepted.family, accepted.type, accepted.proto, accepted.detach())
        self.client = client
        self.is_page = False
        """True while it is the WebSocket of a page."""
        self.is_busy = False
        """True while a request is served."""
        self.is_ended = False
        """True if it is to be closed."""
        self.since_s = time.monotonic()
        """Begin of that request, or of the wait for one."""
        self._closed_call = closed
        self._bytes: float = _REQUEST_BYTES[0]
        self._counted_s = self.since_s

    def begin(self, *, is_page: bool) -> None:
        """Note that a request has arrived."""
        self.is_busy = True
        self.is_page = is_page
        self.since_s = time.monotonic()

    def finish(self) -> None:
        """Note that the request is done."""
        self.is_busy = self.is_page = False
        self.since_s = time.monotonic()

    def end(self) -> None:
        """End both directions; the server notices and closes it."""
        self.is_ended = True
        with contextlib.suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def recv(self, size: int, flags: int = 0) -> bytes:
        """Receive; nothing more from one that sends too much."""
        return self._counted(super().recv(min(size, _MAX_READ_BYTES), flags))

    def recv_into(self, buffer: Any, size: int = 0, flags: int = 0) -> int:
        """Receive into a buffer, as `recv`; used with TLS."""
        room = min(size or len(buffer), _MAX_READ_BYTES)
        received = super().recv_into(buffer, room, flags)
        return received if self._may_send(received) else 0

    def close(self) -> None:
        """Close it, and give its place to another."""
        super().close()
        self._closed_call(self)

    def _counted(self, data: bytes) -> bytes:
        return data if self._may_send(len(data)) else b""

    def _may_send(self, received: int) -> bool:
        burst, per_s = _PAGE_BYTES if self.is_page else _REQUEST_BYTES
        now_s = time.monotonic()
        self._bytes = min(burst, self._bytes + per_s * (now_s - self._counted_s)) - received
        self._counted_s = now_s
        if self._bytes >= 0:
            return True
        self.end()
        return False


class Listener(socket.socket):
    """The listening socket: a new one, or that of a descriptor which another process has opened."""

    def __init__(self, family: int = -1, fileno: int | None = None) -> None:
        super().__init__(family, -1 if fileno is not None else socket.SOCK_STREAM, fileno=fileno)
        self.connections: dict[tuple[Any, ...], Connection] = {}
        """By the client's host and port."""
        self.abort: Callable[[tuple[Any, ...]], None] = lambda _peer: None
        """Drops a connection at once, whatever waits to be sent on it."""
        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        self.limit = MAX_CONNECTIONS if soft < 0 else max(8, min(MAX_CONNECTIONS, soft // _SHARE))
        self.max_pages = int(self.limit * _PAGES)
        self._reserve = os.open(os.devnull, os.O_RDONLY)

    def connection(self, peer: tuple[str, int] | None) -> Connection | None:
        """Return the connection from a host and port."""
        return None if peer is None else self.connections.get(tuple(peer))

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept a connection; close another for it if there are too many.

        Raises
        ------
        BlockingIOError
            When there is none, or others must be closed first.
        """
        if len(self.connections) >= self.limit + _CLOSING:
            raise BlockingIOError
        try:
            accepted, address = super().accept()
        except OSError as error:
            if isinstance(error, (BlockingIOError, InterruptedError, ConnectionAbortedError)):
                raise
            self._refuse()  # no descriptor is left: else asyncio logs this as often as it can
            raise BlockingIOError from None
        client = client_of(address[0])
        peer = tuple(address[:2])
        present = [one for one in self.connections.items() if not one[1].is_ended]
        self._make_room([one for one in present if one[1].client == client], int(self.limit * CLIENT_SHARE))
        self._make_room(present, self.limit)
        connection = Connection(accepted, client, lambda one: self._forget(peer, one))
        self.connections[peer] = connection
        return connection, address

    def end_late(self, now_s: float) -> None:
        """Drop connections that keep the server waiting."""
        for peer, one in list(self.connections.items()):
            limit_s = MAX_BUSY_S if one.is_busy else MAX_IDLE_S
            if not one.is_page and now_s - one.since_s > limit_s:
                self._drop(peer, one)

    def close(self) -> None:
        """Close it."""
        super().close()
        self._release()

    def _make_room(self, present: list[tuple[tuple[Any, ...], Connection]], limit: int) -> None:
        """Drop the connection that waits longest if there are too many; a page only if all are pages."""
        if len(present) >= limit:
            self._drop(*min(present, key=lambda one: (one[1].is_page, one[1].is_busy, one[1].since_s)))

    def _drop(self, peer: tuple[Any, ...], connection: Connection) -> None:
        connection.end()
        self.abort(peer)

    def _refuse(self) -> None:
        """Close a connection that waits, with the descriptor that is kept for this."""
        self._release()
        with contextlib.suppress(OSError):
            super().accept()[0].close()
        with contextlib.suppress(OSError):
            self._reserve = os.open(os.devnull, os.O_RDONLY)
        if self._reserve < 0:  # another took it
            time.sleep(_NO_DESCRIPTOR_S)

    def _release(self) -> None:
        if self._reserve >= 0:
            os.close(self._reserve)
        self._reserve = -1

    def _forget(self, peer: tuple[Any, ...], connection: Connection) -> None:
        if self.connections.get(peer) is connection:
            del self.connections[peer]


def bind(access: Access) -> Listener:
    """Return a listening socket; on the default address at the next free port.

    Raises
    ------
    ConsoleError
        When no port is free, or the address is not of this machine.
    """
    ports = range(DEFAULT_PORT, DEFAULT_PORT + _PORTS) if access.port is None else (access.port,)
    family = socket.AF_INET6 if ":" in access.host else socket.AF_INET
    problem = ""
    for port in ports:
        listener = Listener(family)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((access.host, port))
            listener.listen(LISTEN_BACKLOG)
        except OSError as error:
            listener.close()
            problem = error.strerror or str(error)
            continue
        listener.setblocking(False)
        return listener
    raise ConsoleError(
        f"console: {access.host} port {ports[0]} cannot be opened ({problem}); choose another with --console "
        "HOST:PORT, or --console off"
    )
