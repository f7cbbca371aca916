"""Foxglove would show another picture of a flight than of its recording: a real WebSocket, a real process."""

from __future__ import annotations

import json
import re
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

import jsonschema
import pytest
from websockets.sync.client import ClientConnection, connect

from gcs.config import load

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed: pip install '.[foxglove]'")

GCS = [sys.executable, "-P", "-m", "gcs", "foxglove"]
WAIT_S = 30.0
MESSAGE_DATA = 1
"""Operation code: then come the subscription (u32) and the time (u64), little-endian."""
FIX = "/vehicle/1/fix"


@contextmanager
def foxglove(endpoint: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    command = [*GCS, "--zenoh", endpoint, "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            found = re.search(r"ws://\S+\d", line)
            assert found is not None, line + process.stdout.read()
            yield process, found[0].replace("localhost", "127.0.0.1")
        finally:
            process.kill()


def display(url: str) -> ClientConnection:
    return connect(url, subprotocols=["foxglove.sdk.v1"], proxy=None, max_size=None)


Found: TypeAlias = dict[str, tuple[dict[str, Any], list[Any]]]
"""Each channel, and messages of it."""


def has_messages(found: Found, *topics: str) -> bool:
    return all(topic in found and found[topic][1] for topic in topics)


def places(found: Found) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Return fixes, each with where its frame is at its time."""
    if not has_messages(found, FIX, "/tf"):
        return []
    moved = {
        (one["child_frame_id"], *one["timestamp"].values()): one["translation"] for one in found["/tf"][1]
    }
    times = [(fix["frame_id"], *fix["timestamp"].values()) for fix in found[FIX][1]]
    return [(fix, moved[at]) for fix, at in zip(found[FIX][1], times, strict=True) if at in moved]


def received(client: ClientConnection, is_enough: Callable[[Found], object]) -> Found:
    """Subscribe to topics as they are advertised; return what came until it is enough."""
    found: Found = {}
    until_s = time.monotonic() + WAIT_S
    while not is_enough(found):
        assert time.monotonic() < until_s, (
            f"messages of {[name for name, (_, got) in found.items() if got]} only"
        )
        try:
            message = client.recv(1.0)
        except TimeoutError:
            continue
        if isinstance(message, str):
            for channel in json.loads(message).get("channels", []):
                found[channel["topic"]] = channel, []
                wanted = [{"id": channel["id"], "channelId": channel["id"]}]
                client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        elif message[0] == MESSAGE_DATA:
            subscription, _ = struct.unpack_from("<IQ", message, 1)
            (topic,) = [topic for topic, (channel, _) in found.items() if channel["id"] == subscription]
            found[topic][1].append(json.loads(message[13:]))
    return found


def test_a_display_gets_positions_areas_and_notices_with_their_schemas(fly, launch):
    config = load("prescribed")
    with fly(config=config) as flight:
        launch(flight)
        circle = {"name": "fire", "circle": [700.0, 500.0, 60.0], "height_m": 80}
        zone = {"action": "no-fly-zone", "vehicles": "all", "no_fly_zone": circle}
        assert flight.request("/api/orders?wait_s=10", zone)[0] == 200
        with foxglove(flight.endpoint) as (process, url):
            with display(url) as client:
                found = received(
                    client, lambda got: places(got) and has_messages(got, "/map/areas", "/notices")
                )
            for channel, messages in found.values():
                assert channel["encoding"] == "json"
                assert channel["schemaEncoding"] == "jsonschema"
                for message in messages:
                    jsonschema.validate(message, json.loads(channel["schema"]))
            (area,) = json.loads(found["/map/areas"][1][0]["geojson"])["features"]
            assert area["properties"]["name"] == "exclusion area or no-fly zone, up to 80 m above ground"
            channel, _ = found[FIX]
            fix, moved = places(found)[0]
            assert channel["schemaName"] == "foxglove.LocationFix"
            place = config.local_frame.to_local(fix["latitude"], fix["longitude"])
            assert place == pytest.approx((moved["x"], moved["y"]), abs=0.02)
            assert place[1] == pytest.approx(300.0, abs=250.0)  # it circles near where it was launched
            with display(url) as late:  # areas are sent once, and again to who comes later
                received(late, lambda got: has_messages(got, "/map/areas", "/scene/areas"))
            process.send_signal(signal.SIGINT)
            assert process.wait(10.0) == 0


def test_a_port_that_is_taken_is_a_mistake_that_is_named(fly):
    with fly() as flight, socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        command = [*GCS, "--zenoh", flight.endpoint, "--port", port]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert f"port {port} cannot be opened" in done.stderr
