"""A UDP socket for MAVLink, read in batches by the event loop.

`loop.add_reader` with `recvfrom` until the socket is empty costs a few microseconds a datagram, several
times less than asyncio's datagram protocol. A datagram is handed on as it came: what it means is decided
behind the queue.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable

from gcs.errors import LinkError

_MAX_DATAGRAM_BYTES = 65_535
_BATCH = 256
_BUFFER_BYTES = 4 * 1024 * 1024


class UdpLink:
    """One listening UDP socket, such as ``udpin:0.0.0.0:14550``.

    Parameters
    ----------
    endpoint : str
        ``udpin:HOST:PORT``; port 0 takes a free one.

    Raises
    ------
    LinkError
        When the endpoint cannot be bound.
    """

    def __init__(self, endpoint: str) -> None:
        self.endpoint = endpoint
        _, host, port = endpoint.split(":")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        try:
            self._socket.bind((host, int(port)))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise LinkError(
                endpoint,
                f"cannot listen here ({error}); is another ground station running? "
                "Choose another port in links.mavlink",
            ) from None
        self.port: int = self._socket.getsockname()[1]
        self.refused = 0
        """Datagrams that the system would not send (full buffer, no route)."""

    def start(self, loop: asyncio.AbstractEventLoop, receive: Callable[[str, bytes], None]) -> None:
        """Call `receive(peer, data)` for each datagram from now on."""
        loop.add_reader(self._socket.fileno(), self._drain, receive)

    def _drain(self, receive: Callable[[str, bytes], None]) -> None:
        for _ in range(_BATCH):
            try:
                data, (host, port) = self._socket.recvfrom(_MAX_DATAGRAM_BYTES)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:
                continue  # an ICMP error of an earlier send: the peer is gone, its silence will tell
            receive(f"{host}:{port}", data)

    def send(self, peer: str, data: bytes) -> None:
        """Send one datagram to a peer that was heard before."""
        host, _, port = peer.rpartition(":")
        try:
            self._socket.sendto(data, (host, int(port)))
        except OSError:
            self.refused += 1

    def close(self, loop: asyncio.AbstractEventLoop) -> None:
        """Stop reading and close the socket."""
        loop.remove_reader(self._socket.fileno())
        self._socket.close()
