"""Process of a console: `gcs console` of an operator, and that of `gcs run` and `gcs demo`."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path
from typing import Final

import msgspec
from rich.console import Console

from gcs.cli.console_options import PageOptions, open_listener, show_address
from gcs.cli.following import FIND_S, address_of
from gcs.console.remote.remote_run import find_run
from gcs.console.server import ConsoleServer
from gcs.console.web.console_access import Access, parse_access
from gcs.console.web.listener import Listener
from gcs.console.web.tiles import Tiles
from gcs.errors import ConsoleError
from gcs.io.zenoh.session import ZenohSession
from gcs.model import Notice
from gcs.service.child_process import Report

_NOTICES_S: Final = 1.0


def serve_console(
    zenoh: str | None,
    mission: str | None,
    tls: Path | None,
    options: PageOptions,
    console: Console,
    *,
    is_metrics_only: bool = False,
) -> None:
    """Serve the console of a service until Ctrl-C.

    Parameters
    ----------
    is_metrics_only : bool
        True: serve its metrics only.

    Raises
    ------
    ConsoleError, LinkError
        When no service is found, or the console cannot be served as the options say.
    """
    options.check()
    found = open_listener(options)
    if found is None:
        raise ConsoleError("gcs console serves a console; leave out --console off")
    address = address_of(zenoh, mission, tls)
    with _served(*address, options, found, FIND_S, is_metrics_only=is_metrics_only) as server:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: server.close())
        if is_metrics_only:
            console.print(f"metrics: {server.url}metrics", highlight=False, markup=False, soft_wrap=True)
        else:
            show_address(server.url, options, console)
        while not server.ended.wait(_NOTICES_S):
            if (content := server.notice()) is not None:
                notice = Notice(time.time_ns(), content[0], server.name, content[1])
                console.print(notice.line, style="yellow", highlight=False, markup=False, soft_wrap=True)


def serve_for_parent(
    endpoint: str,
    mission: str,
    tls: Path | None,
    options: PageOptions,
    descriptor: int,
    mission_file: str | None,
) -> None:
    """Serve the console on a socket of the service that has started this process, until its pipe closes."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    access = parse_access(options.address, options.access) or Access()
    found = access, Listener(fileno=descriptor)
    with _served(endpoint, mission, tls, options, found, inf, mission_file) as server:
        _report(Report(ready=True))
        while not server.ended.wait(_NOTICES_S):
            if (content := server.notice()) is not None:
                _report(Report(code=content[0], parameters=content[1]))


@contextmanager
def _served(
    endpoint: str,
    mission: str | None,
    tls: Path | None,
    options: PageOptions,
    found: tuple[Access, Listener],
    within_s: float,
    mission_file: str | None = None,
    *,
    is_metrics_only: bool = False,
) -> Iterator[ConsoleServer]:
    """Serve the console of a service while the context lasts; raise the program error that has ended it."""
    tiles = None if options.map_file is None else Tiles(options.map_file)
    with ZenohSession(connect=endpoint, tls=tls) as bus:
        source = asyncio.run(find_run(bus, mission, within_s, mission_file))
        server = ConsoleServer(source, found[0], tiles, listener=found[1], is_metrics_only=is_metrics_only)
        try:
            yield server
        finally:
            server.close()
    if server.error is not None:
        raise server.error


def _end_with_parent() -> None:
    """Wait until the pipe of the parent closes, as it does when the parent ends; end at once."""
    sys.stdin.buffer.read()
    os._exit(0)


def _report(report: Report) -> None:
    sys.stdout.buffer.write(msgspec.json.encode(report) + b"\n")
    sys.stdout.flush()
