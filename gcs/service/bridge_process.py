"""Main of the bridge process: `python -m gcs.service.bridge_process`, with settings on standard input.

It answers with one line of JSON on standard output: the ports of its endpoints, or an error. The process that
started it keeps standard input open. When that closes without an end by command, the process was killed: the
bridge goes on with the heartbeats for the time of a failover, so that another command can take over.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from gcs.errors import GcsError
from gcs.geo import LocalFrame
from gcs.io.cluster.bridge_settings import BridgeSettings
from gcs.io.links.manager import Links
from gcs.io.signing.link_signing import LinkSigning
from gcs.io.zenoh.session import ZenohSession
from gcs.mavlink.frames.fast_scan import Scanner
from gcs.service.bridge import Bridge

_CHECK_S: Final = 0.2


class BridgeStarted(msgspec.Struct, frozen=True, kw_only=True):
    """First line of a bridge."""

    ports: dict[str, int] = {}
    error: str = ""


def main() -> int:
    """Run the bridge of a command on this machine; return its exit code."""
    settings = msgspec.json.decode(sys.stdin.buffer.readline(), type=BridgeSettings)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for command, which ends this process
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with open_bridge(settings) as bridge:
            try:
                asyncio.run(_serve(bridge))
            finally:  # not when another bridge has the endpoints: the socket is its own
                remove_socket(settings.zenoh)
    except GcsError as error:
        _answer(BridgeStarted(error=str(error)))
        return 2
    return 0


@contextlib.contextmanager
def open_bridge(settings: BridgeSettings) -> Iterator[Bridge]:
    """Open the endpoints of a bridge; yield the bridge, which is to be run.

    Raises
    ------
    LinkError, ConfigError
        An endpoint or the key file cannot be opened.
    """
    signing = LinkSigning(settings.links, None if settings.keys is None else Path(settings.keys))
    frame = LocalFrame(settings.lat_deg, settings.lon_deg, settings.alt_msl_m)
    links = Links(settings.links, settings.vehicles, frame, signing, Scanner(), settings.ports)
    with contextlib.closing(links), ZenohSession(listen=settings.zenoh, tls=settings.tls_folder) as bus:
        gc.collect()
        gc.freeze()  # short pauses of the garbage collector
        yield Bridge(
            links,
            settings.vehicles,
            settings.mission,
            settings.name,
            bus,
            settings.failover_s,
            settings.frame_log(),
            is_only=settings.is_only,
        )


def remove_socket(endpoint: str) -> None:
    """Remove the socket, which zenoh leaves behind. Its folder stays, so that no other user makes it."""
    path = Path(endpoint.partition("/")[2])
    for name in (path, Path(f"{path}.lock")):
        name.unlink(missing_ok=True)


async def _serve(bridge: Bridge) -> None:
    """Serve until command ends, or has been gone for the time of a failover."""
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    is_orphan = asyncio.Event()
    loop.add_signal_handler(signal.SIGTERM, stop.set)
    loop.add_reader(sys.stdin, _read_end, loop, is_orphan)
    serving = loop.create_task(bridge.run(stop))
    _answer(BridgeStarted(ports=bridge.links.ports()))
    while not serving.done() and not stop.is_set():
        await asyncio.sleep(_CHECK_S)
        if bridge.has_ended or (is_orphan.is_set() and bridge.has_lost_command()):
            stop.set()
    await serving


def _read_end(loop: asyncio.AbstractEventLoop, is_orphan: asyncio.Event) -> None:
    """Note that the process that started this one has ended."""
    if not os.read(sys.stdin.fileno(), 1024):
        loop.remove_reader(sys.stdin)
        is_orphan.set()


def _answer(started: BridgeStarted) -> None:
    with contextlib.suppress(OSError):
        sys.stdout.buffer.write(msgspec.json.encode(started) + b"\n")
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    sys.exit(main())
