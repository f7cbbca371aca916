"""Messages get from sensor to service over real zenoh sessions, in whatever order they are started."""

import queue
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs.config import load
from gcs.errors import LinkError
from gcs.io.zenoh.certificate_authority import make_certificate_authority, make_node
from gcs.io.zenoh.key_expressions import sensor_scan_keys
from gcs.io.zenoh.scans import decode_scan
from gcs.io.zenoh.session import ZenohSession, free_endpoint, service_bus

TIMEOUT_S = 20.0

Inbox = queue.Queue[tuple[str, bytes]]


def inbox(bus: ZenohSession, key_expr: str) -> Inbox:
    messages: Inbox = queue.Queue()
    bus.subscribe(key_expr, lambda key, payload: messages.put((key, payload)))
    return messages


def publish_until_heard(bus: ZenohSession, key: str, messages: Inbox) -> tuple[str, bytes]:
    """Publish again and again: who connects is heard only from then on."""
    give_up = time.monotonic() + TIMEOUT_S
    while time.monotonic() < give_up:
        bus.publish(key, b"hello")
        try:
            return messages.get(timeout=0.05)
        except queue.Empty:
            continue
    raise AssertionError("nothing was heard")


def test_a_service_that_connects_hears_the_sensor_there_and_is_reached_by_a_door_of_its_own() -> None:
    endpoint = free_endpoint()
    with ZenohSession(listen=endpoint) as sensor, service_bus("connect", endpoint) as (service, door):
        assert door != endpoint
        scans, answers = inbox(service, "swarm/m/sensor/*/scan"), inbox(sensor, "swarm/m/plan")
        assert publish_until_heard(sensor, "swarm/m/sensor/a/scan", scans)
        assert publish_until_heard(service, "swarm/m/plan", answers)
        with ZenohSession(connect=door) as operator:
            orders = inbox(service, "swarm/m/order")
            assert publish_until_heard(operator, "swarm/m/order", orders)


WITHOUT_FILES = """
import resource, signal, time
from gcs.io.zenoh.session import ZenohSession, free_endpoint
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
endpoint, sizes = free_endpoint(), []
with ZenohSession(listen=endpoint) as one, ZenohSession(connect=endpoint) as other:
    other.subscribe("a", lambda _, payload: sizes.append(len(payload)))
    while not one.is_subscribed("a"):
        time.sleep(0.02)
    one.publish("a", bytes(500_000))
    while not sizes:
        time.sleep(0.02)
"""


def test_large_messages_pass_when_no_shared_memory_is_left() -> None:
    """Sessions could not be opened, or a thread ended in a panic of zenoh: the standby heard nothing more."""
    subprocess.run([sys.executable, "-c", WITHOUT_FILES], check=True, timeout=TIMEOUT_S)


def test_a_message_arrives_with_its_key_both_ways() -> None:
    endpoint = free_endpoint()
    with ZenohSession(listen=endpoint) as service, ZenohSession(connect=endpoint) as sensor:
        scans = inbox(service, "swarm/m/sensor/*/scan")
        plans = inbox(sensor, "swarm/m/plan")
        assert publish_until_heard(sensor, "swarm/m/sensor/a/scan", scans) == (
            "swarm/m/sensor/a/scan",
            b"hello",
        )
        assert publish_until_heard(service, "swarm/m/plan", plans) == ("swarm/m/plan", b"hello")


def test_a_burst_arrives_whole_and_in_order() -> None:
    endpoint = free_endpoint()
    with ZenohSession(listen=endpoint) as service, ZenohSession(connect=endpoint) as sensor:
        scans = inbox(service, "swarm/m/**")
        publish_until_heard(sensor, "swarm/m/first", scans)
        for number in range(3000):
            sensor.publish("swarm/m/burst", b"%d" % number)
        heard: list[bytes] = []
        while len(heard) < 3000:
            key, payload = scans.get(timeout=TIMEOUT_S)
            heard += [payload] if key == "swarm/m/burst" else []
        assert heard == [b"%d" % number for number in range(3000)]


def test_the_listener_may_come_up_later_and_come_back() -> None:
    endpoint = free_endpoint()
    with ZenohSession(connect=endpoint) as sensor:
        for _ in range(2):
            with ZenohSession(listen=endpoint) as service:
                publish_until_heard(sensor, "swarm/m/x", inbox(service, "swarm/m/x"))


def test_a_second_listener_is_refused_as_the_port_is_in_use() -> None:
    endpoint = free_endpoint()
    with (
        ZenohSession(listen=endpoint),
        pytest.raises(LinkError, match="another process listens here") as caught,
    ):
        ZenohSession(listen=endpoint)
    assert caught.value.endpoint == endpoint


@pytest.mark.parametrize(
    "endpoint", ["tcp/127.0.0.1:99999", "carrier-pigeon/1", "7447", "tcp/no-such-host.invalid:1"]
)
def test_a_wrong_endpoint_is_refused(endpoint: str) -> None:
    with pytest.raises(LinkError) as caught:
        ZenohSession(listen=endpoint)
    assert caught.value.endpoint == endpoint
    assert ".rs" not in caught.value.problem


def test_a_malformed_key_and_a_closed_bus_are_link_errors() -> None:
    bus = ZenohSession(listen=free_endpoint())
    with pytest.raises(LinkError, match="cannot publish"):
        bus.publish("swarm//x", b"")
    with pytest.raises(LinkError, match="cannot subscribe"):
        bus.subscribe("", lambda _key, _payload: None)
    bus.close()
    with pytest.raises(LinkError, match="closed"):
        bus.publish("swarm/x", b"")


def test_a_bus_must_know_its_side() -> None:
    with pytest.raises(ValueError, match="listens or connects"):
        ZenohSession()


def test_the_documented_sensor_feeds_the_service() -> None:
    page = (Path(__file__).parents[3] / "docs" / "sensors.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    examples = re.findall(r"```json\n(.*?)```", page, re.DOTALL)
    (example,) = [one for one in examples if "z_m" in one]
    endpoint = free_endpoint()
    frame = load("prescribed").local_frame
    with ZenohSession(listen=endpoint) as service:
        scans = inbox(service, sensor_scan_keys("prescribed"))
        sensor = subprocess.Popen(
            [sys.executable, "-P", "-c", program.replace("tcp/127.0.0.1:7447", endpoint)]
        )
        try:
            key, payload = scans.get(timeout=TIMEOUT_S)
        finally:
            sensor.terminate()
            sensor.wait()
    scan = decode_scan(key, payload, time.time_ns(), frame)
    assert scan.z_m.tolist() == [[102.5, 880.0], [1460.2, 310.7]]
    assert decode_scan(key, example.encode(), 0, frame).z_m.tolist() == scan.z_m.tolist()


def test_the_documented_sensor_feeds_a_service_with_certificates(tmp_path: Path) -> None:
    docs = Path(__file__).parents[3] / "docs"
    (program,) = re.findall(r"```python\n(.*?)```", (docs / "sensors.md").read_text("utf-8"), re.DOTALL)
    (secured,) = re.findall(r"```python\n(.*?)```", (docs / "security.md").read_text("utf-8"), re.DOTALL)
    endpoint = free_endpoint("tls")
    make_certificate_authority(tmp_path, 30)
    make_node(tmp_path, "radar-1", "sensor", [], 30)
    command = make_node(tmp_path, "hub", "command", [], 30)
    (line,) = re.findall(r"^config.*connect/endpoints.*\n", program, re.MULTILINE)
    program = program.replace(line, secured.replace("tls/10.0.0.5:7447", endpoint))
    with ZenohSession(listen=endpoint, tls=command) as service:
        scans = inbox(service, sensor_scan_keys("prescribed"))
        sensor = subprocess.Popen([sys.executable, "-P", "-c", program], cwd=tmp_path)
        try:
            key, _ = scans.get(timeout=TIMEOUT_S)
        finally:
            sensor.terminate()
            sensor.wait()
    assert key == "swarm/prescribed/sensor/radar-1/scan"


def test_a_service_with_certificates_that_connects_to_a_sensor_is_reached_by_operators(
    tmp_path: Path,
) -> None:
    make_certificate_authority(tmp_path, 30)
    sensor_tls = make_node(tmp_path, "a", "sensor", ["localhost"], 30)
    operator_tls = make_node(tmp_path, "anna", "operator", [], 30)
    command_tls = make_node(tmp_path, "hub", "command", [], 30)
    endpoint = free_endpoint("tls")
    with (
        ZenohSession(listen=endpoint, tls=sensor_tls) as sensor,
        service_bus("connect", endpoint, command_tls) as (service, door),
        ZenohSession(connect=door, tls=operator_tls) as operator,
    ):
        scans, orders = inbox(service, "swarm/m/sensor/*/scan"), inbox(service, "swarm/m/order")
        assert publish_until_heard(sensor, "swarm/m/sensor/a/scan", scans)
        assert publish_until_heard(operator, "swarm/m/order", orders)


def test_certificate_and_endpoint_belong_together(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="needs a certificate"):
        ZenohSession(connect="tls/127.0.0.1:7447")
    with pytest.raises(LinkError, match="expected tls/HOST:PORT"):
        ZenohSession(connect="tcp/127.0.0.1:7447", tls=tmp_path)
