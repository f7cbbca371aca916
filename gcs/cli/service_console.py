"""Console of `gcs run` and `gcs demo`: its process, and the answers of the service to all consoles.

The console is a process of its own: `gcs console`, with a socket that this process has opened. So browsers
reach the next process when one has ended.
"""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from rich.console import Console

from gcs.cli.console_options import PageOptions, opened, show_address
from gcs.model import NS_PER_S, Effect, Event, Tick
from gcs.service.child_process import ChildProcess

if TYPE_CHECKING:
    from gcs.console.view.feed import Feed
    from gcs.console.web.console_access import Access
    from gcs.console.web.listener import Listener
    from gcs.io.zenoh.session import ZenohSession
    from gcs.service.service import Service


@asynccontextmanager
async def service_page(
    service: Service,
    bus: ZenohSession,
    endpoint: str,
    options: PageOptions,
    console: Console,
    speed: float,
    mission_file: str | None = None,
) -> AsyncIterator[str]:
    """Serve the console of a live service in a process of its own while the context lasts.

    Yield its address, empty without one. Consoles that others start get the same news.

    Parameters
    ----------
    endpoint : str
        zenoh endpoint of the service.
    mission_file : str, optional
        Mission file of a service whose vehicles `gcs preflight` can check.

    Raises
    ------
    ConsoleError
        When it cannot be served as the options say.
    """
    answer_consoles(service, bus, speed)
    found = opened(options, console)
    if found is None:
        yield ""
        return
    access, listener = found
    url = access.url(listener.getsockname()[1])
    command = _command(service.config.name, endpoint, access, listener, options, mission_file)
    if bus.node is not None:
        command += ["--zenoh-tls", str(bus.node.folder)]
    child = ChildProcess("console", command, [listener.fileno()])
    service.outputs.append(child)
    supervisor = asyncio.create_task(child.run())
    supervisor.add_done_callback(lambda _: listener.close())
    show_address(url, options, console)
    try:
        yield url
    finally:
        supervisor.cancel()
        await asyncio.gather(supervisor, return_exceptions=True)
        await child.close()


def answer_consoles(service: Service, bus: ZenohSession, speed: float) -> Feed:
    """Answer what consoles ask about a service; return what they get."""
    from gcs.console.engine.captures import capture
    from gcs.console.engine.replay_run import feed_of
    from gcs.console.remote.answers import ConsoleAnswers
    from gcs.console.view.capture import Capture
    from gcs.console.view.page_records import RunInfo, ServiceState

    lag = _TickLag(service)
    service.sinks.append(lag)

    def take(t_ns: int) -> Capture:
        recorder = service.recorder
        stations = service.links.ground_stations(t_ns).values()
        state = ServiceState(
            lag_s=round(lag.newest_ns / NS_PER_S / speed, 3),
            dropped=service.health.dropped,
            is_recording=recorder is not None,
            space=None if recorder is None else recorder.space,
            stations=tuple(one for found in stations for one in found),
        )
        return capture(service.engine, t_ns, state)

    feed = feed_of(service, RunInfo(speed=speed, begun=str(time.time_ns())), take, None)
    ConsoleAnswers(bus, service.engine, feed)
    return feed


class _TickLag:
    """Sink that keeps how long the newest tick waited before it was processed."""

    def __init__(self, service: Service) -> None:
        self.newest_ns = 0
        self._service = service

    def event(self, event: Event) -> None:
        """Keep the wait of a tick."""
        if isinstance(event, Tick):
            self.newest_ns = max(0, self._service.clock.now_ns() - event.t_ns)

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Ignore effects."""


def _command(
    mission: str,
    endpoint: str,
    access: Access,
    listener: Listener,
    options: PageOptions,
    mission_file: str | None,
) -> list[str]:
    """Return the command of the process that serves the console on a socket."""
    command = [sys.executable, "-P", "-m", "gcs", "console", "--zenoh", endpoint, "--mission", mission]
    address = f"{access.host}:{listener.getsockname()[1]}"
    command += ["--console", address, "--listener", str(listener.fileno())]
    for name, value in (
        ("--console-access", options.access),
        ("--console-map", options.map_file),
        ("--mission-file", mission_file),
    ):
        command += [] if value is None else [name, str(value)]
    return command
