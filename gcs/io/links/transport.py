"""Interfaces of MAVLink endpoints: `Transport`, and `Listener`; the waits before reconnects."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import AsyncIterator
from typing import Final, Protocol

from gcs.endpoints import Endpoint
from gcs.errors import LinkError
from gcs.model import NoticeCode, NoticeContent, Parameter

_FIRST_WAIT_S: Final = 0.5
_MAX_WAIT_S: Final = 10.0


def refusal(error: OSError | ValueError) -> str:
    """Return in a few words why an endpoint was not opened, without the address that the notice has."""
    if isinstance(error, socket.gaierror) or not isinstance(error, OSError):
        return getattr(error, "strerror", None) or str(error)
    if error.errno in (errno.EAGAIN, errno.EBUSY):
        return "another program uses it"
    return os.strerror(error.errno) if error.errno else str(error) or "no answer"


NOT_HERE: Final = "this machine does not have this address"


def listening_problem(error: OSError, port: int) -> tuple[str, str]:
    """Return in a few words why a port cannot be opened, and what to do."""
    if isinstance(error, socket.gaierror):
        return error.strerror or str(error), "correct the host, or use an address"
    if error.errno == errno.EADDRNOTAVAIL:
        return NOT_HERE, "connect its network (ip address), or correct the address; 0.0.0.0 listens on all"
    if isinstance(error, PermissionError):
        return refusal(error), "choose a port above 1023"
    remedy = f"end the program that has it (ss -lp 'sport = :{port}'), or choose another one"
    return refusal(error), remedy


def listening_error(endpoint: Endpoint, error: OSError) -> LinkError:
    """Return the error of an endpoint of `links.mavlink` or `links.forward` that cannot listen."""
    problem, remedy = listening_problem(error, endpoint.port)
    return LinkError(str(endpoint), f"cannot listen here: {problem}; {remedy} (links.mavlink, links.forward)")


class Listener(Protocol):
    """Receives the data and notices of an endpoint. `peer` is "HOST:PORT", or the device of a serial port."""

    def heard(self, peer: str, data: bytes) -> None:
        """Process a datagram, or data of a stream up to the end of a frame."""

    def connected(self, peer: str) -> None:
        """Note that a peer connected."""

    def disconnected(self, peer: str) -> None:
        """Note that a peer disconnected."""

    def notify(self, code: NoticeCode, /, **parameters: Parameter) -> None:
        """Process a notice about the endpoint."""


class Transport(Protocol):
    """One endpoint. It never blocks the loop; data that cannot be sent is dropped and counted."""

    port: int
    """Listening port; 0 if there is none."""
    refused: int
    """Sends that failed: full buffer, no route, not connected."""

    def start(self, loop: asyncio.AbstractEventLoop, listener: Listener) -> None:
        """Start receiving."""

    def send(self, peer: str, data: bytes) -> None:
        """Send to a known peer, or to the endpoint's one peer."""

    def close(self) -> None:
        """Stop and release everything."""


class Backoff:
    """Waits between attempts, growing from half a second to ten."""

    def __init__(self) -> None:
        self._wait_s = _FIRST_WAIT_S

    def worked(self) -> None:
        """Reset to the shortest wait."""
        self._wait_s = _FIRST_WAIT_S

    async def tries(self) -> AsyncIterator[None]:
        """Yield for ever, with a wait between attempts."""
        while True:
            yield
            await asyncio.sleep(self._wait_s)
            self._wait_s = min(self._wait_s * 2.0, _MAX_WAIT_S)


class ChangedNotices:
    """Passes a notice on only if it differs from the last one."""

    def __init__(self) -> None:
        self._last: NoticeContent | None = None

    def notify(self, listener: Listener, code: NoticeCode, /, **parameters: Parameter) -> None:
        """Notify the operator, unless this was the last notice."""
        if (code, parameters) != self._last:
            self._last = (code, parameters)
            listener.notify(code, **parameters)
