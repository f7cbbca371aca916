"""Console of `gcs demo`, `gcs run` and `gcs replay`: options, start and end.

That of a live service is a process of its own: `gcs console`, with the socket that is opened here. So
mistakes in the options end the command at once, and browsers reach the next process when one has ended.
"""

from __future__ import annotations

import asyncio
import sys
import threading
import time
import webbrowser
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rich.console import Console

from gcs.errors import ConsoleError
from gcs.model import NS_PER_S, Effect, Event, Tick
from gcs.service.child_process import ChildProcess

if TYPE_CHECKING:
    from gcs.cli.analyse.run_file import RunFile
    from gcs.console.server import ConsoleServer
    from gcs.console.source import Source
    from gcs.console.view.feed import Feed
    from gcs.console.web.console_access import Access
    from gcs.console.web.listener import Listener
    from gcs.io.zenoh.session import ZenohSession
    from gcs.service.replay import Replay
    from gcs.service.service import Service


@dataclass(frozen=True, slots=True)
class PageOptions:
    """The options of the console."""

    address: str | None = None
    """HOST:PORT or "off"; None: the default address."""
    access: Path | None = None
    """Folder with certificate, key and tokens."""
    opens_browser: bool = False
    map_file: Path | None = None
    """MBTiles file under the map."""
    compares: bool = False
    """True if it compares two recordings, which nothing else shows."""

    @property
    def is_asked_for(self) -> bool:
        """True if an option asks for the console."""
        is_moved = self.access is not None or self.address not in (None, "off")
        return self.compares or self.opens_browser or self.map_file is not None or is_moved

    def check(self) -> None:
        """Check the options before a run begins.

        Raises
        ------
        ConsoleError
            For a text that is no address, an address that needs another access, a map that cannot be read.
        """
        if self.compares and self.address == "off":
            raise ConsoleError("--compare shows two recordings in the console; leave out --console off")
        if self.address not in (None, "off") or self.access is not None:
            from gcs.console.web.console_access import parse_access

            parse_access(self.address, self.access)
        if self.map_file is not None:
            from gcs.console.web.tiles import Tiles

            Tiles(self.map_file)


DEFAULT_PAGE: Final = PageOptions()


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
    found = _opened(options, console)
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
    command = [sys.executable, "-P", "-m", "gcs", "console", "--connect", endpoint, "--mission", mission]
    address = f"{access.host}:{listener.getsockname()[1]}"
    command += ["--console", address, "--listener", str(listener.fileno())]
    for name, value in (
        ("--console-access", options.access),
        ("--console-map", options.map_file),
        ("--mission-file", mission_file),
    ):
        command += [] if value is None else [name, str(value)]
    return command


@contextmanager
def replay_page(replay: Replay, options: PageOptions, console: Console, file: RunFile) -> Iterator[str]:
    """Serve the console of a replay while the context lasts; yield its address, empty without one.

    Raises
    ------
    ConsoleError
        When it cannot be served as the options say.
    """
    with _page(lambda: replay_source(replay, file), options, console) as server:
        yield _address(server)


def _address(server: ConsoleServer | None) -> str:
    return "" if server is None else server.url


@contextmanager
def comparison_page(
    runs: Sequence[tuple[Replay, RunFile]], options: PageOptions, console: Console
) -> Iterator[None]:
    """Serve the console of two replays while the context lasts.

    Raises
    ------
    ConsoleError
        When it cannot be served as the options say.
    """
    first, other = (partial(replay_source, *run) for run in runs)
    with _page(first, options, console, other):
        yield


def replay_source(replay: Replay, file: RunFile) -> Source:
    """Return what the console needs of the replay of a file."""
    from gcs.console.engine.captures import capture
    from gcs.console.engine.replay_run import local_source

    return local_source(
        replay,
        lambda t_ns: capture(replay.engine, t_ns),
        playback=replay.playback,
        on_restart=replay.on_restart,
        recording=file.path if file.is_recording() else None,
        has_other_settings=file.has_other_settings,
        title=file.title,
        start_t_ns=replay.start_t_ns,
    )


@contextmanager
def _page(
    source: Callable[[], Source],
    options: PageOptions,
    console: Console,
    other: Callable[[], Source] | None = None,
) -> Iterator[ConsoleServer | None]:
    found = _opened(options, console)
    if found is None:
        yield None
        return
    from gcs.console.server import ConsoleServer
    from gcs.console.web.tiles import Tiles

    tiles = None if options.map_file is None else Tiles(options.map_file)
    server = ConsoleServer(source(), found[0], tiles, other and other(), found[1])
    show_address(server.url, options, console)
    try:
        yield server
    finally:
        server.close()


def _opened(options: PageOptions, console: Console) -> tuple[Access, Listener] | None:
    """Return who may open the console, and its socket; None without a console.

    A failure is an error only if an option asks for the console.
    """
    try:
        return open_listener(options)
    except ConsoleError as error:
        if options.is_asked_for:
            raise
        console.print(f"no console: {error}", style="yellow", highlight=False, markup=False, soft_wrap=True)
        return None


def open_listener(options: PageOptions) -> tuple[Access, Listener] | None:
    """Return who may open the console, and its socket; None for ``--console off``.

    Raises
    ------
    ConsoleError
        When it cannot be served as the options say.
    """
    from gcs.console.web.console_access import parse_access, tls_context
    from gcs.console.web.listener import bind

    access = parse_access(options.address, options.access)
    if access is None:
        return None
    if access.folder is not None:
        tls_context(access.folder)
    return access, bind(access)


def show_address(url: str, options: PageOptions, console: Console) -> None:
    """Print the address; open the browser, if that is wanted."""
    console.print(f"console: {url}", highlight=False, markup=False, soft_wrap=True)
    if options.opens_browser:  # A browser in a terminal would block.
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
