"""TCP connections that are late, lossy or cut: proxies between the processes of a service.

TCP delivers in order and repeats what is lost, so a lost segment is a delay of all that follows it. A cut
keeps connections open and passes nothing on, as a partition does; afterwards everything comes late.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import threading
from dataclasses import dataclass
from typing import Final, TypeAlias

_REPEAT_S: Final = 0.2
"""Time until a lost segment is repeated: Linux's minimum (TCP_RTO_MIN)."""
_CHUNK: Final = 16 * 1024
_MAX_CHUNKS: Final = 64
"""On their way; then the sender waits, as with full buffers."""
_POLL_S: Final = 0.01

_Chunks: TypeAlias = asyncio.Queue[tuple[float, bytes]]


@dataclass(slots=True)
class Path:
    """One proxy: `endpoint` leads to a TCP endpoint of zenoh."""

    endpoint: str
    delay_s: float = 0.0
    """Each way."""
    loss: float = 0.0
    """Probability that a chunk is lost once."""
    is_cut: bool = False

    def heal(self) -> None:
        """Pass everything on at once."""
        self.delay_s = 0.0
        self.loss = 0.0
        self.is_cut = False


class SlowNetwork:
    """Proxies on a thread."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._loop = asyncio.new_event_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    def path_to(self, endpoint: str) -> Path:
        """Return a new proxy to an endpoint such as ``tcp/127.0.0.1:7447``."""
        return asyncio.run_coroutine_threadsafe(self._listen(endpoint), self._loop).result(10.0)

    async def _listen(self, endpoint: str) -> Path:
        path = Path("")
        port = int(endpoint.rpartition(":")[2])

        async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            try:
                far_reader, far_writer = await asyncio.open_connection("127.0.0.1", port)
            except OSError:
                writer.close()
                return
            for source, sink in ((reader, far_writer), (far_reader, writer)):
                task = self._loop.create_task(self._pass_on(path, source, sink))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)

        server = await asyncio.start_server(accept, "127.0.0.1", 0)
        path.endpoint = f"tcp/127.0.0.1:{server.sockets[0].getsockname()[1]}"
        return path

    async def _pass_on(self, path: Path, source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        """Pass one direction on until it closes."""
        chunks: _Chunks = asyncio.Queue(_MAX_CHUNKS)
        writing = self._loop.create_task(self._write(path, chunks, sink))
        try:
            with contextlib.suppress(OSError):
                while data := await source.read(_CHUNK):
                    late_s = path.delay_s
                    while self._random.random() < path.loss:
                        late_s += _REPEAT_S
                    await chunks.put((self._loop.time() + late_s, data))
                while not chunks.empty():
                    await asyncio.sleep(_POLL_S)
        finally:
            writing.cancel()
            sink.close()

    async def _write(self, path: Path, chunks: _Chunks, sink: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while True:
                due_s, data = await chunks.get()
                await asyncio.sleep(max(0.0, due_s - self._loop.time()))
                while path.is_cut:
                    await asyncio.sleep(_POLL_S)
                sink.write(data)
                await sink.drain()

    def close(self) -> None:
        """End all proxies."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(10.0)
