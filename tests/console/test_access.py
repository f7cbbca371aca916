"""Somebody else's page or program would see the swarm or command it."""

import json
import socket

import pytest
from websockets.exceptions import InvalidStatus

from gcs.console.web.console_access import DEFAULT_PORT, Access, parse_access
from gcs.console.web.listener import bind
from gcs.errors import ConsoleError
from gcs.model import Order

HOLD = {"action": "hold", "vehicles": "all"}
OPERATE, VIEW = "operate-0123456789", "view-0123456789abc"


def test_another_sites_page_can_neither_watch_nor_command(fly):
    with fly() as flight:
        origin = {"Origin": "https://evil.example"}
        assert flight.request("/api/orders", HOLD, origin)[0] == 403
        assert flight.request("/api/status", None, {"Host": "evil.example"})[0] == 421
        with pytest.raises(InvalidStatus):
            flight.page(origin="https://evil.example")
        assert flight.request("/api/orders", HOLD, {"content-type": "text/plain"})[0] == 415
        assert flight.request("/api/orders", None)[0] == 405
        assert not any(isinstance(event, Order) for event in flight.events.events)
        assert flight.request("/api/orders", HOLD, {"Origin": flight.url})[0] in (200, 202)


def test_a_page_runs_scripts_and_styles_of_the_console_only(fly):
    with fly() as flight:
        code, body, headers = flight.request("/")
        policy = headers["content-security-policy"]
        assert code == 200
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert b"style=" not in body
        assert body.count(b"<script") == body.count(b'<script type="module" src=')
        assert flight.request("/../console/web/web_routes.py")[0] == 404
        assert flight.request("/%2e%2e/web_routes.py")[0] == 404


def test_a_token_is_needed_where_there_is_one_and_a_view_token_does_not_command(fly):
    with fly(Access(operate_token=OPERATE, view_token=VIEW)) as flight:
        bearer = {role: {"Authorization": f"Bearer {role}"} for role in (OPERATE, VIEW, "wrong")}
        assert flight.request("/api/status")[0] == 401
        assert flight.request("/api/status", None, bearer["wrong"])[0] == 401
        assert flight.request("/api/status", None, bearer[VIEW])[0] == 200
        assert flight.request("/api/orders", HOLD, bearer[VIEW])[0] == 403
        assert flight.request("/api/orders", HOLD, bearer[OPERATE])[0] in (200, 202)
        with pytest.raises(InvalidStatus):
            flight.page()
        with flight.page(additional_headers=bearer[VIEW]) as page:
            assert json.loads(page.recv(timeout=2.0)) == {"type": "role", "role": "view"}
        assert flight.request("/login", {"token": "wrong"})[0] == 401
        code, _, headers = flight.request("/login", {"token": VIEW})
        assert code == 200
        assert "HttpOnly" in headers["set-cookie"]
        assert "SameSite=strict" in headers["set-cookie"]


def test_mistakes_in_an_order_are_named_and_nothing_is_sent(fly):
    with fly() as flight:
        for wrong in ({"action": "hold"}, {"action": "jump"}, {"action": "hold", "vehicles": [0]}, [1], "x"):
            code, body, _ = flight.request("/api/orders", wrong)
            assert code == 422
            assert json.loads(body)["error"]
        assert (
            flight.request("/api/orders", {"action": "hold", "vehicles": "all", "origin": "x" * 40_000})[0]
            == 413
        )
        assert not any(isinstance(event, Order) for event in flight.events.events)


@pytest.mark.parametrize("address", ["0.0.0.0:8480", "192.0.2.1:80", "[::]:8480"])
def test_an_address_that_others_reach_needs_token_and_tls(address, tmp_path):
    with pytest.raises(ConsoleError, match="--console-access"):
        parse_access(address, None)
    for name in ("cert.pem", "key.pem", "operate.token"):
        with pytest.raises(ConsoleError, match=f"{name} is missing"):
            parse_access(address, tmp_path)
        (tmp_path / name).write_text(OPERATE)
    for secret in ("key.pem", "operate.token"):
        (tmp_path / secret).chmod(0o644)
        with pytest.raises(ConsoleError, match=f"{secret} may be read by others"):
            parse_access(address, tmp_path)
        (tmp_path / secret).chmod(0o600)
    access = parse_access(address, tmp_path)
    assert access is not None
    assert access.role(OPERATE) == "operate"
    assert access.role("") is None


@pytest.mark.parametrize("address", ["localhost", "127.0.0.1:x", ":80", "127.0.0.1:99999"])
def test_a_wrong_address_is_explained(address):
    with pytest.raises(ConsoleError, match="expected HOST:PORT or off"):
        parse_access(address, None)


def test_the_next_port_is_used_if_the_default_one_is_taken_and_a_named_one_is_an_error():
    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(ConsoleError, match="cannot be opened"):
            bind(Access(port=other.getsockname()[1]))
    with bind(Access()) as first, bind(Access()) as second:
        assert DEFAULT_PORT <= first.getsockname()[1] < second.getsockname()[1]
