"""A service without vehicles, with its console, on a thread of its own."""

from __future__ import annotations

import asyncio
import json
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from gcs.config import load
from gcs.console import Access, ConsoleServer
from gcs.console.capture import capture
from gcs.endpoints import Link, parse_endpoint
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import Event, Tick
from gcs.service.service import Service


class Events:
    """Sink that keeps events, and the times at which ticks came."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.tick_times_s: list[float] = []

    def event(self, event: Event) -> None:
        self.events.append(event)
        if isinstance(event, Tick):
            self.tick_times_s.append(time.monotonic())

    def effect(self, _t_ns: int, _effect: Any) -> None:
        pass


class Flight:
    """The running service and ways to talk to its console."""

    def __init__(self, service: Service, console: ConsoleServer, events: Events) -> None:
        self.service, self.console, self.events = service, console, events
        self.url = console.url.rstrip("/")

    def page(self, **more: Any) -> ClientConnection:
        return connect(self.url.replace("http", "ws") + "/feed", compression=None, proxy=None, **more)

    def request(
        self, path: str, body: Any = None, headers: dict[str, str] | None = None
    ) -> tuple[int, Any, Any]:
        """Return code, body and headers of a response."""
        data = None if body is None else json.dumps(body).encode()
        given = {"content-type": "application/json"} if body is not None else {}
        request = urllib.request.Request(self.url + path, data, given | (headers or {}))
        try:
            with urllib.request.urlopen(request, timeout=5.0) as reply:
                return reply.status, reply.read(), reply.headers
        except urllib.error.HTTPError as error:
            return error.code, error.read(), error.headers


@pytest.fixture
def fly() -> Callable[..., Any]:
    return _fly


@contextmanager
def _fly(access: Access | None = None) -> Iterator[Flight]:
    started, flights = threading.Event(), []
    ends: list[Callable[[], object]] = []

    async def run(bus: ZenohSession) -> None:
        config = load("prescribed")
        links = Links([Link(parse_endpoint("udpin:127.0.0.1:0"))], [1, 2, 3, 4], config.local_frame)
        service, events, stop = Service(config, 1, links, bus), Events(), asyncio.Event()
        service.sinks.append(events)
        console = ConsoleServer(
            service,
            access or Access(),
            lambda t_ns: capture(service.command, t_ns),
            service.give_order,
            {"kind": "live", "speed": 1.0},
        )
        loop = asyncio.get_running_loop()
        ends.append(lambda: loop.call_soon_threadsafe(stop.set))
        flights.append(Flight(service, console, events))
        loop.call_later(0.1, started.set)
        epoch_ns = time.time_ns()
        await service.run(RunClock(epoch_ns, epoch_ns, 1.0), stop)
        console.close()

    with ZenohSession(listen=free_endpoint()) as bus:
        thread = threading.Thread(target=lambda: asyncio.run(run(bus)))
        thread.start()
        assert started.wait(10.0)
        try:
            yield flights[0]
        finally:
            ends[0]()
            thread.join(10.0)
