"""MAVLink over TCP, outgoing (with reconnects) or incoming.

`gcs.mavlink.frames.stream` finds the frames. Frames for a peer that does not read are dropped and counted
beyond a bound. A connection without a valid frame within ten seconds is closed. On a full port a new
connection replaces the one that was idle for longest.
"""

from __future__ import annotations

import asyncio
import socket
from collections import Counter

from gcs.endpoints import Endpoint
from gcs.io.links.transport import Backoff, ChangedNotices, Listener, listening_error, refusal
from gcs.mavlink.frames.codec import scan
from gcs.mavlink.frames.stream import FrameStream
from gcs.model import NoticeCode

_MAX_UNSENT_BYTES = 256 * 1024
_MAX_CONNECTIONS = 32
_CONNECTS_WITHIN_S = 5.0
_FIRST_FRAME_WITHIN_S = 10.0
"""A connection without a valid frame within this time is closed."""
_RECHECK_S = 1.0
_MIN_NOTICE_INTERVAL_S = 10.0
_IDLE_S = 5.0
"""A connection without a valid frame for so long may be closed for a new one."""


class _Stream(asyncio.Protocol):
    """One connection."""

    def __init__(self, listener: Listener, peer: str = "") -> None:
        self.peer = peer
        self.closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.has_sent_frame: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done when the first valid frame came."""
        self.heard_s = asyncio.get_running_loop().time()
        """Loop time of the last valid frame, to a second, or of the connection."""
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
        whole = self._framer.add_bytes(data)
        if not whole:
            return
        now_s = asyncio.get_running_loop().time()
        if (not self.has_sent_frame.done() or now_s - self.heard_s > _RECHECK_S) and scan(whole).frames:
            self.heard_s = now_s
            if not self.has_sent_frame.done():
                self.has_sent_frame.set_result(None)
        self._listener.heard(self.peer, whole)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        if not self.closed.done():
            self.closed.set_result(None)

    def send(self, data: bytes) -> bool:
        """Send, unless too much is buffered."""
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
        """Connect, and reconnect whenever the connection is lost."""
        self._running = loop.create_task(self._run(loop, listener))

    async def _run(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        backoff = Backoff()
        notices = ChangedNotices()
        endpoint = self._endpoint
        async for _ in backoff.tries():
            try:
                connecting = loop.create_connection(
                    lambda: _Stream(listener, endpoint.remote), endpoint.host, endpoint.port
                )
                _, stream = await asyncio.wait_for(connecting, _CONNECTS_WITHIN_S)
            except (OSError, TimeoutError) as error:
                problem = f"not connected ({refusal(error)})"
                notices.notify(listener, NoticeCode.LINK_FAILED, problem=problem)
                continue
            self._stream = stream
            notices.notify(listener, NoticeCode.LINK_OPEN)
            listener.connected(endpoint.remote)
            await stream.closed
            self._stream = None
            listener.disconnected(endpoint.remote)
            notices.notify(listener, NoticeCode.LINK_FAILED, problem="connection lost")
            if stream.has_sent_frame.done():
                backoff.worked()

    def send(self, peer: str, data: bytes) -> None:  # noqa: ARG002  there is but one
        """Send over the connection, if there is one."""
        if self._stream is None or not self._stream.send(data):
            self.refused += 1

    def close(self) -> None:
        """Close the connection."""
        if self._running is not None:
            self._running.cancel()
        if self._stream is not None:
            self._stream.abort()


class TcpIn:
    """A TCP port that accepts connections.

    Raises
    ------
    LinkError
        It cannot be bound.
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
            raise listening_error(endpoint, error) from None
        self.port: int = self._socket.getsockname()[1]
        self.refused = 0
        self._streams: dict[str, _Stream] = {}
        self._unreported = 0
        self._reported_s = -_MIN_NOTICE_INTERVAL_S
        """Connections closed without a valid frame since the last notice, and when that was."""
        self._accepting: asyncio.Task[None] | None = None
        self._serving: set[asyncio.Task[None]] = set()

    def start(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        """Accept connections from now on."""
        self._accepting = loop.create_task(self._accept(loop, listener))

    async def _accept(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        while True:
            try:
                connection, _ = await loop.sock_accept(self._socket)
            except OSError:  # Closed already, or no file descriptors left.
                await asyncio.sleep(0.1)
                continue
            if len(self._streams) >= _MAX_CONNECTIONS and not self._close_longest_idle(loop.time(), listener):
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
        listener.connected(stream.peer)
        either = {stream.has_sent_frame, stream.closed}
        await asyncio.wait(either, timeout=_FIRST_FRAME_WITHIN_S, return_when=asyncio.FIRST_COMPLETED)
        if stream.has_sent_frame.done():
            listener.notify(NoticeCode.PEER_CONNECTED, peer=stream.peer)
            await stream.closed
        self._end(stream, listener, "disconnected")

    def _close_longest_idle(self, now_s: float, listener: Listener) -> bool:
        """Close the connection that is idle for longest; return False if all are in use."""
        hosts = Counter(_host(stream) for stream in self._streams.values())
        idle = [
            s for s in self._streams.values() if not s.has_sent_frame.done() or now_s - s.heard_s > _IDLE_S
        ]
        if not idle:
            return False
        longest_idle = min(idle, key=lambda s: (s.has_sent_frame.done(), -hosts[_host(s)], s.heard_s))
        self._end(longest_idle, listener, "closed: idle, and the port is full")
        return True

    def _end(self, stream: _Stream, listener: Listener, why: str) -> None:
        """Close a connection, unless that was done before."""
        if self._streams.get(stream.peer) is not stream:
            return
        del self._streams[stream.peer]
        stream.abort()
        listener.disconnected(stream.peer)
        if stream.has_sent_frame.done():
            listener.notify(NoticeCode.PEER_GONE, peer=stream.peer, why=why)
            return
        self._unreported += 1
        now_s = asyncio.get_running_loop().time()
        if now_s - self._reported_s >= _MIN_NOTICE_INTERVAL_S:
            count = self._unreported
            listener.notify(NoticeCode.CONNECTIONS_CLOSED, count=count, peer=stream.peer)
            self._unreported = 0
            self._reported_s = now_s

    def send(self, peer: str, data: bytes) -> None:
        """Send to a connected peer."""
        stream = self._streams.get(peer)
        if stream is None or not stream.send(data):
            self.refused += 1

    def close(self) -> None:
        """Close all connections and the port."""
        for task in (self._accepting, *self._serving):
            if task is not None:
                task.cancel()
        for stream in self._streams.values():
            stream.abort()
        self._socket.close()


def _host(stream: _Stream) -> str:
    return stream.peer.rpartition(":")[0]
