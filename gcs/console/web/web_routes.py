"""Routes of the web server: the page, login and its cookie, the feed, orders, data for programs."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Final

import msgspec
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from gcs.console.source import UnknownVehicleError
from gcs.console.view.capture import Capture
from gcs.console.view.page_records import (
    ErrorReply,
    MarksReply,
    OrderReply,
    PlanReply,
    Role,
    RoleMessage,
    VehicleDetail,
)
from gcs.console.view.page_state import World
from gcs.console.view.run_marks import History
from gcs.console.web import alarm_guide
from gcs.console.web.console_access import Access
from gcs.console.web.listener import Listener
from gcs.console.web.openapi import description
from gcs.console.web.order_requests import OrderDesk, RefusedOrderError, is_answered
from gcs.console.web.page_connections import Client, Clients
from gcs.console.web.playback_control import PlaybackDesk
from gcs.console.web.preflight_run import PreflightDesk
from gcs.console.web.prometheus import metrics_text
from gcs.console.web.request_checks import TOO_MANY, Guard, cookie, host_of
from gcs.console.web.static_files import StaticFiles
from gcs.console.web.tiles import Tiles
from gcs.console.web.token_attempts import Attempts, TooManyAttemptsError
from gcs.io.record_json import encode
from gcs.model import OrderAnswer, vehicle_of

_STALLED_S: Final = 30.0
"""A page that accepts no message for this time is disconnected."""
_MAX_BODY_BYTES: Final = 32 * 1024
_BODY_S: Final = 10.0
"""Time in which the content of a request must arrive."""
_MAX_WAIT_S: Final = 60.0
_MAX_NUMBER: Final = 20
"""Digits of a number in an address."""
_ASKED_S: Final = 2.0
"""Time for which a request of a program keeps captures going."""


@dataclass
class Board:
    """What requests share: data, pages and orders."""

    world: World
    clients: Clients
    desk: OrderDesk
    playback: PlaybackDesk
    history: History
    preflight: PreflightDesk
    tiles: Tiles | None
    watch: Callable[[], None]
    """Asks for captures."""
    detail: Callable[[int], Awaitable[VehicleDetail | None]]
    """Returns the detail of a vehicle."""
    _asked_s: float = -_ASKED_S
    _changed: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def is_watched(self) -> bool:
        """True if a page is open, or a program has asked just now."""
        return len(self.clients) > 0 or time.monotonic() - self._asked_s < _ASKED_S

    def ask(self) -> None:
        """Ask for a capture now: a page or a program will read it."""
        self._asked_s = time.monotonic()
        self.watch()

    def join(self, address: str, *, may_operate: bool) -> Client | None:
        """Add a page; return None if there is no place for it."""
        self.watch()
        return self.clients.join(address, may_operate=may_operate)

    def wake(self) -> None:
        """Wake those who wait for news."""
        self._changed.set()
        self._changed = asyncio.Event()

    async def changed(self, within_s: float) -> None:
        """Wait for news."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), within_s)

    async def capture(self) -> Capture | None:
        """Return a capture that is made now; None if the run makes none, or does not answer."""
        before = self.world.capture
        until_s = time.monotonic() + 1.0
        self.ask()
        while self.world.capture is before and time.monotonic() < until_s:
            await self.changed(until_s - time.monotonic())
        return None if self.world.is_lost else self.world.capture


def make_app(
    boards: Sequence[Board], access: Access, listener: Listener, *, is_metrics_only: bool = False
) -> ASGIApp:
    """Return the application behind its guard. With two boards its first page compares them.

    Parameters
    ----------
    is_metrics_only : bool
        True: it has metrics only, no page and no orders.
    """
    attempts = Attempts(access)
    if is_metrics_only:
        return Guard(Starlette(routes=[_metrics_route(boards[0])]), access, listener, attempts)
    static = StaticFiles()
    others = [
        Mount("/b", routes=[Route("/", _Page(board, static).serve), *_data_routes(board)])
        for board in boards[1:]
    ]
    page = "compare.html" if others else "index.html"
    names = (Route(f"/{name}", static.serve) for name in static.files if name != "compare.html")
    kept = Route(f"/{static.version}/{{name}}", static.serve_kept)
    app = Starlette(routes=[*described_routes(boards[0], attempts, static, page), *others, kept, *names])
    return Guard(app, access, listener, attempts)


def described_routes(
    board: Board, attempts: Attempts, static: StaticFiles, page: str = "index.html"
) -> list[BaseRoute]:
    """Return the routes that `gcs.console.web.openapi` describes: all but the files of the page."""
    return [
        Route("/", _Page(board, static, page).serve),
        Route("/login", _Login(attempts, static).serve, methods=["GET", "POST"]),
        Route(alarm_guide.PATH, _guide),
        *_data_routes(board),
    ]


def _data_routes(board: Board) -> list[BaseRoute]:
    """Return the routes to the data of one run."""
    api = _Api(board)
    return [
        WebSocketRoute("/feed", _Feed(board).serve),
        Route("/api/status", api.status),
        Route("/api/plan", api.plan),
        Route("/api/vehicles/{name}", api.vehicle),
        Route("/api/orders", api.place_order, methods=["POST"]),
        Route("/api/orders/{order_id}", api.order),
        Route("/api/preflight", api.preflight, methods=["GET", "POST"]),
        Route("/api/replay", api.replay, methods=["POST"]),
        Route("/api/marks", api.marks),
        Route("/api/charts", api.charts),
        Route("/api/openapi.json", api.openapi),
        Route("/tiles/{zoom}/{column}/{row}", api.tile),
        _metrics_route(board),
    ]


def _metrics_route(board: Board) -> Route:
    return Route("/metrics", _Api(board).metrics)


class _Page:
    """The page; while a browser loads it, its first picture is made."""

    def __init__(self, board: Board, static: StaticFiles, name: str = "index.html") -> None:
        self._board = board
        self._static = static
        self._name = name

    async def serve(self, _request: Request) -> Response:
        self._board.ask()
        return self._static.response(self._name)


async def _guide(_request: Request) -> Response:
    """Serve the page of alarms."""
    return Response(alarm_guide.page(), media_type="text/html")


class _Feed:
    """WebSocket of a page: messages go out; a message that comes in says that somebody uses the page."""

    def __init__(self, board: Board) -> None:
        self._board = board

    async def serve(self, socket: WebSocket) -> None:
        role = socket.state.role
        client = self._board.join(host_of(socket.scope), may_operate=role == "operate")
        if client is None:
            await socket.close(1013, "too many pages are open")
            return
        try:
            with contextlib.suppress(WebSocketDisconnect):
                await self._talk(socket, client, role)
        finally:
            self._board.clients.leave(client)

    async def _talk(self, socket: WebSocket, client: Client, role: Role) -> None:
        await socket.accept()
        await socket.send_bytes(encode(RoleMessage(role)))
        sender = asyncio.create_task(self._send(socket, client))
        try:
            while (await socket.receive())["type"] != "websocket.disconnect":
                self._board.clients.use(client)
        finally:
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)

    async def _send(self, socket: WebSocket, client: Client) -> None:
        code = 1008
        reason = "the page does not read"
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, TimeoutError):
            while (message := await client.next()) is not None:
                await asyncio.wait_for(socket.send_bytes(message), _STALLED_S)
            code = 1013
            reason = "too many pages are open"
        self._board.clients.leave(client)
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await socket.close(code, reason)


class _Api:
    """Data and orders for programs."""

    def __init__(self, board: Board) -> None:
        self._board = board

    async def status(self, _request: Request) -> Response:
        capture = await self._board.capture()
        return _no_run() if capture is None else _json(encode(capture.status))

    async def vehicle(self, request: Request) -> Response:
        name = request.path_params["name"]
        number = number_of(name)
        try:
            vehicle = vehicle_of(name) if number is None else number
        except ValueError:
            return _error("expected a vehicle, such as 3, or 1:3 on network 1", 404)
        try:
            detail = await self._board.detail(vehicle)
        except UnknownVehicleError:
            return _error("the mission has no such vehicle", 404)
        return _no_run() if detail is None else _json(encode(detail))

    async def plan(self, _request: Request) -> Response:
        capture = await self._board.capture()
        return _no_run() if capture is None else _json(encode(PlanReply(capture.routes, capture.proposal)))

    async def tile(self, request: Request) -> Response:
        tiles = self._board.tiles
        at = [number for text in request.path_params.values() if (number := number_of(text)) is not None]
        found = tiles.tile(*at) if tiles is not None and len(at) == 3 else None
        if tiles is None or found is None:
            return Response(status_code=204)
        return Response(found, media_type=tiles.media_type)

    async def preflight(self, request: Request) -> Response:
        desk = self._board.preflight
        return _json(encode(await desk.run() if request.method == "POST" else desk.last()))

    async def replay(self, request: Request) -> Response:
        body = await _body(request)
        if body is None:
            return _too_long()
        problem = self._board.playback.carry_out(body)
        return _error(problem, 422) if problem else JSONResponse({})

    async def marks(self, request: Request) -> Response:
        history = self._board.history
        after = number_of(request.query_params.get("after", "0"))
        if after is None:
            return _error("after: expected a number of marks", 422)
        is_complete = history.is_complete  # before the marks are read
        return _json(encode(MarksReply(is_complete, history.marks(after))))

    async def charts(self, _request: Request) -> Response:
        return _json(self._board.history.charts())

    async def place_order(self, request: Request) -> Response:
        body = await _body(request)
        if body is None:
            return _too_long()
        try:
            wait_s = min(_MAX_WAIT_S, float(request.query_params.get("wait_s", "0")[:_MAX_NUMBER]))
            order_id = self._board.desk.place(body, host_of(request.scope) or "?")
        except RefusedOrderError as error:
            return _error(str(error), 422)
        except ValueError:
            return _error("wait_s: expected a number of seconds", 422)
        until_s = time.monotonic() + wait_s
        while not is_answered(self._answers(order_id)) and time.monotonic() < until_s:
            self._board.ask()
            await self._board.changed(min(_ASKED_S / 2, until_s - time.monotonic()))
        return self._order(order_id, 202)

    async def order(self, request: Request) -> Response:
        self._board.ask()
        return self._order(request.path_params["order_id"], 404)

    def _order(self, order_id: str, unanswered: int) -> Response:
        answers = self._answers(order_id)
        reply = OrderReply(order_id, is_answered(answers), answers)
        return _json(encode(reply), 200 if answers else unanswered)

    def _answers(self, order_id: str) -> list[OrderAnswer]:
        return [one for one in self._board.world.answers if one.order_id == order_id]

    async def openapi(self, _request: Request) -> Response:
        return _json(_description())

    async def metrics(self, _request: Request) -> Response:
        capture = await self._board.capture()
        text = metrics_text(capture, len(self._board.clients))
        return Response(text, media_type="text/plain; version=0.0.4")


class _Login:
    """Form that keeps a token in a cookie, out of reach of scripts and of other sites."""

    def __init__(self, attempts: Attempts, static: StaticFiles) -> None:
        self._attempts = attempts
        self._static = static

    async def serve(self, request: Request) -> Response:
        if request.method == "GET":
            return self._static.response("login.html")
        try:
            given = msgspec.json.decode(await _body(request) or b"", type=_Token)
            role = await self._attempts.role(given.token, host_of(request.scope))
        except msgspec.DecodeError:
            role = None
        except TooManyAttemptsError:
            return _error(TOO_MANY[1], TOO_MANY[0])
        if role is None:
            return _error("this token is not known here", 401)
        response = JSONResponse({})
        is_secure = request.url.scheme == "https"
        response.set_cookie(*cookie(given.token), httponly=True, samesite="strict", secure=is_secure)
        return response


@cache
def _description() -> bytes:
    return msgspec.json.encode(description())


class _Token(msgspec.Struct):
    token: str


def number_of(text: str) -> int | None:
    """Return a number of an address; None for another text, and for a very long one."""
    return int(text) if len(text) <= _MAX_NUMBER and text.isascii() and text.isdecimal() else None


async def _body(request: Request) -> bytes | None:
    """Return the content of a request; None if it is too long, or comes too slowly."""
    body = bytearray()
    with contextlib.suppress(TimeoutError, ClientDisconnect):
        async with asyncio.timeout(_BODY_S):
            async for part in request.stream():
                body += part
                if len(body) > _MAX_BODY_BYTES:
                    return None
        return bytes(body)
    return None


def _too_long() -> Response:
    return _error(f"expected at most {_MAX_BODY_BYTES} bytes, within {_BODY_S:.0f} s", 413)


def _json(content: bytes, code: int = 200) -> Response:
    return Response(content, code, media_type="application/json")


def _no_run() -> Response:
    return _error("the run has not begun, or has ended", 503)


def _error(text: str, code: int) -> Response:
    return _json(encode(ErrorReply(text)), code)
