"""Server of the console: a thread with its own event loop; periods of updates, and when a service is lost.

For a live service it is in a process of its own, for a replay beside it. In both cases it asks the run for
what is new (`Source`), and encodes it once for all pages. A slow browser delays this thread only.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import logging
import threading
import time
from pathlib import Path
from typing import Any, Final

import h11
import msgspec
import uvicorn
from websockets.exceptions import InvalidState

from gcs.console.source import Source
from gcs.console.view.news import NewsRequest
from gcs.console.view.page_records import MissionInfo, ReplayState, VehicleDetail
from gcs.console.view.page_state import World
from gcs.console.view.run_marks import History
from gcs.console.web.console_access import Access, tls_context
from gcs.console.web.listener import LISTEN_BACKLOG, Listener, bind
from gcs.console.web.order_requests import OrderDesk
from gcs.console.web.page_connections import Clients
from gcs.console.web.playback_control import PlaybackDesk
from gcs.console.web.preflight_run import PreflightDesk
from gcs.console.web.tiles import Tiles
from gcs.console.web.web_routes import Board, make_app
from gcs.model import NoticeCode, NoticeContent

_PUBLISH_S: Final = 0.1
"""Between updates of the pages."""
_IDLE_S: Final = 0.9
"""Added without a page: enough for trails and the log."""
_ORDER_S: Final = 0.02
"""Between updates after an order, for `_ANSWER_S`: its answers come soon."""
_ANSWER_S: Final = 1.0
LOST_S: Final = 2.5
"""Time without an answer after which the pages say that the service is gone."""
_SEEK_POLL_S: Final = 0.02
_MAX_SEEK_S: Final = 2.0
"""A replay that takes longer than this to reach a time shows what it passes."""
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


class ConsoleServer:
    """Serves the console of one run, or of two that are compared, from construction until `close`.

    Parameters
    ----------
    listener : Listener, optional
        Socket that listens already; by default one is opened.
    is_metrics_only : bool
        True: it serves metrics only.

    Raises
    ------
    ConsoleError
        When the port is taken, or TLS files cannot be read.
    """

    def __init__(
        self,
        source: Source,
        access: Access,
        tiles: Tiles | None = None,
        other: Source | None = None,
        listener: Listener | None = None,
        *,
        is_metrics_only: bool = False,
    ) -> None:
        self.name = "console"
        """Name in notices."""
        self.error: Exception | None = None
        """Program error that has ended it."""
        self.ended = threading.Event()
        """Set at its end."""
        self._failures = FailedRequests()
        self._socket = bind(access) if listener is None else listener
        self._socket.abort = self._abort
        self.port: int = self._socket.getsockname()[1]
        self._access = dataclasses.replace(access, port=self.port)
        sources = [one for one in (source, other) if one is not None]
        self.runs = [
            ShownRun(one, tiles, self._socket.max_pages, is_compared=other is not None) for one in sources
        ]
        for run, peer in zip(self.runs, reversed(self.runs), strict=True):
            run.playback.peer = None if peer is run else peer.playback
        config = uvicorn.Config(
            make_app(
                [run.board for run in self.runs],
                self._access,
                self._socket,
                is_metrics_only=is_metrics_only,
            ),
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
        return self._access.url(self.port)

    def close(self) -> None:
        """End the server; wait for it, but not for a browser that does not read."""
        self._server.should_exit = True
        for run in self.runs:
            run.ends.set()
        self._thread.join(_END_S)
        self._socket.close()

    def notice(self) -> NoticeContent | None:
        """Return, once a minute at most, that a request has failed by a program error."""
        return self._failures.notice()

    def _abort(self, peer: tuple[Any, ...]) -> None:
        for connection in list(self._server.server_state.connections):
            if getattr(connection, "client", None) == peer:
                connection.transport.abort()

    def _serve(self) -> None:
        try:
            asyncio.run(self._serve_and_publish())
        except Exception as error:  # The flight continues.
            self.error = error
        self.ended.set()

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

    Else a hostile client could fill the terminal with messages about its own errors.
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
    """What the console shows of one run."""

    def __init__(self, source: Source, tiles: Tiles | None, max_pages: int, *, is_compared: bool) -> None:
        self._source = source
        self._tiles = tiles
        self._is_compared = is_compared
        self._recording = source.recording
        self.ends = threading.Event()
        mission = self._shown(source.mission)
        self.history = History(is_recorded=source.recording is not None and not source.has_other_settings)
        self.world = World(mission, self.history)
        self.clients = Clients(self.world.snapshot, max_pages)
        desk = OrderDesk(self.world, None if source.submit is None else self._submit)
        self.playback = PlaybackDesk(source.playback, source.call)
        preflight = PreflightDesk(source.mission_file)
        parts = (self.world, self.clients, desk, self.playback, self.history, preflight, tiles)
        self.board = Board(*parts, self._watch, self._detail)
        self._request = NewsRequest()
        """What is known of the run."""
        self._is_urgent = False
        """True if the state is wanted as it is now."""
        self._heard_s = time.monotonic()
        self._heard_ms = time.time_ns() // 1_000_000
        """When the run has last answered."""
        self._asked = asyncio.Event()
        self._ordered = asyncio.Event()
        self._ordered_s = -_ANSWER_S
        self._shows_passed = False
        """True while a replay takes long to reach a time: it shows what it passes."""

    async def publish(self) -> None:
        """Send what is new to all pages, ten times a second."""
        while True:
            await self._pause()
            await self._reach_time()
            while await self._update():
                pass
            if self._recording is not None and self.world.capture is not None:
                self._read_history(self._recording)  # after the first picture, which it would delay
                self._recording = None

    async def _pause(self) -> None:
        await asyncio.sleep(_ORDER_S)
        if time.monotonic() - self._ordered_s > _ANSWER_S:
            await _wait(self._ordered, _PUBLISH_S - _ORDER_S)
        if not self.board.is_watched:
            await _wait(self._asked, _IDLE_S)
        self._asked.clear()
        self._ordered.clear()

    async def _update(self) -> bool:
        """Ask the run for what is new, and send it to the pages; return True if there is more."""
        is_watched = self.board.is_watched
        is_urgent = self._is_urgent
        self._is_urgent = False
        request = msgspec.structs.replace(self._request, is_watched=is_watched, is_urgent=is_urgent)
        news = await self._source.pull(request)
        if news is None:
            self._is_urgent = is_urgent
            if time.monotonic() - self._heard_s > LOST_S and not self.world.is_lost:
                self._send(self.world.lose(self._heard_ms))
            return False
        self._heard_s = time.monotonic()
        self._heard_ms = time.time_ns() // 1_000_000
        if self.playback.is_moved and not self._shows_passed:  # a page has just asked for another time
            news = dataclasses.replace(news, capture=None)
        self._request = self._request.after(news)
        if news.mission is not None:
            news = dataclasses.replace(news, mission=self._shown(news.mission))
        self._send(self.world.update(news, self._replay_state()))
        return news.has_more

    def _send(self, message: bytes | None) -> None:
        if message is not None:
            self.clients.send(message)
        self.board.wake()

    def _shown(self, mission: MissionInfo) -> MissionInfo:
        """Return the mission, with what this console adds."""
        has_checks = self._source.mission_file is not None
        tiles = None if self._tiles is None else self._tiles.info
        return msgspec.structs.replace(mission, preflight=has_checks, tiles=tiles)

    def _replay_state(self) -> ReplayState | None:
        state = self.playback.state()
        if state is None or not self._is_compared:
            return state
        return msgspec.structs.replace(state, figures=self.history.figures(state.at_s))

    async def _reach_time(self) -> None:
        """Wait until a replay has reached the time that was asked for."""
        self._shows_passed = False
        if not self.playback.is_moved:
            return
        until_s = time.monotonic() + _MAX_SEEK_S
        while self.playback.is_seeking and time.monotonic() < until_s:
            await asyncio.sleep(_SEEK_POLL_S)
        self.playback.is_moved = self._shows_passed = self.playback.is_seeking
        self._is_urgent = True

    def _read_history(self, recording: Path) -> None:
        vehicles = sorted(self.world.mission.loiter_radii_m)
        arguments = (recording, vehicles, self.world.start_t_ns, self.ends)
        threading.Thread(target=self.history.read, args=arguments, name="history", daemon=True).start()

    def _submit(self, order: bytes) -> None:
        assert self._source.submit is not None
        self._source.submit(order)
        self._ordered_s = time.monotonic()
        self._ordered.set()
        self._asked.set()

    def _watch(self) -> None:
        """Ask for the state as it is now; once for all pages that open before the next update."""
        self._is_urgent = True
        self._asked.set()

    async def _detail(self, vehicle: int) -> VehicleDetail | None:
        """Return the details of a vehicle now; None without a run."""
        return await self._source.detail(vehicle, self.world.verified.get(vehicle, (0, 0)))


async def _wait(event: asyncio.Event, within_s: float) -> None:
    """Wait for an event, no longer than a time."""
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(event.wait(), within_s)
