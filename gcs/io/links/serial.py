"""MAVLink over a serial port: a radio, or a flight controller on a cable, which may be unplugged at any time.

pyserial opens the port, the event loop reads and writes its file descriptor. Frames that a slow radio cannot
take in time are dropped and counted.
"""

from __future__ import annotations

import asyncio
import os
from typing import Any

from gcs.endpoints import Endpoint
from gcs.errors import LinkError
from gcs.io.links.transport import Backoff, ChangedNotices, Listener, refusal
from gcs.mavlink.frames.stream import FrameStream
from gcs.model import NoticeCode

_READ_BYTES = 4096
_MAX_UNSENT_BYTES = 8 * 1024


class SerialPort:
    """One serial port, reopened with growing waits whenever it is lost.

    Raises
    ------
    LinkError
        pyserial is not installed.
    """

    port = 0

    def __init__(self, endpoint: Endpoint) -> None:
        try:
            import serial
        except ImportError:
            raise LinkError(
                str(endpoint), "serial ports need pyserial: pip install 'swarm-gcs[serial]'"
            ) from None
        self.refused = 0
        self._open_port = serial.Serial
        self._endpoint = endpoint
        self._unsent = bytearray()
        self._device: Any = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._lost: asyncio.Future[str] | None = None
        self._running: asyncio.Task[None] | None = None

    def start(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        """Open the port, and reopen it whenever it is lost."""
        self._loop = loop
        self._running = loop.create_task(self._run(loop, listener))

    async def _run(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        backoff = Backoff()
        notices = ChangedNotices()
        endpoint = self._endpoint
        async for _ in backoff.tries():
            try:
                self._device = self._open_port(
                    endpoint.device, endpoint.baud, timeout=0, write_timeout=0, exclusive=True
                )
            except (OSError, ValueError) as error:  # SerialException is an OSError
                problem = f"cannot be opened ({refusal(error)})"
                notices.notify(listener, NoticeCode.LINK_FAILED, problem=problem)
                continue
            notices.notify(listener, NoticeCode.LINK_OPEN)
            self._lost = loop.create_future()
            loop.add_reader(self._device.fileno(), self._read, listener, FrameStream(), backoff)
            reason = await self._lost
            self._shut(loop)
            notices.notify(listener, NoticeCode.LINK_FAILED, problem=f"lost ({reason})")

    def _read(self, listener: Listener, framer: FrameStream, backoff: Backoff) -> None:
        try:
            data = os.read(self._device.fileno(), _READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._fail(error.strerror or "read error")
            return
        if not data:
            self._fail("unplugged")
            return
        backoff.worked()
        whole = framer.add_bytes(data)
        if whole:
            listener.heard(self._endpoint.remote, whole)

    def send(self, peer: str, data: bytes) -> None:  # noqa: ARG002  there is but one
        """Send or buffer frames; drop them beyond the bound."""
        if self._device is None or len(self._unsent) + len(data) > _MAX_UNSENT_BYTES:
            self.refused += 1
            return
        self._unsent += data
        self._write()

    def _write(self) -> None:
        assert self._loop is not None
        descriptor = self._device.fileno()
        try:
            sent = os.write(descriptor, self._unsent)
        except (BlockingIOError, InterruptedError):
            sent = 0
        except OSError as error:
            self._fail(error.strerror or "write error")
            return
        del self._unsent[:sent]
        if self._unsent:
            self._loop.add_writer(descriptor, self._write)
        else:
            self._loop.remove_writer(descriptor)

    def _fail(self, reason: str) -> None:
        if self._loop is not None and self._device is not None:
            self._loop.remove_reader(self._device.fileno())
            self._loop.remove_writer(self._device.fileno())
        if self._lost is not None and not self._lost.done():
            self._lost.set_result(reason)

    def _shut(self, loop: asyncio.AbstractEventLoop) -> None:
        device = self._device
        self._device = None
        if device is not None:
            loop.remove_reader(device.fileno())
            loop.remove_writer(device.fileno())
            device.close()
        self._unsent.clear()

    def close(self) -> None:
        """Close the port and try no more."""
        if self._running is not None:
            self._running.cancel()
        if self._loop is not None:
            self._shut(self._loop)
