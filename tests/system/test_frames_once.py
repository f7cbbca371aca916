"""A datagram is scanned once, from the socket to the state; a replay of its bytes gives the same."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import load
from gcs.core.engine import Engine
from gcs.endpoints import Link, parse_endpoint
from gcs.io.links.manager import Links
from gcs.io.record_json import encode
from gcs.io.signing.link_signing import LinkSigning
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.mavlink.frames.codec import Encoder
from gcs.mavlink.frames.fast_scan import Scanner
from gcs.mavlink.frames.signing import Keys, SigningGate, signed, timestamp_of
from gcs.service.service import Service

KEY = bytes(range(32))
CONFIG = load("prescribed")
AIR, SEAT = (
    Link(parse_endpoint(f"udpin:127.0.0.1:{port}"), role=role)
    for port, role in ((0, "vehicles"), (1, "full"))
)


class CountingScanner(Scanner):
    def __init__(self):
        super().__init__()
        self.scans = 0

    def __call__(self, data):
        self.scans += 1
        return super().__call__(data)


class Way:
    """The way of a datagram: link, gate, router and noise filter, queue, recorder and engine."""

    def __init__(self, monkeypatch, bus, key):
        self.scanner, self.pen, self.key = CountingScanner(), Encoder(1, 1), key
        signing = LinkSigning([AIR, SEAT])
        signing.gate = SigningGate(Keys(default=key), [AIR, SEAT])
        monkeypatch.setattr("gcs.io.links.manager.TRANSPORTS", {"udpin": lambda _: Transport()})
        links = Links([AIR, SEAT], [1, 2, 3, 4], CONFIG.local_frame, signing, self.scanner)
        self.service = Service(CONFIG, 1, links, bus)
        self.service._garbage._scan = self.service.engine.stages.fleet._scan = self.scanner
        links.start(None, self.service)
        self.transport = links._transports[SEAT.name]
        self.station = links._ports[SEAT.name]
        self.station.connected("10.0.0.9:1")

    def frame(self, message):
        frame = self.pen(message)
        return frame if self.key is None else signed(frame, self.key, 0, timestamp_of(self.service.now_ns()))

    def beat(self):
        return self.frame(dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3))

    def position(self, boot_ms):
        degrees = (round(1e7 * CONFIG.local_frame.lat_deg), round(1e7 * CONFIG.local_frame.lon_deg))
        return self.frame(
            dialect.MAVLink_global_position_int_message(boot_ms, *degrees, 300_000, 100_000, 1, 2, 3, 4)
        )

    def scans_of(self, data):
        """Deliver a datagram; return the number of scans until its effects are known, and the event."""
        self.scanner.scans = 0
        self.service.links._ports[AIR.name].heard("10.0.0.1:1", data)
        event, frames = self.service._queue.get_nowait()
        self.service._process(event, frames)
        return self.scanner.scans, event


class Transport:
    refused = port = 0

    def __init__(self):
        self.sent = []

    def start(self, loop, listener):
        pass

    def send(self, peer, data):
        self.sent.append(data)

    def close(self):
        pass


@pytest.fixture(params=[None, KEY], ids=["without keys", "with keys"])
def way(request, monkeypatch):
    with ZenohSession(listen=free_endpoint()) as bus:
        yield Way(monkeypatch, bus, request.param)


def test_a_vehicles_datagram_is_scanned_once_and_replays_the_same(way):
    replayed, events = Engine(CONFIG, 1), []
    for k in range(3):
        data = way.beat() + way.position(1000 + 100 * k)
        scans, event = way.scans_of(data)
        assert scans == 1
        assert event.data == data
        events.append(event)
    assert way.transport.sent[-1] == events[-1].data, "the router sent it on"
    for event in events:
        replayed.step(event)
    fleet = way.service.engine.stages.fleet
    assert fleet.states() == replayed.stages.fleet.states() != ()
    assert fleet.counters == replayed.stages.fleet.counters


def test_noise_and_unknown_frames_are_counted_as_in_a_replay(way):
    replayed = Engine(CONFIG, 1)
    unknown = b"\xfd\x00\x00\x00\x00\x01\x01\xff\xff\x0f\x00\x00"
    for data in (
        way.beat() + b"noise",
        b"\xfd\xfe" + way.beat(),
        way.beat() + unknown + b"\xfe",
        way.beat()[:-3],
    ):
        try:
            _, event = way.scans_of(data)
        except asyncio.QueueEmpty:
            continue  # nothing of it was accepted
        replayed.step(event)
    assert way.service.engine.stages.fleet.counters == replayed.stages.fleet.counters
    effects = (encode(notice) for notice in way.service.engine.stages.fleet.notices())
    assert list(effects) == [encode(notice) for notice in replayed.stages.fleet.notices()]


def test_frames_of_a_hostile_datagram_do_not_fill_the_memory(way):
    unknown_id = next(number for number in range(256) if number not in dialect.mavlink_map)
    frames = way.scanner(bytes([0xFE, 0, 0, 1, 1, unknown_id, 0, 0]) * 8_000)
    assert frames.count == 8_000
    way.service.on_datagram(AIR.name, "x", frames)
    event, queued = way.service._queue.get_nowait()
    assert event.data == frames.data
    assert queued is None
