"""Two real services on mirrored links: the operator of neither would know of the other."""

from __future__ import annotations

import selectors
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.noticed import noticed
from helpers.processes import Run, free_port

from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import Notice, NoticeCode, UploadReport

SIGN = NoticeCode.SECOND_COMMANDER
LOCAL = "127.0.0.1"


class Mirror:
    """Gives each datagram of a vehicle to all services, and theirs to the vehicle."""

    def __init__(self, port: int, services: list[int]) -> None:
        self.services = services
        self.selector = selectors.DefaultSelector()
        self.air = self.bound(port)
        self.vehicles: dict[tuple[str, int], socket.socket] = {}
        self.peers: dict[socket.socket, tuple[str, int]] = {}
        self.is_closed = False
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def bound(self, port: int) -> socket.socket:
        one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        one.bind((LOCAL, port))
        self.selector.register(one, selectors.EVENT_READ)
        return one

    def run(self) -> None:
        while not self.is_closed:
            for key, _ in self.selector.select(0.2):
                data, sender = key.fileobj.recvfrom(65_535)  # type: ignore[union-attr]
                if key.fileobj is not self.air:
                    self.air.sendto(data, self.peers[key.fileobj])  # type: ignore[index]
                    continue
                if sender not in self.vehicles:
                    self.vehicles[sender] = self.bound(0)
                    self.peers[self.vehicles[sender]] = sender
                for port in self.services:
                    self.vehicles[sender].sendto(data, (LOCAL, port))

    def close(self) -> None:
        self.is_closed = True
        self.thread.join()
        for one in (self.air, *self.vehicles.values()):
            one.close()


class Mirrored(Run):
    """Two services: each has a mission file, a journal and links of its own to the same vehicles."""

    def __init__(self, folder: Path, speed: float) -> None:
        super().__init__(folder, speed)
        text = self.file.read_text()
        own_port = int(text.split('mavlink = "udpin:127.0.0.1:')[1].split('"')[0])
        ports = [free_port(), free_port()]
        scans = free_endpoint()
        self.mirror = Mirror(own_port, ports)
        self.world_side = ZenohSession(listen=self.zenoh)
        self.service_side = ZenohSession(listen=scans)
        self.world_side.subscribe("swarm/*/sensor/*/scan", self.service_side.publish)
        self.files = []
        for number, port in enumerate(ports):
            one = text.replace(f"udpin:127.0.0.1:{own_port}", f"udpin:127.0.0.1:{port}")
            one = one.replace(f'zenoh = "{self.zenoh}"', f'zenoh = "{scans}"\nzenoh_role = "connect"')
            one = one.replace(f"127.0.0.1:{self.seat}", f"127.0.0.1:{free_port()}")
            self.files.append(folder / f"service-{number}" / "mission.toml")
            self.files[-1].parent.mkdir()
            self.files[-1].write_text(one)

    def serve_one(self, number: int) -> None:
        self.file = self.files[number]
        whole, self.folder = self.folder, self.file.parent
        self.serve("log")
        self.folder = whole

    def end(self) -> None:
        super().end()
        self.mirror.close()
        self.world_side.close()
        self.service_side.close()


@pytest.fixture
def mirrored(tmp_path: Path) -> Iterator[Mirrored]:
    run = Mirrored(tmp_path, 2.0)
    yield run
    run.end()


@pytest.mark.slow
def test_two_services_on_mirrored_links_are_named_and_one_of_them_stops(mirrored: Mirrored) -> None:
    mirrored.serve_one(0)
    mirrored.until("service-0/log", lambda said: said.count("verified by read-back") >= 4, 90.0)
    time.sleep(10.0)  # twenty seconds of the flight: answers to its uploads have come
    mirrored.serve_one(1)
    mirrored.until_told("service-0/log", SIGN, 4)
    named_s = time.monotonic()
    mirrored.until_told("service-1/log", NoticeCode.IN_CONTACT, timeout_s=10.0)
    while time.monotonic() - named_s < 10.0:
        time.sleep(0.5)
    for service in mirrored.services:
        service.terminate()
        service.wait(20.0)
    alarms = noticed(mirrored.all("service-0/log", Notice), SIGN)
    assert [one.level for one in alarms] == ["alarm"] * 4
    uploads = mirrored.all("service-0/log", UploadReport)
    assert all(one.t_ns < alarms[-1].t_ns + 2_000_000_000 for one in uploads)
