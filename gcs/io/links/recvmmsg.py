"""Everything that waits in a UDP socket, at one system call.

`recvmmsg` (Linux, https://man7.org/linux/man-pages/man2/recvmmsg.2.html) fills up to 256 slots at a call; a
flood is put together by sender (`gcs.mavlink.frames.batches`), a few datagrams are handed on as they are.
Elsewhere they are read one by one.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import select
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Final, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from gcs.mavlink.frames.batches import DatagramBatcher

Numbers: TypeAlias = npt.NDArray[np.int64]
Heard: TypeAlias = list[tuple[str, bytes]]
"""(peer, data), in order."""

SLOTS: Final = 256
"""Datagrams that one call takes at most."""
FLOOD: Final = 16
"""From so many on they are put together."""

_MAX_DATAGRAM_BYTES: Final = 65_536
_SLOT_BYTES: Final = _MAX_DATAGRAM_BYTES + 64
"""Not a power of two, so that the slots' beginnings do not fall into the same lines of the cache."""
_MAX_PEERS: Final = 4096
_PAUSE_MS: Final = 10
"""Between two looks at a flooded socket: being woken for a datagram costs more than the datagram."""
_RETRY_MS: Final = 1000
_MAX_WAIT_S: Final = 2.0
"""Datagrams that the loop did not take for so long are dropped: they are taken for new when they come."""


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
    """Empties sockets."""

    def read(self, source: socket.socket) -> tuple[int, Heard]:
        """Take up to `SLOTS` datagrams from a socket that does not block.

        Returns how many there were, and what is to be handed on.
        """


class SingleReader:
    """`recvfrom` until the socket is empty: the simple form."""

    def read(self, source: socket.socket) -> tuple[int, Heard]:
        """Take up to `SLOTS` datagrams."""
        heard: Heard = []
        for _ in range(SLOTS):
            try:
                data, (host, port) = source.recvfrom(_MAX_DATAGRAM_BYTES)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                continue  # an ICMP error of an earlier send: the peer is gone, its silence will tell
            heard.append((f"{host}:{port}", data))
        return len(heard), heard


class BatchReader:
    """`recvmmsg` into slots that are used again."""

    def __init__(self) -> None:
        self._recvmmsg = ctypes.CDLL(None, use_errno=True).recvmmsg
        self._slots = np.zeros(
            (SLOTS, _SLOT_BYTES), np.uint8
        )  # the system gives a page when it is written to
        self._names = np.zeros((SLOTS, 2), np.int64)
        """sockaddr_in: family, port and address fill the first eight bytes."""
        self._vectors = (_IoVector * SLOTS)()
        self._headers = (_Header * SLOTS)()
        for i, (vector, header) in enumerate(zip(self._vectors, self._headers, strict=True)):
            vector.base, vector.length = self._slots[i].ctypes.data, _MAX_DATAGRAM_BYTES
            message = header.message
            message.name, message.name_length = self._names[i].ctypes.data, self._names[i].nbytes
            message.vector, message.vectors = ctypes.pointer(vector), 1
        words = np.frombuffer(memoryview(self._headers).cast("B"), np.uint32).reshape(SLOTS, -1)
        self._lengths = words[:, _Header.length.offset // 4]
        self._gatherer: DatagramBatcher | None = None
        self._peers: dict[int, str] = {}

    def read(self, source: socket.socket) -> tuple[int, Heard]:
        """Take up to `SLOTS` datagrams."""
        count = self._recvmmsg(source.fileno(), self._headers, SLOTS, socket.MSG_DONTWAIT, None)
        if count <= 0:
            return 0, []  # empty, or an ICMP error of an earlier send, which this call has taken away
        lengths, senders = self._lengths[:count].astype(np.int64), self._names[:count, 0].copy()
        if count < FLOOD:
            parts: Iterable[tuple[int, bytes]] = enumerate(
                self._slots[i, :n].tobytes() for i, n in enumerate(lengths.tolist())
            )
        else:
            parts = self._gathered(lengths, senders)
        return count, [(self._peer(senders.item(i)), data) for i, data in parts]

    def _gathered(self, lengths: Numbers, senders: Numbers) -> Iterable[tuple[int, bytes]]:
        """Put a flood together; the kernel is loaded at the first one, unless a service has warmed it up."""
        if self._gatherer is None:
            from gcs.mavlink.frames.batches import DatagramBatcher

            self._gatherer = DatagramBatcher(SLOTS)
        return self._gatherer.gather(self._slots, lengths, senders)

    def _peer(self, name: int) -> str:
        peer = self._peers.get(name)
        if peer is None:
            raw = name.to_bytes(8, sys.byteorder, signed=True)
            if len(self._peers) >= _MAX_PEERS:
                self._peers.clear()
            peer = self._peers[name] = f"{socket.inet_ntoa(raw[4:])}:{int.from_bytes(raw[2:4], 'big')}"
        return peer


_of_thread = threading.local()


def reader() -> Reader:
    """Return this thread's reader: all its sockets share the slots."""
    if not hasattr(_of_thread, "reader"):
        _of_thread.reader = BatchReader() if sys.platform == "linux" else SingleReader()
    found: Reader = _of_thread.reader
    return found


class SocketReader:
    """Hands the datagrams of a UDP socket, read on a thread, to the event loop in their order.

    The kernel keeps few datagrams: 0.2 MB by Linux's default, which 250 vehicles at 50 Hz fill in 50 ms.
    A loop that is busy with a plan for longer would lose the rest. The thread keeps them instead.

    Parameters
    ----------
    loop : asyncio.AbstractEventLoop
        Where `heard` is called.
    source : socket.socket
        A UDP socket that does not block; whoever made it closes it, after `close`.
    heard : callable
        Takes (peer, data) for each datagram, or for some of one peer put together.
    failed : callable
        Takes the reason, on the loop, when the thread could not read. It tries again every second.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        source: socket.socket,
        heard: Callable[[str, bytes], None],
        failed: Callable[[str], None],
    ) -> None:
        self.source, self.heard, self.failed, self.is_closed = source, heard, failed, False
        self._thread = _thread_of(loop)
        self._thread.add(self)

    def close(self) -> None:
        """Stop reading; nothing is handed on any more."""
        self.is_closed = True
        self._thread.remove(self)


class _ReaderThread:
    """Reads all UDP sockets of a loop; runs while there is one."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._sockets: dict[int, SocketReader] = {}
        self._reading, self._queueing = threading.Lock(), threading.Lock()
        self._waiting: deque[tuple[float, SocketReader, Heard]] = deque()
        self._poll = select.poll()
        self._wake, self._woken = socket.socketpair()
        self._poll.register(self._woken, select.POLLIN)
        self._pause = select.poll()
        self._pause.register(self._woken, select.POLLIN)
        self._thread = threading.Thread(target=self._run, name="udp-reader", daemon=True)

    def add(self, reader: SocketReader) -> None:
        """Read this socket, too."""
        with self._reading:
            self._sockets[reader.source.fileno()] = reader
            self._poll.register(reader.source, select.POLLIN)
        if not self._thread.is_alive():
            self._thread.start()
        self._wake.send(b"x")

    def remove(self, reader: SocketReader) -> None:
        """Read this socket no more; end with the last one."""
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
                    most = self._read(source_reader)
                if FLOOD <= most < SLOTS:
                    self._pause.poll(_PAUSE_MS)
            except Exception as error:
                self._on_loop(partial(self._tell_failure, str(error) or type(error).__name__))
                self._pause.poll(_RETRY_MS)

    def _read(self, source_reader: Reader) -> int:
        """Read what waits in each socket; return the greatest number that one of them had."""
        most = 0
        for fd, _ in self._poll.poll(0):
            if fd == self._woken.fileno():
                self._woken.recv(SLOTS)
                continue
            count, heard = source_reader.read(self._sockets[fd].source)
            most = max(most, count)
            if heard:
                self._keep(self._sockets[fd], heard)
        return most

    def _keep(self, source: SocketReader, heard: Heard) -> None:
        """Keep datagrams for the loop, and wake it."""
        now_s = time.monotonic()
        with self._queueing:
            is_first = not self._waiting
            self._waiting.append((now_s, source, heard))
            while now_s - self._waiting[0][0] > _MAX_WAIT_S:
                self._waiting.popleft()
        if is_first:
            self._on_loop(self._hand_on)

    def _on_loop(self, callback: Callable[[], None]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(callback)

    def _tell_failure(self, reason: str) -> None:
        for source in [*self._sockets.values()]:
            source.failed(reason)

    def _hand_on(self) -> None:
        with self._queueing:
            waiting, self._waiting = self._waiting, deque()
        for _, source, heard in waiting:
            if not source.is_closed:
                for peer, data in heard:
                    source.heard(peer, data)


_threads: dict[asyncio.AbstractEventLoop, _ReaderThread] = {}


def _thread_of(loop: asyncio.AbstractEventLoop) -> _ReaderThread:
    if loop not in _threads:
        _threads[loop] = _ReaderThread(loop)
    return _threads[loop]
