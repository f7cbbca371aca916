"""MAVLink over TCP: connect to somebody, again and again until it works, or let others connect.

A stream is cut into frames by `gcs.mavlink.frames.stream`. A peer that does not read is not waited for:
beyond a bound, what is for it is dropped and counted. A connection over which no valid frame came for ten
seconds is closed. When a port is full, the connection that was idle for longest gives its place to a new one.
"""

from __future__ import annotations

import asyncio
import socket
from collections import Counter

from gcs.endpoints import Endpoint
from gcs.errors import LinkError
from gcs.io.links.transport import Backoff, Listener, Spoken
from gcs.mavlink.frames.codec import scan
from gcs.mavlink.frames.stream import FrameStream

_MAX_UNSENT_BYTES = 256 * 1024
_MAX_CONNECTIONS = 32
_CONNECTS_WITHIN_S = 5.0
_SPEAKS_WITHIN_S = 10.0
"""Within this time the first valid frame comes, or the connection is closed."""
_LOOK_AGAIN_S = 1.0
_TELL_AGAIN_S = 10.0
_IDLE_S = 5.0
"""Without a valid frame for so long, a connection may be closed for a new one."""


class _Stream(asyncio.Protocol):
    """One connection."""

    def __init__(self, listener: Listener, peer: str = "") -> None:
        self.peer = peer
        self.closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.spoke: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done when the first valid frame came."""
        self.heard_s = asyncio.get_running_loop().time()
        """When a valid frame came last, to a second, or when it was connected; of the loop's clock."""
        self._listener = listener
        self._framer = FrameStream()
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        if not self.peer:
            host, port = transport.get_extra_info("peername")[:2]
            self.peer = f"{host}:{port}"

    def data_received(self, data: bytes) -> None:
        whole = self._framer.take(data)
        if not whole:
            return
        now_s = asyncio.get_running_loop().time()
        if (not self.spoke.done() or now_s - self.heard_s > _LOOK_AGAIN_S) and scan(whole).frames:
            self.heard_s = now_s
            if not self.spoke.done():
                self.spoke.set_result(None)
        self._listener.heard(self.peer, whole)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        if not self.closed.done():
            self.closed.set_result(None)

    def send(self, data: bytes) -> bool:
        """Send, unless too much waits already."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return False
        if transport.get_write_buffer_size() > _MAX_UNSENT_BYTES:
            return False
        transport.write(data)
        return True

    def abort(self) -> None:
        """End the connection at once."""
        if self._transport is not None:
            self._transport.abort()


class TcpOut:
    """A connection to one remote address."""

    port = 0

    def __init__(self, endpoint: Endpoint) -> None:
        self.refused = 0
        self._endpoint = endpoint
        self._stream: _Stream | None = None
        self._running: asyncio.Task[None] | None = None

    def start(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        """Connect, and connect again whenever it is lost."""
        self._running = loop.create_task(self._run(loop, listener))

    async def _run(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        backoff, spoken, endpoint = Backoff(), Spoken(), self._endpoint
        async for _ in backoff.tries():
            try:
                connecting = loop.create_connection(
                    lambda: _Stream(listener, endpoint.remote), endpoint.host, endpoint.port
                )
                _, stream = await asyncio.wait_for(connecting, _CONNECTS_WITHIN_S)
            except (OSError, TimeoutError) as error:
                reason = (isinstance(error, OSError) and error.strerror) or "no answer"
                spoken.once(listener, "warning", f"not connected ({reason}); trying again")
                continue
            self._stream = stream
            spoken.once(listener, "info", "connected")
            listener.joined(endpoint.remote)
            await stream.closed
            self._stream = None
            listener.gone(endpoint.remote)
            spoken.once(listener, "warning", "connection lost; trying again")
            if stream.spoke.done():
                backoff.worked()

    def send(self, peer: str, data: bytes) -> None:  # noqa: ARG002  there is but one
        """Send over the connection, if there is one."""
        if self._stream is None or not self._stream.send(data):
            self.refused += 1

    def close(self) -> None:
        """Close the connection and try no more."""
        if self._running is not None:
            self._running.cancel()
        if self._stream is not None:
            self._stream.abort()


class TcpIn:
    """A TCP port that others connect to.

    Raises
    ------
    LinkError
        When it cannot be bound.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.setblocking(False)
        try:
            self._socket.bind((endpoint.host, endpoint.port))
            self._socket.listen()
        except OSError as error:
            self._socket.close()
            raise LinkError(
                str(endpoint), f"cannot listen here ({error}); is another program there? Choose another port"
            ) from None
        self.port: int = self._socket.getsockname()[1]
        self.refused = 0
        self._streams: dict[str, _Stream] = {}
        self._untold, self._told_s = 0, -_TELL_AGAIN_S
        """Connections closed without a valid frame and not told of yet, and when that was told last."""
        self._accepting: asyncio.Task[None] | None = None
        self._serving: set[asyncio.Task[None]] = set()

    def start(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        """Accept connections from now on."""
        self._accepting = loop.create_task(self._accept(loop, listener))

    async def _accept(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        while True:
            try:
                connection, _ = await loop.sock_accept(self._socket)
            except OSError:  # gone before it was accepted, or no more file descriptors
                await asyncio.sleep(0.1)
                continue
            if len(self._streams) >= _MAX_CONNECTIONS and not self._make_room(loop.time(), listener):
                connection.close()
                self.refused += 1
                continue
            task = loop.create_task(self._serve(loop, connection, listener))
            self._serving.add(task)
            task.add_done_callback(self._serving.discard)

    async def _serve(
        self, loop: asyncio.AbstractEventLoop, connection: socket.socket, listener: Listener
    ) -> None:
        try:
            _, stream = await loop.connect_accepted_socket(lambda: _Stream(listener), connection)
        except OSError:
            connection.close()
            return
        self._streams[stream.peer] = stream
        listener.joined(stream.peer)
        either = {stream.spoke, stream.closed}
        await asyncio.wait(either, timeout=_SPEAKS_WITHIN_S, return_when=asyncio.FIRST_COMPLETED)
        if stream.spoke.done():
            listener.news("info", f"{stream.peer} connected")
            await stream.closed
        self._end(stream, listener, "disconnected")

    def _make_room(self, now_s: float, listener: Listener) -> bool:
        """Close the idlest connection for a new one; return False when all are in use."""
        hosts = Counter(_host(stream) for stream in self._streams.values())
        idle = [s for s in self._streams.values() if not s.spoke.done() or now_s - s.heard_s > _IDLE_S]
        if not idle:
            return False
        idlest = min(idle, key=lambda s: (s.spoke.done(), -hosts[_host(s)], s.heard_s))
        self._end(idlest, listener, "closed: idle, and there is no room for another")
        return True

    def _end(self, stream: _Stream, listener: Listener, why: str) -> None:
        """Forget a connection and close it, unless that was done before."""
        if self._streams.get(stream.peer) is not stream:
            return
        del self._streams[stream.peer]
        stream.abort()
        listener.gone(stream.peer)
        if stream.spoke.done():
            listener.news("info", f"{stream.peer} {why}")
            return
        self._untold += 1
        now_s = asyncio.get_running_loop().time()
        if now_s - self._told_s >= _TELL_AGAIN_S:
            text = (
                f"{self._untold} connections without a valid frame were closed, the last from {stream.peer}"
            )
            listener.news("warning", text)
            self._untold, self._told_s = 0, now_s

    def send(self, peer: str, data: bytes) -> None:
        """Send to somebody who is connected."""
        stream = self._streams.get(peer)
        if stream is None or not stream.send(data):
            self.refused += 1

    def close(self) -> None:
        """End all connections and accept no more."""
        for task in (self._accepting, *self._serving):
            if task is not None:
                task.cancel()
        for stream in self._streams.values():
            stream.abort()
        self._socket.close()


def _host(stream: _Stream) -> str:
    return stream.peer.rpartition(":")[0]
