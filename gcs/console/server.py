"""The console's thread: its own event loop with an HTTP server.

The service hands it references (`gcs.console.view.feed`). Encoding, sockets and browsers are here, so a slow
browser delays this thread only.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

import h11
import msgspec
import uvicorn
from websockets.exceptions import InvalidState

from gcs.config import Config
from gcs.console.view.capture import Capture
from gcs.console.view.details import vehicle_detail
from gcs.console.view.feed import Feed
from gcs.console.view.history import History
from gcs.console.view.schema import ReplayState, RunInfo, VehicleDetail
from gcs.console.view.world import World
from gcs.console.web.access import DEFAULT_PORT, Access, tls_context
from gcs.console.web.app import Board, make_app
from gcs.console.web.clients import Clients
from gcs.console.web.listener import LISTEN_BACKLOG, Listener
from gcs.console.web.orders import OrderDesk
from gcs.console.web.playback import Playback, PlaybackDesk
from gcs.console.web.preflight import PreflightDesk
from gcs.console.web.tiles import Tiles
from gcs.core.engine import Engine
from gcs.errors import ConsoleError
from gcs.model import NoticeCode, NoticeContent

T = TypeVar("T")

_PUBLISH_S: Final = 0.1
_SEEK_POLL_S: Final = 0.02
_MAX_SEEK_S: Final = 2.0
"""A replay that takes longer than this to reach a time shows what it passes."""
_DETAIL_S: Final = 1.0
"""Time in which the loop of the run gives the details of a vehicle."""
_PORTS: Final = 50
"""Ports that are tried from the default one on."""
_END_S: Final = 3.0
_CHECK_S: Final = 1.0
"""Between looks for connections that keep the server waiting."""
_MAX_MESSAGE_BYTES: Final = 1024
"""Of a page; it sends single words."""
_MAX_HEADER_BYTES: Final = 16 * 1024
_MIN_NEWS_INTERVAL_S: Final = 60.0
_MAX_NEWS: Final = 200
_CLIENT_ERRORS: Final = (h11.LocalProtocolError, UnicodeDecodeError, InvalidState)
"""The client broke the protocol, HTTP before its answer or a WebSocket's text, or was just closing."""


class DisplayedRun(Protocol):
    """A live service or a replay, as far as the console needs it."""

    config: Config
    engine: Engine
    sinks: list[Any]


@dataclass(frozen=True, slots=True)
class Source:
    """The run that a console shows, and how to act on it."""

    run: DisplayedRun
    """The service or the replay; it gets a sink."""
    take: Callable[[int], Capture]
    """Returns a capture of the run at a time."""
    submit: Callable[[bytes], None] | None = None
    """Passes the JSON of an order to the service; None in a replay."""
    speed: float = 1.0
    """Of the run's clock, as a multiple of real time."""
    playback: Playback | None = None
    """Position and speed of a replay; None for a live service."""
    on_restart: list[Callable[[], None]] | None = None
    """Where to put what is called when a replay begins again at another time."""
    recording: Path | None = None
    """Recording that is replayed; None: a log, or a live service."""
    has_other_settings: bool = False
    """True if the recording is replayed with other settings: only the truth in it is that of the replay."""
    title: str = ""
    """File that is replayed."""
    start_t_ns: int | None = None
    """Start of the run; None: its first event."""
    mission_file: str | None = None
    """Mission file of a service whose vehicles `gcs preflight` can check; else None."""


class ConsoleServer:
    """Serves the console of one run, or of two that are compared, from construction until `close`.

    Raises
    ------
    ConsoleError
        When the port is taken, or TLS files cannot be read.
    """

    def __init__(
        self, source: Source, access: Access, tiles: Tiles | None = None, other: Source | None = None
    ) -> None:
        self.name = "console"
        """Name in notices."""
        self._error: Exception | None = None
        self._failures = FailedRequests()
        self._socket = bind(access)
        self._socket.abort = self._abort
        self.port: int = self._socket.getsockname()[1]
        self._access = replace(access, port=self.port)
        sources = [one for one in (source, other) if one is not None]
        self.runs = [
            ShownRun(one, tiles, self._socket.max_pages, is_compared=other is not None) for one in sources
        ]
        for run, peer in zip(self.runs, reversed(self.runs), strict=True):
            run.playback.peer = None if peer is run else peer.playback
        config = uvicorn.Config(
            make_app([run.board for run in self.runs], self._access, self._socket),
            loop="asyncio",
            http="h11",
            ws="websockets-sansio",
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            proxy_headers=False,  # else a program could claim another address
            backlog=LISTEN_BACKLOG,
            h11_max_incomplete_event_size=_MAX_HEADER_BYTES,
            ws_max_size=_MAX_MESSAGE_BYTES,
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=1,
        )
        config.load()
        self._failures.watch()
        if access.folder is not None:
            config.ssl = tls_context(access.folder)
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._serve, name="console", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address for a browser."""
        host = self._access.host
        if host in ("0.0.0.0", "::"):  # noqa: S104  not an address that a browser opens
            host = socket.gethostname()
        host = f"[{host}]" if ":" in host else host
        return f"{self._access.scheme}://{host}:{self.port}/"

    def close(self) -> None:
        """End the server; wait for it, but not for a browser that does not read."""
        self._server.should_exit = True
        for run in self.runs:
            run.ends.set()
        self._thread.join(_END_S)
        self._socket.close()

    def notice(self) -> NoticeContent | None:
        """Return, once, the alarm that the console has failed."""
        error = self._error
        self._error = None
        if error is None:
            return self._failures.notice()
        return NoticeCode.CONSOLE_ENDED, {"error": f"{type(error).__name__}: {error}"}

    def _abort(self, peer: tuple[Any, ...]) -> None:
        for connection in list(self._server.server_state.connections):
            if getattr(connection, "client", None) == peer:
                connection.transport.abort()

    def _serve(self) -> None:
        try:
            asyncio.run(self._serve_and_publish())
        except Exception as error:  # The flight continues; the operator gets an alarm.
            self._error = error

    async def _serve_and_publish(self) -> None:
        server = asyncio.create_task(self._server.serve(sockets=[self._socket]))
        others = [asyncio.create_task(run.publish()) for run in self.runs]
        others.append(asyncio.create_task(self._end_late_connections()))
        await asyncio.wait({server, *others}, return_when=asyncio.FIRST_COMPLETED)
        for task in others:
            task.cancel()
        self._server.should_exit = True
        for ended in await asyncio.gather(server, *others, return_exceptions=True):
            if isinstance(ended, Exception):
                raise ended

    async def _end_late_connections(self) -> None:
        while True:
            await asyncio.sleep(_CHECK_S)
            self._socket.end_late(time.monotonic())


class FailedRequests(logging.Handler):
    """Takes the log of the server: a request that failed by a program error becomes a notice.

    Else a hostile client could fill the terminal with complaints about its own mistakes.
    """

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self._text = ""
        self._told_s = -_MIN_NEWS_INTERVAL_S

    def watch(self) -> None:
        """Take the log from now on."""
        for name in ("uvicorn.error", "asyncio"):
            logger = logging.getLogger(name)
            logger.handlers = [self]
            logger.propagate = False

    def emit(self, record: logging.LogRecord) -> None:
        """Keep what failed."""
        error = record.exc_info[1] if record.exc_info else None
        if isinstance(error, _CLIENT_ERRORS):
            return
        self._text = record.getMessage().strip() if error is None else f"{type(error).__name__}: {error}"

    def notice(self) -> NoticeContent | None:
        """Return what failed; once a minute at most."""
        now_s = time.monotonic()
        if not self._text or now_s - self._told_s < _MIN_NEWS_INTERVAL_S:
            return None
        text = self._text
        self._text = ""
        self._told_s = now_s
        return NoticeCode.CONSOLE_FAILED, {"error": text[:_MAX_NEWS]}


class ShownRun:
    """What the console shows of one run.

    It is made on the loop of the run: there it takes captures and passes on orders.
    """

    def __init__(self, source: Source, tiles: Tiles | None, max_pages: int, *, is_compared: bool) -> None:
        run = source.run
        submit = source.submit
        # A replay that begins again has another fleet.
        self.feed = Feed(source.take, lambda: run.engine.stages.fleet.states(), source.start_t_ns)
        if source.on_restart is not None:
            source.on_restart.append(self.feed.restart)
        self._run_loop = asyncio.get_running_loop()
        self._run = run
        info = RunInfo(
            kind="live" if source.playback is None else "replay",
            speed=source.speed,
            begun=str(time.time_ns()),
            preflight=source.mission_file is not None,
            tiles=None if tiles is None else tiles.info,
            title=source.title,
        )
        self._is_compared = is_compared
        self._recording = source.recording
        self._vehicles = sorted(agent.vehicle for agent in run.config.agents)
        is_recorded = source.recording is not None and not source.has_other_settings
        self.history = History(is_recorded=is_recorded)
        self.ends = threading.Event()
        world = World(run.config, info, self.history)
        self.clients = Clients(world.snapshot, max_pages)
        desk = OrderDesk(run.config.local_frame, None if submit is None else self._on_run_loop(submit))
        self.playback = PlaybackDesk(source.playback, self._on_run_loop(lambda action: action()))
        preflight = PreflightDesk(source.mission_file)
        parts = (world, self.clients, desk, self.playback, self.history, preflight, tiles)
        self.board = Board(*parts, self._watch, self._detail)
        self._is_asked = False
        """True if the service was asked for a capture since the last update."""
        run.sinks.append(self.feed)

    async def publish(self) -> None:
        """Send what is new to all pages, ten times a second."""
        while True:
            await asyncio.sleep(_PUBLISH_S)
            self._is_asked = False
            await self._reach_time()
            self.feed.is_watched = self.board.is_watched
            if self.feed.is_watched and self.feed.is_stale:
                self._watch()
            message = self.board.world.update(self.feed, self._replay_state())
            if message is not None:
                self.clients.send(message)
                self.board.wake()
            if self._recording is not None and self.board.world.capture is not None:
                self._read_history(self._recording)  # after the first picture, which it would delay
                self._recording = None

    def _replay_state(self) -> ReplayState | None:
        state = self.playback.state()
        if state is None or not self._is_compared:
            return state
        return msgspec.structs.replace(state, figures=self.history.figures(state.at_s))

    async def _reach_time(self) -> None:
        """Wait until a replay has reached the time that was asked for, and for a capture there."""
        if not self.playback.is_moved:
            return
        until_s = time.monotonic() + _MAX_SEEK_S
        while self.playback.is_seeking and time.monotonic() < until_s:
            await asyncio.sleep(_SEEK_POLL_S)
        self.playback.is_moved = self.playback.is_seeking
        if self.board.is_watched:
            before = self.feed.capture
            self._is_asked = False
            self._watch()
            while self.feed.capture is before and time.monotonic() < until_s:
                await asyncio.sleep(_SEEK_POLL_S)

    def _read_history(self, recording: Path) -> None:
        start_t_ns = self.feed.start_t_ns or 0
        arguments = (recording, self._vehicles, start_t_ns, self.ends)
        threading.Thread(target=self.history.read, args=arguments, name="history", daemon=True).start()

    def _watch(self) -> None:
        """Ask the service for a capture now; once for all pages that open before the next update."""
        if self._is_asked:
            return
        self._is_asked = True
        with contextlib.suppress(RuntimeError):  # the run has ended
            self._run_loop.call_soon_threadsafe(self.feed.refresh)

    async def _detail(self, vehicle: int) -> VehicleDetail | None:
        """Return the details of a vehicle now, collected on the loop of the run; None without a run."""
        verified = self.board.world.verified.get(vehicle, (0, 0))

        async def collect() -> VehicleDetail:
            return vehicle_detail(self._run.engine, vehicle, self.feed.t_ns, verified)

        if not self.feed.t_ns or self._run_loop.is_closed():
            return None
        with contextlib.suppress(TimeoutError):
            found = asyncio.run_coroutine_threadsafe(collect(), self._run_loop)
            return await asyncio.wait_for(asyncio.wrap_future(found), _DETAIL_S)
        return None

    def _on_run_loop(self, function: Callable[[T], None]) -> Callable[[T], None]:
        def call(argument: T) -> None:
            self._run_loop.call_soon_threadsafe(function, argument)

        return call


def bind(access: Access) -> Listener:
    """Return a listening socket; on the default address at the next free port.

    Raises
    ------
    ConsoleError
        When no port is free, or the address is not of this machine.
    """
    ports = range(DEFAULT_PORT, DEFAULT_PORT + _PORTS) if access.port is None else (access.port,)
    family = socket.AF_INET6 if ":" in access.host else socket.AF_INET
    problem = ""
    for port in ports:
        listener = Listener(family)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((access.host, port))
            listener.listen(LISTEN_BACKLOG)
        except OSError as error:
            listener.close()
            problem = error.strerror or str(error)
            continue
        listener.setblocking(False)
        return listener
    raise ConsoleError(
        f"console: {access.host} port {ports[0]} cannot be opened ({problem}); choose another with --console "
        "HOST:PORT, or --console off"
    )
