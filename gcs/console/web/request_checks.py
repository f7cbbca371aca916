"""Checks of each web request: origin, token, cookie, sizes; and headers of each response.

- A request is short: its address, its headers and their number.
- The Host header must name this server: else another site's name could point here (DNS rebinding).
- The Origin header, which browsers always send with a WebSocket or a POST, must be this server's.
- A page of another site may ask for nothing (Sec-Fetch-Site). A link there may lead to the console's page.
- What changes something is POST with JSON, which a form of another site cannot send.
- Pages run no script and no style but those served here.
- Wrong tokens are counted (`gcs.console.web.token_attempts`).
"""

from __future__ import annotations

from typing import Any, Final
from urllib.parse import quote, unquote

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs.console.view.page_records import Role
from gcs.console.web.console_access import Access
from gcs.console.web.listener import Listener
from gcs.console.web.token_attempts import Attempts, TooManyAttemptsError

OPEN_PATHS: Final = frozenset({"/login", "/base.css", "/login.css", "/login.js"})
"""What is served without a token: the form that asks for it."""
_COOKIE: Final = "swarm_gcs_token"
_VIEW_PATHS: Final = frozenset({"/api/replay", "/b/api/replay"})
"""What a token to view may post as well: nothing flies in a replay."""
_SAFE: Final = frozenset({"GET", "HEAD"})
_LINKED_PATHS: Final = frozenset({"/", "/login"})
"""Pages that a link on another site may lead to."""
_OWN_SITE: Final = frozenset({"none", "same-origin"})
"""Of the address bar or a bookmark, and of the console's own pages."""
_MAX_URL: Final = 8 * 1024
_MAX_HEADERS: Final = 100
_MAX_HEADER_BYTES: Final = 16 * 1024
_MAX_COOKIE: Final = 4 * 1024
_OTHER_SITE: Final = "a page of another site may not use this console"
TOO_MANY: Final = (429, "too many wrong tokens came from this address; try again in some seconds")
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
    listener : Listener
        Knows the connection of each request.
    attempts : Attempts
        Checks tokens.
    """

    def __init__(self, app: ASGIApp, access: Access, listener: Listener, attempts: Attempts) -> None:
        self._app = app
        self._access = access
        self._listener = listener
        self._attempts = attempts
        self._hosts = None if access.needs_token else _loopback_names(access.host, access.port or 0)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        connection = self._listener.connection(scope.get("client"))
        if connection is not None:
            connection.begin(is_page=scope["type"] == "websocket")
        try:
            await self._serve(scope, receive, send)
        finally:
            if connection is not None:
                connection.finish()

    async def _serve(self, scope: Scope, receive: Receive, send: Send) -> None:
        refusal = _excess(scope) or await self._refusal(scope, Headers(scope=scope))
        if refusal is not None:
            await _refuse(scope, receive, send, *refusal)
            return
        await self._app(scope, receive, _with_headers(send))

    async def _refusal(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        host = headers.get("host", "")
        origin = headers.get("origin")
        if self._hosts is not None and host.lower() not in self._hosts:
            return 421, f"this console is not {host[:100]!r}"
        if origin is not None and origin.lower() != f"{self._access.scheme}://{host.lower()}":
            return 403, _OTHER_SITE
        if headers.get("sec-fetch-site", "none") not in _OWN_SITE and not _is_followed_link(scope, headers):
            return 403, _OTHER_SITE
        role: Role | None = None
        if scope["path"] not in OPEN_PATHS:
            token = _token(headers) if self._access.needs_token else ""
            try:
                role = await self._attempts.role(token, host_of(scope)) if token else self._access.role("")
            except TooManyAttemptsError:
                return TOO_MANY
        scope.setdefault("state", {})["role"] = role
        return _forbidden(scope, headers, role)


def host_of(scope: Scope) -> str:
    """Return the host that a request comes from."""
    return scope["client"][0] if scope.get("client") else ""


def cookie(token: str) -> tuple[str, str]:
    """Return name and value of the cookie that keeps a token."""
    return _COOKIE, quote(token, safe="")


def _excess(scope: Scope) -> tuple[int, str] | None:
    """Return why a request is too long, if it is."""
    if len(scope["raw_path"]) + len(scope["query_string"]) > _MAX_URL:
        return 414, f"expected an address of at most {_MAX_URL} bytes"
    headers = scope["headers"]
    if len(headers) > _MAX_HEADERS or sum(len(a) + len(b) for a, b in headers) > _MAX_HEADER_BYTES:
        return 431, f"expected at most {_MAX_HEADERS} headers, and {_MAX_HEADER_BYTES} bytes of them"
    return None


def _is_followed_link(scope: Scope, headers: Headers) -> bool:
    """Return True for a link that a user follows: what it opens, the other site cannot read or press."""
    return (
        scope["path"] in _LINKED_PATHS
        and scope.get("method") == "GET"
        and headers.get("sec-fetch-mode") == "navigate"
        and headers.get("sec-fetch-dest") == "document"
    )


def _forbidden(scope: Scope, headers: Headers, role: Role | None) -> tuple[int, str] | None:
    """Return why a role may not make a request, if so."""
    if role is None and scope["path"] not in OPEN_PATHS:
        return 401, "a token is needed: open /login, or send the header Authorization: Bearer TOKEN"
    if scope["type"] == "websocket" or scope["method"] in _SAFE or scope["path"] == "/login":
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
        return token.strip()
    for part in headers.get("cookie", "")[:_MAX_COOKIE].split(";"):
        name, _, value = part.partition("=")
        if name.strip() == _COOKIE:
            return unquote(value.strip())
    return ""


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
