"""An operator would see an old picture, or a slow browser would delay the flight."""

import asyncio
import json
import socket
import time

import pytest

from gcs.console.web.page_connections import Clients
from gcs.model import Order

WAIT_S = 30.0
"""For a state, however busy the machine is."""


def read(page, wanted):
    """Return the newest content of sections, when all have come."""
    found, until_s = {}, time.monotonic() + WAIT_S
    while not wanted <= found.keys():
        found |= json.loads(page.recv(timeout=max(0.1, until_s - time.monotonic())))
    return found


def test_a_page_shows_mission_map_and_vehicles_at_once(fly):
    with fly() as flight, flight.page() as page:
        found = {}
        for _ in range(3):  # the page's role, and what there is; an update may be among them
            found |= json.loads(page.recv(timeout=WAIT_S))
        assert sorted(one["vehicle"] for one in found["vehicles"]) == [1, 2, 3, 4]
        assert found["mission"]["name"] == "prescribed"
        assert found["map"]["shape"] == [51, 51]
        first = found["head"]["t_ms"]
        assert read(page, {"head"})["head"]["t_ms"] > first


def test_nothing_is_captured_while_no_page_is_open(fly):
    with fly() as flight:
        flight.events.await_ticks(10)
        assert flight.feed.capture is None
        with flight.page() as page:
            read(page, {"vehicles"})
        flight.events.await_ticks(10)
        last = flight.feed.capture
        flight.events.await_ticks(10)
        assert flight.feed.capture is last


def test_an_order_of_the_page_is_an_event_and_its_answer_is_shown(fly):
    with fly() as flight, flight.page() as page:
        code, body, _ = flight.request("/api/orders?wait_s=3", {"action": "hold", "vehicles": [2]})
        reply = json.loads(body)
        assert code == 200
        assert reply["complete"] is True
        assert [one["vehicle"] for one in reply["answers"]] == [2]  # never heard: refused
        (order,) = [event for event in flight.events.events if isinstance(event, Order)]
        assert (order.action, order.vehicles, order.origin) == ("hold", (2,), "console at 127.0.0.1")
        answers = read(page, {"answers"})["answers"]
        while not answers:
            answers = read(page, {"answers"})["answers"]
        assert answers[0]["order_id"] == reply["order_id"]


OPEN = {"floor_m": None, "ceiling_m": None, "reference": "ground"}


def test_a_no_fly_zone_of_the_page_is_drawn_and_can_be_opened(fly):
    zone = {"name": "fire", "circle": [700, 500, 60]}
    with fly() as flight, flight.page() as page:
        read(page, {"zones"})
        assert flight.request("/api/orders", {"action": "no-fly-zone", "no_fly_zone": zone})[0] in (200, 202)
        assert read(page, {"zones"})["zones"] == [
            {"name": "fire", "disc_m": [700.0, 500.0, 60.0], "polygon_m": [], "limits": OPEN}
        ]
        flight.request("/api/orders", {"action": "no-fly-zone", "no_fly_zone": {"name": "fire"}})
        assert read(page, {"zones"})["zones"] == []


@pytest.mark.real_time
def test_pages_that_do_not_read_delay_neither_the_service_nor_other_pages(fly):
    with fly() as flight:
        stalled = [upgraded(flight) for _ in range(20)]
        flight.events.await_ticks(6)
        with flight.page() as page:
            for _ in range(5):
                read(page, {"head"})
        flight.events.await_ticks(20)
        for one in stalled:
            one.close()


def upgraded(flight) -> socket.socket:
    """Return the connection of a page that never reads."""
    connection = socket.create_connection(("127.0.0.1", flight.console.port))
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    connection.sendall(
        f"GET /feed HTTP/1.1\r\nHost: 127.0.0.1:{flight.console.port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
    )
    return connection


def test_a_page_that_falls_behind_gets_everything_anew_in_bounded_memory():
    async def run():
        clients = Clients(lambda: b"snapshot", 10)
        client = clients.join()
        assert await client.next() == b"snapshot"
        clients.send(b"1")
        assert await client.next() == b"1"
        for number in range(1000):
            clients.send(b"%d" % number)
        assert client.dropped > 0
        assert await client.next() == b"snapshot"
        clients.send(b"new")
        assert await client.next() == b"new"

    asyncio.run(run())
