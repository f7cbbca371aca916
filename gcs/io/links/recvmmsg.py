"""Reading of UDP sockets, many datagrams per system call, each up to a greatest size.

`recvmmsg` (Linux, https://man7.org/linux/man-pages/man2/recvmmsg.2.html) reads up to 256 datagrams per call.
A flood is batched by sender (`gcs.mavlink.frames.batches`). Other systems read one by one.
"""

from __future__ import annotations

import asyncio
import ctypes
import select
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from gcs.io.event_loop import on_loop

if TYPE_CHECKING:
    from gcs.mavlink.frames.batches import DatagramBatcher

Numbers: TypeAlias = npt.NDArray[np.int64]
PeerData: TypeAlias = list[tuple[str, bytes]]
"""(peer, data), in order."""

SLOTS: Final = 256
"""Maximum number of datagrams per call."""
FLOOD: Final = 16
"""Number of datagrams from which they are batched."""

_MAX_DATAGRAM_BYTES: Final = 65_536
_SLOT_BYTES: Final = _MAX_DATAGRAM_BYTES + 64
"""Not a power of two, so that slots start in different cache lines."""
_MAX_PEERS: Final = 4096
_PAUSE_MS: Final = 10
"""Pause between reads of a flooded socket: a wake-up costs more than a datagram."""
_RETRY_MS: Final = 1000
_MAX_WAIT_S: Final = 2.0
"""Datagrams that wait longer are dropped: they would count as new."""


class _IoVector(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class _Message(ctypes.Structure):
    """``struct msghdr``."""

    _fields_ = (
        ("name", ctypes.c_void_p),
        ("name_length", ctypes.c_uint32),
        ("vector", ctypes.POINTER(_IoVector)),
        ("vectors", ctypes.c_size_t),
        ("control", ctypes.c_void_p),
        ("control_length", ctypes.c_size_t),
        ("flags", ctypes.c_int),
    )


class _Header(ctypes.Structure):
    """``struct mmsghdr``."""

    _fields_ = (("message", _Message), ("length", ctypes.c_uint32))


class Reader(Protocol):
    """Reads sockets."""

    def read(self, source: socket.socket) -> tuple[int, PeerData]:
        """Read up to `SLOTS` datagrams from a non-blocking socket.

        Returns their number, and the data to deliver.
        """


class SingleReader:
    """`recvfrom` until the socket is empty: the reference."""

    def read(self, source: socket.socket) -> tuple[int, PeerData]:
        """Read up to `SLOTS` datagrams."""
        heard: PeerData = []
        for _ in range(SLOTS):
            try:
                data, (host, port) = source.recvfrom(_MAX_DATAGRAM_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                continue  # An ICMP error of an earlier send.
            heard.append((f"{host}:{port}", data))
        return len(heard), heard


class BatchReader:
    """`recvmmsg` into reused slots."""

    def __init__(self) -> None:
        self._recvmmsg = ctypes.CDLL(None, use_errno=True).recvmmsg
        self._slots = np.zeros((SLOTS, _SLOT_BYTES), np.uint8)
        self._names = np.zeros((SLOTS, 2), np.int64)
        """sockaddr_in: family, port and address fill the first eight bytes."""
        self._vectors = (_IoVector * SLOTS)()
        self._headers = (_Header * SLOTS)()
        for i, (vector, header) in enumerate(zip(self._vectors, self._headers, strict=True)):
            vector.base = self._slots[i].ctypes.data
            vector.length = _MAX_DATAGRAM_BYTES
            message = header.message
            message.name = self._names[i].ctypes.data
            message.name_length = self._names[i].nbytes
            message.vector = ctypes.pointer(vector)
            message.vectors = 1
        words = np.frombuffer(memoryview(self._headers).cast("B"), np.uint32).reshape(SLOTS, -1)
        self._lengths = words[:, _Header.length.offset // 4]
        self._batcher: DatagramBatcher | None = None
        self._peers: dict[int, str] = {}

    def read(self, source: socket.socket) -> tuple[int, PeerData]:
        """Read up to `SLOTS` datagrams."""
        count = self._recvmmsg(source.fileno(), self._headers, SLOTS, socket.MSG_DONTWAIT, None)
        if count <= 0:
            return 0, []  # Empty, or an ICMP error of an earlier send.
        lengths = self._lengths[:count].astype(np.int64)
        senders = self._names[:count, 0].copy()
        if count < FLOOD:
            parts: Iterable[tuple[int, bytes]] = enumerate(
                self._slots[i, :n].tobytes() for i, n in enumerate(lengths.tolist())
            )
        else:
            parts = self._batched(lengths, senders)
        return count, [(self._peer(senders.item(i)), data) for i, data in parts]

    def _batched(self, lengths: Numbers, senders: Numbers) -> Iterable[tuple[int, bytes]]:
        """Batch a flood by sender; the kernel is loaded at the first one unless warmed up."""
        if self._batcher is None:
            from gcs.mavlink.frames.batches import DatagramBatcher

            self._batcher = DatagramBatcher(SLOTS)
        return self._batcher.gather(self._slots, lengths, senders)

    def _peer(self, name: int) -> str:
        peer = self._peers.get(name)
        if peer is None:
            raw = name.to_bytes(8, sys.byteorder, signed=True)
            if len(self._peers) >= _MAX_PEERS:
                self._peers.clear()
            peer = self._peers[name] = f"{socket.inet_ntoa(raw[4:])}:{int.from_bytes(raw[2:4], 'big')}"
        return peer


_thread_local = threading.local()


def reader() -> Reader:
    """Return this thread's reader: all its sockets share the slots."""
    if not hasattr(_thread_local, "reader"):
        _thread_local.reader = BatchReader() if sys.platform == "linux" else SingleReader()
    found: Reader = _thread_local.reader
    return found


class SocketReader:
    """Delivers the datagrams of a UDP socket, read on a thread, to the event loop in order.

    The system buffers few datagrams: 0.2 MB by Linux's default, 50 ms of 250 vehicles at 50 Hz. The thread
    buffers them while the loop is busy.

    Parameters
    ----------
    loop : asyncio.AbstractEventLoop
        Loop that calls `heard`.
    source : socket.socket
        A non-blocking UDP socket; its owner closes it, after `close`.
    heard : callable
        Takes (peer, data) of a datagram, or of a batch of one peer.
    failed : callable
        Takes the reason, on the loop, when a read failed. The thread tries again every second.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        source: socket.socket,
        heard: Callable[[str, bytes], None],
        failed: Callable[[str], None],
    ) -> None:
        self.source = source
        self.heard = heard
        self.failed = failed
        self.is_closed = False
        self._thread = _thread_of(loop)
        self._thread.add(self)

    def close(self) -> None:
        """Stop reading; nothing more is delivered."""
        self.is_closed = True
        self._thread.remove(self)


class _ReaderThread:
    """Reads all UDP sockets of a loop; runs while there is one."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._sockets: dict[int, SocketReader] = {}
        self._reading = threading.Lock()
        self._queueing = threading.Lock()
        self._waiting: deque[tuple[float, SocketReader, PeerData]] = deque()
        self._poll = select.poll()
        self._wake, self._woken = socket.socketpair()
        self._poll.register(self._woken, select.POLLIN)
        self._pause = select.poll()
        self._pause.register(self._woken, select.POLLIN)
        self._thread = threading.Thread(target=self._run, name="udp-reader", daemon=True)

    def add(self, reader: SocketReader) -> None:
        """Add a socket."""
        with self._reading:
            self._sockets[reader.source.fileno()] = reader
            self._poll.register(reader.source, select.POLLIN)
        if not self._thread.is_alive():
            self._thread.start()
        self._wake.send(b"x")

    def remove(self, reader: SocketReader) -> None:
        """Remove a socket; end with the last one."""
        with self._reading:
            if self._sockets.pop(reader.source.fileno(), None) is None:
                return
            self._poll.unregister(reader.source)
        if not self._sockets:
            _threads.pop(self._loop, None)
            self._wake.send(b"x")
            self._thread.join()
            self._wake.close()
            self._woken.close()

    def _run(self) -> None:
        source_reader = reader()
        while self._sockets:
            try:
                self._poll.poll()
                with self._reading:
                    max_count = self._read(source_reader)
                if FLOOD <= max_count < SLOTS:
                    self._pause.poll(_PAUSE_MS)
            except Exception as error:
                on_loop(self._loop, self._report_failure, str(error) or type(error).__name__)
                self._pause.poll(_RETRY_MS)

    def _read(self, source_reader: Reader) -> int:
        """Read each socket; return the greatest number of datagrams of one."""
        max_count = 0
        for fd, _ in self._poll.poll(0):
            if fd == self._woken.fileno():
                self._woken.recv(SLOTS)
                continue
            count, heard = source_reader.read(self._sockets[fd].source)
            max_count = max(max_count, count)
            if heard:
                self._enqueue(self._sockets[fd], heard)
        return max_count

    def _enqueue(self, source: SocketReader, heard: PeerData) -> None:
        """Queue datagrams for the loop, and wake it."""
        now_s = time.monotonic()
        with self._queueing:
            is_first = not self._waiting
            self._waiting.append((now_s, source, heard))
            while now_s - self._waiting[0][0] > _MAX_WAIT_S:
                self._waiting.popleft()
        if is_first:
            on_loop(self._loop, self._deliver)

    def _report_failure(self, reason: str) -> None:
        for source in [*self._sockets.values()]:
            source.failed(reason)

    def _deliver(self) -> None:
        with self._queueing:
            waiting = self._waiting
            self._waiting = deque()
        for _, source, heard in waiting:
            if not source.is_closed:
                for peer, data in heard:
                    source.heard(peer, data)


_threads: dict[asyncio.AbstractEventLoop, _ReaderThread] = {}


def _thread_of(loop: asyncio.AbstractEventLoop) -> _ReaderThread:
    if loop not in _threads:
        _threads[loop] = _ReaderThread(loop)
    return _threads[loop]
