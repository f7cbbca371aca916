"""A request would stall the flight, blind the operator, or lock him out."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import resource
import socket
import time
from collections.abc import Callable, Iterator

import pytest
from starlette.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidState
from websockets.sync.client import ClientConnection

from gcs.console.server import FailedRequests
from gcs.console.web import listener, request_checks
from gcs.console.web import token_attempts as attempts_module
from gcs.console.web.console_access import Access
from gcs.console.web.listener import MAX_CONNECTIONS, Listener, client_of
from gcs.console.web.page_connections import Clients
from gcs.console.web.token_attempts import BURST, Attempts, TooManyAttemptsError
from gcs.console.web.web_routes import number_of

OPERATE, VIEW = "operate-0123456789", "view-0123456789abc"


def time_of(call: Callable[[], object]) -> float:
    begun_s = time.thread_time()
    call()
    return time.thread_time() - begun_s


@pytest.mark.parametrize("cookies", ['a="' + "\\" * 60_000 + '"', "a=b; " * 2000, "=" * 8000, ";" * 8000])
def test_long_cookies_are_read_at_once(cookies: str) -> None:
    headers = Headers({"cookie": cookies})
    assert time_of(lambda: request_checks._token(headers)) < 0.2


def test_a_cookie_keeps_any_token() -> None:
    for token in (OPERATE, 'with "quotes"; and = signs', "umlauts äöü", "100%41"):
        name, value = request_checks.cookie(token)
        assert request_checks._token(Headers({"cookie": f"other=1; {name}={value}; more"})) == token


@pytest.mark.parametrize("path", ["/alarms", "/api/status", "/api/charts", "/page.js", "/metrics"])
@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_a_page_of_another_site_can_ask_for_nothing(fly, path: str, site: str) -> None:
    with fly() as flight:
        image = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}
        assert flight.request(path, None, image)[0] == 403
        assert flight.request(path, None, {"Sec-Fetch-Site": "same-origin"})[0] == 200
        link = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
        assert flight.request("/", None, link)[0] == 200
        assert flight.request("/", None, link | {"Sec-Fetch-Dest": "iframe"})[0] == 403
        assert flight.request(path, None, link)[0] == 403


def test_long_addresses_numbers_and_headers_are_refused(fly) -> None:
    with fly() as flight:
        assert flight.request("/alarms?x=" + "a" * 9000)[0] == 414
        assert flight.request("/tiles/1/2/" + "9" * 5000)[0] == 204
        assert flight.request("/api/marks?after=" + "9" * 5000)[0] == 422
        assert flight.request("/api/status", None, {f"x-{n}": "y" for n in range(200)})[0] == 431
        assert flight.request("/api/orders", {"action": "confirm", "plan_id": 10**30})[0] == 422
        assert flight.request("/api/status")[0] == 200
    assert [number_of(text) for text in ("12", "", "²", "٣", "-1", "1" * 21)] == [12, *[None] * 5]


@pytest.mark.parametrize("path", ["/alarms?about=", "/api/status?", "/?", "/api/charts?", "/%s"])
def test_no_text_in_an_address_takes_time(fly, path: str) -> None:
    """Regular expressions over `/alarms?about=` stopped all heartbeats for 2 to 16 s."""
    hostile = ("agent%201:%20", "%20not%20heard%20for%20", "a%20" * 9, "sensor%20radar%20for%205%20s:%20")
    with fly() as flight:
        flight.request("/alarms")
        for part in hostile:
            begun_s = time.process_time()
            flight.request(path + part * (7000 // len(part)))
            assert time.process_time() - begun_s < 1.0, part


def _half_open(port: int, count: int) -> Iterator[socket.socket]:
    for _ in range(count):
        link = socket.create_connection(("127.0.0.1", port), 5.0)
        with contextlib.suppress(OSError):
            link.sendall(b"GET /api/status HTTP/1.1\r\nHost: ")
        yield link


@pytest.mark.real_time
def test_a_thousand_requests_that_never_end_hold_few_descriptors_and_lock_nobody_out(
    fly, monkeypatch
) -> None:
    with fly() as flight:
        links = list(_half_open(flight.console.port, 1000))
        try:
            assert flight.request("/api/status")[0] == 200
            assert len(flight.console._socket.connections) <= MAX_CONNECTIONS + 32
            monkeypatch.setattr(listener, "MAX_IDLE_S", 0.5)
            until_s = time.monotonic() + 10.0
            while flight.console._socket.connections and time.monotonic() < until_s:
                time.sleep(0.1)
            assert not flight.console._socket.connections
        finally:
            for link in links:
                link.close()


def _is_open(page: ClientConnection) -> bool:
    try:
        while True:
            page.recv(timeout=0.2)
    except TimeoutError:
        return True
    except ConnectionClosed:
        return False


def test_idle_pages_do_not_lock_the_operator_out_nor_close_a_page_in_use(fly, monkeypatch) -> None:
    monkeypatch.setattr(listener, "MAX_CONNECTIONS", 32)
    with fly() as flight, contextlib.ExitStack() as pages:
        mine = pages.enter_context(flight.page())
        mine.send("used")
        for _ in range(28):
            idle = pages.enter_context(flight.page())
        assert json.loads(idle.recv(timeout=5.0))["type"] == "role"
        assert json.loads(mine.recv(timeout=5.0)) == {"type": "role", "role": "operate"}
        assert _is_open(mine)
        assert flight.request("/api/orders", {"action": "hold", "vehicles": "all"})[0] == 202
        assert len(flight.console.runs[0].clients) <= flight.console._socket.max_pages < 28


def test_places_are_for_those_who_may_operate() -> None:
    clients = Clients(lambda: b"", 8)
    viewers = [clients.join(f"10.0.0.{number}", may_operate=False) for number in range(8)]
    assert clients.join("10.0.1.1", may_operate=False) is not None
    assert viewers[0] is not None
    assert viewers[0].is_ended  # the oldest, for an equal
    for number in range(8):
        assert clients.join(f"10.0.2.{number}", may_operate=True) is not None
    assert clients.join("10.0.1.1", may_operate=False) is None
    assert clients.join("10.0.3.1", may_operate=True) is not None
    assert len(clients) == 8


@pytest.mark.real_time
def test_what_a_page_sends_is_bounded(fly) -> None:
    def send_without_end(page: ClientConnection) -> None:
        for _ in range(1000):
            page.send("x" * 1000)
            page.recv(timeout=2.0)

    with fly() as flight, flight.page() as page, pytest.raises(ConnectionClosed):
        send_without_end(page)


def test_wrong_tokens_are_slowed_down_but_lock_no_operator_out(monkeypatch) -> None:
    monkeypatch.setattr(attempts_module, "_DELAY_S", 0.0)
    attempts = Attempts(Access(operate_token=OPERATE, view_token=VIEW))

    async def run() -> None:
        assert await attempts.role(OPERATE, "10.0.0.1") == "operate"
        for host in ("10.0.0.1", "10.0.0.2"):
            for _ in range(BURST):
                assert await attempts.role("wrong", host) is None
        with pytest.raises(TooManyAttemptsError):
            await attempts.role(OPERATE, "10.0.0.2")
        assert await attempts.role(VIEW, "10.0.0.1") == "view"
        assert await attempts.role(OPERATE, "10.0.0.3") == "operate"

    asyncio.run(run())
    assert client_of("2001:db8:1:2::5") == client_of("2001:db8:1:2:3:4:5:6")


def test_wrong_bearer_tokens_are_answered_slowly_and_then_not_at_all(fly) -> None:
    with fly(Access(operate_token=OPERATE)) as flight:
        begun_s = time.monotonic()
        assert flight.request("/api/status", None, {"Authorization": "Bearer wrong"})[0] == 401
        assert time.monotonic() - begun_s > 0.9
        links: list[socket.socket] = []
        guess = b"GET /api/status HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer guess\r\n\r\n"
        for _ in range(BURST + 2):
            link = socket.create_connection(("127.0.0.1", flight.console.port))
            link.sendall(guess)  # without waiting for the answer
            links.append(link)
        time.sleep(0.3)
        assert flight.request("/api/status", None, {"Authorization": "Bearer wrong"})[0] == 429
        for link in links:
            link.close()


def test_without_descriptors_a_connection_is_refused_and_nothing_is_logged() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with Listener(socket.AF_INET) as ours, socket.socket() as other:
        ours.bind(("127.0.0.1", 0))
        ours.listen(8)
        ours.setblocking(False)
        other.connect(ours.getsockname())
        free = socket.socket()
        highest = free.fileno()
        free.close()
        resource.setrlimit(resource.RLIMIT_NOFILE, (highest, hard))
        try:
            with pytest.raises(BlockingIOError):
                ours.accept()
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        other.settimeout(2.0)
        with contextlib.suppress(ConnectionResetError):
            assert other.recv(1) == b""
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (400, hard))
        with Listener(socket.AF_INET) as small:
            assert small.limit == 100
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize(
    ("error", "is_told"),
    [
        (InvalidState("connection is closing"), False),
        (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"), False),
        (KeyError("vehicle"), True),
    ],
)
def test_a_page_that_closes_at_the_wrong_moment_is_no_program_error(error: Exception, is_told: bool) -> None:
    failures = FailedRequests()
    record = logging.LogRecord(
        "uvicorn.error", logging.ERROR, "", 0, "failed", (), (type(error), error, None)
    )
    failures.emit(record)
    assert (failures.notice() is not None) is is_told
