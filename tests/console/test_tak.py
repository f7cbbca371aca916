"""TAK would get nothing of a service, or the flight would wait for TAK: a real socket, a real process."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from xml.etree import ElementTree

import pytest

pytest.importorskip("pytak", reason="pytak is not installed: pip install '.[tak]'")

WAIT_S = 30.0
EVENT = re.compile(rb"<event .*?</event>", re.DOTALL)


@contextmanager
def tak(endpoint: str, url: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-P", "-m", "gcs", "tak", url, "--zenoh", endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def listening(kind: socket.SocketKind) -> socket.socket:
    found = socket.socket(socket.AF_INET, kind)
    found.bind(("127.0.0.1", 0))
    found.settimeout(WAIT_S)
    if kind == socket.SOCK_STREAM:
        found.listen()
    return found


def test_vehicles_and_alarms_arrive_by_udp_with_hostile_texts_as_text(fly, launch):
    with listening(socket.SOCK_DGRAM) as receiver, fly() as flight:
        vehicles = launch(flight)
        url = f"udp://127.0.0.1:{receiver.getsockname()[1]}"
        with tak(flight.endpoint, url) as process:
            seen: dict[str, ElementTree.Element] = {}
            until_s = time.monotonic() + WAIT_S
            while not any("autopilot-alarm" in uid for uid in seen) and time.monotonic() < until_s:
                event = ElementTree.fromstring(receiver.recv(65536))
                seen[event.attrib["uid"]] = event
                if event.attrib["uid"].endswith("vehicle-3"):
                    vehicles.say(2, '</event>&<"')
            ids = [f"swarm-gcs.prescribed.vehicle-{vehicle}" for vehicle in (1, 3)]
            assert seen.keys() >= set(ids)
            assert seen[ids[0]].attrib["type"] == "a-f-A-M-F-Q"
            (alarm,) = [event for uid, event in seen.items() if "autopilot-alarm" in uid]
            assert alarm.find("detail/remarks").text.endswith('</event>&<"')
            process.send_signal(signal.SIGINT)
            assert process.wait(10.0) == 0
            assert "sending to udp://" in process.stdout.read()


@pytest.mark.real_time
def test_a_server_that_closes_or_stops_reading_gets_another_connection(fly, launch):
    with listening(socket.SOCK_STREAM) as server, fly() as flight:
        launch(flight)
        url = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with tak(flight.endpoint, url) as process:
            for _ in range(2):
                connection, _ = server.accept()
                with connection:
                    connection.settimeout(WAIT_S)
                    connection.sendall(b"<event/>" * 1000)  # a server that talks is read, and not obeyed
                    received = b""
                    while len(EVENT.findall(received)) < 3:
                        received += connection.recv(65536)
                    for event in EVENT.findall(received):
                        assert ElementTree.fromstring(event).attrib["version"] == "2.0"
            flight.events.await_ticks(3)
            process.send_signal(signal.SIGTERM)
            assert process.wait(10.0) == 0
            assert "lost the connection" in process.stdout.read()


@pytest.mark.parametrize("url", ["239.2.3.1:6969", "http://tak:8087", "udp://tak", "tak://host?token=x"])
def test_a_url_that_is_none_is_refused_before_anything_is_sent(url: str) -> None:
    command = [sys.executable, "-P", "-m", "gcs", "tak", url, "--zenoh", "tcp/127.0.0.1:1"]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)
    assert done.returncode == 2
    assert "expected tcp://HOST:PORT" in done.stderr
