"""Checks of this machine for `gcs doctor`: clock, disk, ports, serial rights, buffers, versions.

Nothing is changed, and nothing is sent. A port is free if it can be bound now.
"""

from __future__ import annotations

import grp
import os
import platform
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, TypeAlias

from gcs.config import Config
from gcs.endpoints import Endpoint
from gcs.io.links.transport import NOT_HERE, listening_problem
from gcs.io.links.udp import BUFFER_BYTES
from gcs.io.recording.folder import versions

Level: TypeAlias = Literal["ok", "warning", "problem"]

_OLDEST_S: Final = 1_735_689_600
"""2025-01-01: signatures and recordings of an unset clock are worthless."""
_ENOUGH_MB: Final = 2_000.0
_ENOUGH_CORES: Final = 2
_ENOUGH_MEMORY_MB: Final = 1_000.0
_ANSWER_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Finding:
    """Finding of one check."""

    check: str
    level: Level
    found: str
    remedy: str = ""
    """What to do, unless it is ok."""


def check_machine(folder: Path, min_free_mb: float) -> Iterator[Finding]:
    """Yield the findings about the machine; recordings go to `folder`."""
    yield _versions()
    yield _clock()
    yield _disk(folder, min_free_mb)
    yield _processors()
    yield _memory()
    yield _buffers()


def check_links(config: Config) -> Iterator[Finding]:
    """Yield the findings about the endpoints of a mission."""
    for link in config.mavlink_links:
        if not link.bridge:
            yield from _endpoint(link.endpoint)
    links = config.links
    if links.zenoh_role == "listen":
        nodes = [links.zenoh, *filter(None, [links.standby]), *(one.zenoh for one in links.bridges)]
        elsewhere = 0
        for endpoint in nodes:
            protocol, _, address = endpoint.partition("/")
            host, _, port = address.rpartition(":")
            kind: Literal["udp", "tcp"] = "udp" if protocol == "udp" else "tcp"
            found = _port(f"zenoh {endpoint}", kind, host, int(port))
            if len(nodes) > 1 and found.found == NOT_HERE:
                elsewhere += 1
                found = Finding(found.check, "ok", "is an address of another machine")
            yield found
        if elsewhere == len(nodes):
            remedy = (
                "connect its network (ip address), or correct links.zenoh, links.standby or links.bridges"
            )
            yield Finding("zenoh", "problem", "no endpoint has an address of this machine", remedy)


def _versions() -> Finding:
    shown = ("swarm-gcs", "python", "pymavlink", "eclipse-zenoh", "numba")
    found = versions()
    return Finding("versions", "ok", ", ".join(f"{name} {found.get(name, '-')}" for name in shown))


def _clock() -> Finding:
    if time.time() < _OLDEST_S:
        return Finding(
            "clock", "problem", "is not set", "set it: signed MAVLink and recordings need the date"
        )
    answer = _output(["timedatectl", "show", "--property=NTPSynchronized", "--value"])
    if answer == "yes":
        return Finding("clock", "ok", "is synchronised")
    if answer == "no":
        remedy = "start a time service (timedatectl set-ntp true), or set the clock before the flight"
        return Finding("clock", "warning", "is not synchronised", remedy)
    return Finding("clock", "ok", "is set; whether it is synchronised is not known here")


def _output(command: list[str]) -> str:
    """Return the output of a program; empty if it is missing or fails."""
    try:
        done = subprocess.run(  # noqa: S603  a constant
            command, capture_output=True, text=True, timeout=_ANSWER_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _disk(folder: Path, min_free_mb: float) -> Finding:
    there = next(one for one in (folder.absolute(), *folder.absolute().parents) if one.exists())
    try:
        free_mb = shutil.disk_usage(there).free / 1e6
    except OSError as error:
        return Finding("disk", "problem", str(error), "record elsewhere (--out)")
    found = f"{free_mb:,.0f} MB free for recordings in {folder}"
    if not os.access(there, os.W_OK):
        return Finding("disk", "problem", f"{there} cannot be written", "record elsewhere (--out)")
    if free_mb < min_free_mb:
        remedy = f"free disk space: below recording.min_free_mb, {min_free_mb:g} MB, nothing is recorded"
        return Finding("disk", "problem", found, remedy)
    if free_mb < _ENOUGH_MB + min_free_mb:
        return Finding("disk", "warning", found, "free disk space")
    return Finding("disk", "ok", found)


def _processors() -> Finding:
    cores = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
    found = f"{cores} cores, {platform.machine()}"
    if cores < _ENOUGH_CORES:
        return Finding("processor", "warning", found, "two cores keep links and trackers apart")
    return Finding("processor", "ok", found)


def _memory() -> Finding:
    page_bytes = os.sysconf("SC_PAGE_SIZE")
    name = "SC_AVPHYS_PAGES" if "SC_AVPHYS_PAGES" in os.sysconf_names else "SC_PHYS_PAGES"
    free_mb = _available_mb() or page_bytes * os.sysconf(name) / 1e6
    found = f"{free_mb:,.0f} MB available"
    if free_mb < _ENOUGH_MEMORY_MB:
        return Finding("memory", "warning", found, "end other programs")
    return Finding("memory", "ok", found)


def _available_mb() -> float:
    """Return the memory that programs can have, by /proc; 0 without it."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return 0.0
    kilobytes = next((line.split()[1] for line in lines if line.startswith("MemAvailable:")), "0")
    return int(kilobytes) / 1e3


def _buffers() -> Finding:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        granted = probe.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    granted //= 2 if sys.platform == "linux" else 1  # Linux shows twice what it grants
    found = f"{granted // 1000:,} kB receive buffer for each UDP endpoint"
    if granted < BUFFER_BYTES:
        remedy = f"for large swarms: sysctl -w net.core.rmem_max={BUFFER_BYTES}"
        return Finding("UDP buffer", "warning", found, remedy)
    return Finding("UDP buffer", "ok", found)


def _endpoint(endpoint: Endpoint) -> Iterator[Finding]:
    if endpoint.kind == "serial":
        yield _serial(endpoint)
    elif endpoint.listens:
        yield _port(str(endpoint), "udp" if endpoint.kind == "udpin" else "tcp", endpoint.host, endpoint.port)


def _port(name: str, kind: Literal["udp", "tcp"], host: str, port: int) -> Finding:
    """Return whether a listening port can be opened."""
    is_tcp = kind == "tcp"
    try:
        family, *_, address = socket.getaddrinfo(
            host or None,
            port,
            type=socket.SOCK_STREAM if is_tcp else socket.SOCK_DGRAM,
            flags=socket.AI_PASSIVE,
        )[0]
        with socket.socket(family, socket.SOCK_STREAM if is_tcp else socket.SOCK_DGRAM) as probe:
            if is_tcp:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        return Finding(name, "problem", *listening_problem(error, port))
    return Finding(name, "ok", "is free")


def _serial(endpoint: Endpoint) -> Finding:
    device = Path(endpoint.device)
    name = str(endpoint)
    if not device.exists():
        others = sorted(str(one) for pattern in ("ttyUSB*", "ttyACM*") for one in Path("/dev").glob(pattern))
        there = f"there are {', '.join(others)}" if others else "no USB serial port is connected"
        return Finding(name, "problem", "does not exist", f"connect it, or correct its name: {there}")
    if not os.access(device, os.R_OK | os.W_OK):
        group = grp.getgrgid(device.stat().st_gid).gr_name
        remedy = f"sudo usermod -aG {group} $USER, then log in again"
        return Finding(name, "problem", "may not be opened by this user", remedy)
    return Finding(name, "ok", "may be opened")
