"""Checks of each request, and headers of each response.

- The Host header must name this server: else another site's name could point here (DNS rebinding).
- The Origin header, which browsers always send with a WebSocket or a POST, must be this server's.
- What changes something is POST with JSON, which a form of another site cannot send.
- Pages run no script and no style but those served here.
"""

from __future__ import annotations

from http.cookies import CookieError, SimpleCookie
from typing import Any, Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs.console.web.access import Access, Role

COOKIE: Final = "swarm_gcs_token"
OPEN_PATHS: Final = frozenset({"/login", "/console.css", "/login.js"})
"""What is served without a token: the form that asks for it."""
_VIEW_PATHS: Final = frozenset({"/api/replay", "/b/api/replay"})
"""What a token to view may post as well: nothing flies in a replay."""
_SAFE: Final = frozenset({"GET", "HEAD"})
_HEADERS: Final = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-cache",
}


class Guard:
    """Refuses requests that are not from this console's pages or from programs of its users.

    Parameters
    ----------
    app : ASGIApp
        What is served.
    access : Access
        Tokens.
    port : int
        Port of the server.
    """

    def __init__(self, app: ASGIApp, access: Access, port: int) -> None:
        self._app, self._access = app, access
        self._port = port
        self._hosts = None if access.needs_token else _loopback_names(access.host, port)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        role = self._access.role(_token(headers))
        refusal = self._refusal(scope, headers, role)
        if refusal is not None:
            await _refuse(scope, receive, send, *refusal)
            return
        scope.setdefault("state", {})["role"] = role
        await self._app(scope, receive, _with_headers(send))

    def _refusal(self, scope: Scope, headers: Headers, role: Role | None) -> tuple[int, str] | None:
        host, origin = headers.get("host", ""), headers.get("origin")
        if self._hosts is not None and host.lower() not in self._hosts:
            return 421, f"this console is not {host!r}"
        if origin is not None and origin.lower() != f"{self._access.scheme}://{host.lower()}":
            return 403, "a page of another site may not use this console"
        if role is None and scope["path"] not in OPEN_PATHS:
            return 401, "a token is needed: open /login, or send the header Authorization: Bearer TOKEN"
        if scope["type"] == "websocket" or scope["method"] in _SAFE:
            return None
        if scope["path"] == "/login":
            return None
        if role != "operate" and scope["path"] not in _VIEW_PATHS:
            return 403, "this token may view only"
        if headers.get("content-type", "").partition(";")[0].strip() != "application/json":
            return 415, "expected content-type application/json"
        return None


def _loopback_names(host: str, port: int) -> frozenset[str]:
    names = {"127.0.0.1", "localhost", "[::1]", f"[{host}]" if ":" in host else host}
    return frozenset(f"{name}:{port}" for name in names)


def _token(headers: Headers) -> str:
    scheme, _, token = headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        return str(token.strip())
    try:
        morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return "" if morsel is None else str(morsel.value)


async def _refuse(scope: Scope, receive: Receive, send: Send, code: int, text: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": text})
        return
    if code == 401 and scope["path"] == "/":
        response = JSONResponse({"error": text}, 303, headers={"location": "/login"})
    else:
        response = JSONResponse({"error": text}, code)
    await response(scope, receive, _with_headers(send))


def _with_headers(send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers: Any = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return send_with_headers
