"""A running service with its console, and simulated vehicles, each on a thread of its own."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import json
import shutil
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from helpers.field_vehicles import field
from playwright.sync_api import Page, expect, sync_playwright
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from websockets.sync.client import ClientConnection, connect

from gcs.cli.service_console import answer_consoles
from gcs.config import Config, load
from gcs.console.remote.remote_run import find_run
from gcs.console.server import ConsoleServer
from gcs.console.view.feed import Feed
from gcs.console.web.console_access import Access
from gcs.console.web.tiles import Tiles
from gcs.endpoints import Link, parse_endpoint
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import Event, Tick
from gcs.service.service import Service
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

__all__ = ["field"]

AXE = Path(__file__).parent / "axe" / "axe.min.js.gz"
WAIT_MS = 30_000.0
"""For a state of the page: tests wait for states, however busy the machine is."""
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip


@pytest.fixture
def page() -> Iterator[Page]:
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        opened = browser.new_page(viewport={"width": 1400, "height": 900})
        opened.set_default_timeout(WAIT_MS)
        expect.set_options(timeout=WAIT_MS)
        yield opened
        browser.close()


@pytest.fixture
def problems() -> Callable[..., list[tuple[str, str]]]:
    return _problems


def _problems(page: Page, *rules: str) -> list[tuple[str, str]]:
    """Return the rule and the element of each violation that axe-core finds; of some rules, or of all."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(gzip.decompress(AXE.read_bytes()).decode())
    options = {"resultTypes": ["violations"]} | ({"runOnly": rules} if rules else {})
    result: dict[str, Any] = page.evaluate("options => axe.run(document, options)", options)
    return [(one["id"], one["nodes"][0]["html"]) for one in result["violations"]]


class Events:
    """Sink that keeps events."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.ticks = 0

    def event(self, event: Event) -> None:
        self.events.append(event)
        self.ticks += isinstance(event, Tick)

    def await_ticks(self, count: int) -> None:
        """Wait until the service has worked on for as many ticks, of 50 ms or more."""
        begun, until_s = self.ticks, time.monotonic() + 30.0
        while self.ticks < begun + count:
            assert time.monotonic() < until_s, "the service stands still"
            time.sleep(0.01)

    def effect(self, _t_ns: int, _effect: Any) -> None:
        pass


class Flight:
    """The running service and ways to talk to its console, which reaches it over zenoh only."""

    def __init__(self, service: Service, feed: Feed, endpoint: str, events: Events) -> None:
        self.service, self.feed, self.endpoint, self.events = service, feed, endpoint, events

    @contextmanager
    def serve(self, access: Access, tiles: Tiles | None = None) -> Iterator[None]:
        """Serve the console while the context lasts."""
        with ZenohSession(connect=self.endpoint) as bus:
            with ThreadPoolExecutor(1) as pool:  # Playwright has a loop in this thread
                self._source = pool.submit(lambda: asyncio.run(find_run(bus, None, 10.0))).result()
            self.console = ConsoleServer(self._source, access, tiles)
            self.url = self.console.url.rstrip("/")
            try:
                yield
            finally:
                self.console.close()

    def restart_console(self) -> None:
        """End the console and start another one at its address."""
        self.console.close()
        self.console = ConsoleServer(self._source, Access(port=self.console.port))

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


class Vehicles:
    """Simulated vehicles that fly in real time and talk to a port."""

    def __init__(self, port: int) -> None:
        frame, t_ns = load("prescribed").local_frame, time.time_ns()
        places = {vehicle: 300.0 * vehicle for vehicle in (1, 3)}
        self._port, self._ends = port, threading.Event()
        self._flown = [
            (SimVehicle(spec_of(vehicle, north_m), frame, t_ns), udp_socket())
            for vehicle, north_m in places.items()
        ]
        self._thread = threading.Thread(target=self._fly, daemon=True)
        self._thread.start()

    def _fly(self) -> None:
        while not self._ends.wait(0.02):
            for vehicle, link in self._flown:
                for datagram in vehicle.datagrams_to_send(time.time_ns()):
                    link.sendto(datagram, ("127.0.0.1", self._port))
                with contextlib.suppress(BlockingIOError):
                    while True:
                        vehicle.receive_datagram(link.recv(2048), time.time_ns())

    def say(self, system_id: int, text: str) -> None:
        """Send a heartbeat and a text as another vehicle."""
        pen = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=1)
        with udp_socket() as link:
            for message in (
                mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3),
                mavlink.MAVLink_statustext_message(2, text.encode()),
            ):
                link.sendto(message.pack(pen), ("127.0.0.1", self._port))
                time.sleep(0.1)

    def end(self) -> None:
        self._ends.set()
        self._thread.join(2.0)
        for _, link in self._flown:
            link.close()


def spec_of(vehicle: int, north_m: float) -> VehicleSpec:
    return VehicleSpec(
        system_id=vehicle,
        east_m=300.0,
        north_m=north_m,
        course_rad=1.57,
        alt_rel_m=100.0,
        forward_speed_m_s=15.0,
    )


def udp_socket() -> socket.socket:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.setblocking(False)
    link.bind(("127.0.0.1", 0))
    return link


@pytest.fixture
def launch() -> Iterator[Callable[[Flight], Vehicles]]:
    """Start vehicles for a flight; they end with the test."""
    launched: list[Vehicles] = []

    def start(flight: Flight) -> Vehicles:
        launched.append(Vehicles(flight.service.links.port))
        return launched[-1]

    yield start
    for one in launched:
        one.end()


@pytest.fixture
def fly() -> Callable[..., Any]:
    return _fly


@contextmanager
def _fly(
    access: Access | None = None, tiles: Tiles | None = None, config: Config | None = None
) -> Iterator[Flight]:
    started, flights = threading.Event(), []
    ends: list[Callable[[], object]] = []

    async def run(bus: ZenohSession) -> None:
        flown = config or load("prescribed")
        links = Links([Link(parse_endpoint("udpin:127.0.0.1:0"))], [1, 2, 3, 4], flown.local_frame)
        service, events, stop = Service(flown, 1, links, bus), Events(), asyncio.Event()
        service.sinks.append(events)
        feed = answer_consoles(service, bus, 1.0)
        loop = asyncio.get_running_loop()
        ends.append(lambda: loop.call_soon_threadsafe(stop.set))
        flights.append(Flight(service, feed, endpoint, events))
        loop.call_later(0.1, started.set)
        epoch_ns = time.time_ns()
        await service.run(RunClock(epoch_ns, epoch_ns, 1.0), stop)

    endpoint = free_endpoint()
    with ZenohSession(listen=endpoint) as bus:
        thread = threading.Thread(target=lambda: asyncio.run(run(bus)))
        thread.start()
        assert started.wait(10.0)
        try:
            with flights[0].serve(access or Access(), tiles):
                yield flights[0]
        finally:
            ends[0]()
            thread.join(10.0)
