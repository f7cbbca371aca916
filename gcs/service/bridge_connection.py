"""Connection of a command, or its standby, to the bridges of a mission: one of this machine, or named ones.

The bridge of this machine is started here, or taken over (`bridge_supervision`). Named bridges run by
themselves, on any machine.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import socket
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from gcs.config import Config
from gcs.endpoints import Link
from gcs.io.cluster.all_bridges import AllBridges
from gcs.io.cluster.bridge_links import BridgeLinks
from gcs.io.cluster.bridge_settings import BridgeSettings, bridge_settings
from gcs.io.cluster.command_lease import CommandLease
from gcs.io.zenoh.discovery import private_folder
from gcs.io.zenoh.session import ZenohSession
from gcs.mavlink.frames.codec import FrameTable
from gcs.service.bridge_supervision import BridgeProcess

_MAX_FOLDER: Final = 70
_MAX_DELAY_NS: Final = 300_000_000
"""Time that a standby leaves to other standbys: another one for each."""


@contextlib.contextmanager
def bridges_of(
    config: Config,
    source: str,
    links: Sequence[Link],
    scan: Callable[[bytes], FrameTable],
    folder: Path | None = None,
) -> Iterator[AllBridges]:
    """Connect to the bridges of a mission; yield their links.

    Without `links.bridges` there is one on this machine: started here, or taken over from a command that was
    killed. It keeps its frames in a folder in `folder`.

    Raises
    ------
    LinkError, ConfigError
        An endpoint or the key file cannot be opened.
    """
    if config.links.bridges:
        with _connected_to_all(config, source, links, scan) as found:
            yield found
        return
    settings = bridge_settings(config, source, links, folder=folder)
    settings = msgspec.structs.replace(settings, zenoh=f"unixsock-stream/{_socket_folder()}/bridge.sock")
    process = BridgeProcess(settings, _file_of(settings))
    process.begin()
    goes_on = False
    try:
        with _connected_to_local(config, process, scan) as found:
            try:
                yield found
            finally:
                goes_on = found.go_on
    finally:
        process.end(goes_on=goes_on)


def is_bridge_of_other_node(config: Config, source: str, links: Sequence[Link]) -> bool:
    """Return True if the bridge of this machine belongs to the other node of a mission with a standby."""
    if config.links.bridges or not config.links.standby:
        return False
    settings = bridge_settings(config, source, links)
    return BridgeProcess(settings, _file_of(settings)).is_of_other_node()


@contextlib.contextmanager
def bridges_for_standby(
    config: Config,
    source: str,
    links: Sequence[Link],
    scan: Callable[[bytes], FrameTable],
    folder: Path | None = None,
) -> Iterator[AllBridges]:
    """Connect to the bridges that a command uses, for a standby; yield their links.

    Raises
    ------
    LinkError
        There is none on this machine, and the mission file names no other.
    """
    delay_ns = secrets.randbelow(_MAX_DELAY_NS)
    if config.links.bridges:
        with _connected_to_all(config, source, links, scan, delay_ns) as found:
            yield found
        return
    settings = bridge_settings(config, source, links, folder=folder)
    process = BridgeProcess(settings, _file_of(settings))
    process.watch()
    with _connected_to_local(config, process, scan, delay_ns) as found:
        yield found


@contextlib.contextmanager
def _connected_to_local(
    config: Config, process: BridgeProcess, scan: Callable[[bytes], FrameTable], delay_ns: int = 0
) -> Iterator[AllBridges]:
    """Connect to the bridge of this machine."""
    settings = process.settings
    lease = _lease_of(config, (settings.name,), delay_ns)
    connect = partial(ZenohSession, connect=settings.zenoh)
    one = BridgeLinks(settings, connect, lease, process.poll, process.started.ports, scan)
    try:
        yield AllBridges([one], lease)
    finally:
        one.disconnect()


@contextlib.contextmanager
def _connected_to_all(
    config: Config,
    source: str,
    links: Sequence[Link],
    scan: Callable[[bytes], FrameTable],
    delay_ns: int = 0,
) -> Iterator[AllBridges]:
    """Connect to the bridges that run by themselves."""
    names = tuple(one.name for one in config.links.bridges)
    lease = _lease_of(config, names, delay_ns)
    with contextlib.ExitStack() as stack:
        found = []
        for name in names:
            settings = bridge_settings(config, source, links, name)
            connect = partial(ZenohSession, connect=settings.zenoh, tls=settings.tls_folder)
            found.append(BridgeLinks(settings, connect, lease, scan=scan))
            stack.callback(found[-1].disconnect)
        yield AllBridges(found, lease)


def _lease_of(config: Config, bridges: tuple[str, ...], delay_ns: int) -> CommandLease:
    node = f"{socket.gethostname()}-{os.getpid()}"
    return CommandLease(node, bridges, delay_ns, is_only_node=not config.links.standby)


def _file_of(settings: BridgeSettings) -> Path:
    """Return the file of a running bridge on this machine."""
    links = settings.links
    text = repr((settings.mission, [link.name for link in links]))
    # No other command takes over a bridge on any free port: it cannot know that it is the same flight.
    is_fixed = all(link.endpoint.port or not link.endpoint.listens for link in links)
    own = "" if is_fixed else f"-{os.getpid()}"
    return private_folder() / f"bridge-{hashlib.sha256(text.encode()).hexdigest()[:12]}{own}.json"


def _socket_folder() -> Path:
    """Return a new folder of this user alone; the path of a socket has 107 characters at most."""
    folder = private_folder()
    if len(str(folder)) > _MAX_FOLDER:
        folder = Path("/tmp")  # noqa: S108  a new folder in it is our own
    return Path(tempfile.mkdtemp(prefix="bridge-", dir=folder))
