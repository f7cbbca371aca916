"""The console would be gone with its process, delay the flight, or show an ended service as alive."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import GCS, Run, console_of, free_port
from websockets.sync.client import ClientConnection, connect

from gcs.model import NoticeCode

TAP = Path(__file__).parents[1] / "bench" / "fuzz_console.py"
STOPPED_S = 5.0
MAX_GAP_S = 1.5
"""More than the 0.6 s of a machine that does nothing else: tests run side by side."""
HEADERS = {"content-type": "application/json"}

pytestmark = pytest.mark.timeout(240)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    running = Run(tmp_path)
    yield running
    running.end()


def url_in(said: str) -> str:
    return re.search(r"console: (http\S+)/", said)[1]  # type: ignore[index]


def started(run: Run, name: str = "flown") -> tuple[subprocess.Popen[bytes], str]:
    """Start the service with a console at a port of its own; return it, and the address of its console."""
    at = ("--console", f"127.0.0.1:{free_tcp_port()}")
    service = run.serve(name, {"PYTHONUNBUFFERED": "1"}, at)
    return service, url_in(run.until(name, lambda said: "console: http" in said, 120.0))


def free_tcp_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
        return port


def get(url: str, timeout_s: float = 10.0) -> Any:
    with urllib.request.urlopen(url, timeout=timeout_s) as reply:
        return json.load(reply)


def status(url: str, within_s: float = 60.0) -> dict[str, Any]:
    """Return the status, as soon as there is one."""
    until_s = time.monotonic() + within_s
    while True:
        try:
            found: dict[str, Any] = get(url + "/api/status")
            return found
        except (OSError, urllib.error.HTTPError):
            assert time.monotonic() < until_s
            time.sleep(0.1)


def feed(url: str) -> ClientConnection:
    return connect(url.replace("http", "ws") + "/feed", compression=None, proxy=None, max_size=None)


def until(page: ClientConnection, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Return the first message of a page that has what is wanted."""
    until_s = time.monotonic() + 60.0
    while True:
        found: dict[str, Any] = json.loads(page.recv(timeout=max(0.1, until_s - time.monotonic())))
        if wanted(found):
            return found


def order(url: str, action: str, vehicle: int) -> dict[str, Any]:
    body = json.dumps({"action": action, "vehicles": [vehicle]}).encode()
    with urllib.request.urlopen(
        urllib.request.Request(f"{url}/api/orders?wait_s=20", body, HEADERS)
    ) as reply:
        found: dict[str, Any] = json.load(reply)
    return found


def test_a_killed_console_is_back_at_its_address_and_the_flight_goes_on(run: Run) -> None:
    service, url = started(run)
    assert len(status(url)["agents"]) == 4
    first = console_of(service.pid)
    first.send_signal(signal.SIGKILL)
    first.wait(10.0)
    assert len(status(url)["agents"]) == 4
    assert console_of(service.pid).pid != first.pid
    (ended,) = run.until_told("flown", NoticeCode.PROCESS_ENDED)
    assert ended.subject == "console"
    assert "SIGKILL" in str(ended.parameters["error"])
    run.until_told("flown", NoticeCode.PROCESS_AGAIN)


@pytest.mark.real_time
def test_a_stopped_console_with_pages_delays_no_heartbeat(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    relay = free_port()
    run = Run(tmp_path, relay=relay)
    command = [sys.executable, str(TAP), "--tap", str(relay), str(run.port)]
    tap = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        service, url = started(run)
        run.until("flown", lambda said: said.count("verified by read-back") >= 4, 120.0)
        console = console_of(service.pid)
        with feed(url) as page:
            until(page, lambda found: "vehicles" in found)
            stopped_s = time.monotonic()
            console.suspend()
            time.sleep(STOPPED_S)
            console.resume()
            ended_s = time.monotonic()
            until(page, lambda found: "head" in found)
        heard = json.loads(tap.communicate("", 20.0)[0])
    finally:
        tap.kill()
        run.end()
    assert len(heard) == 4
    for times in heard.values():
        within = [stopped_s, *(one for one in times if stopped_s < one < ended_s), ended_s]
        assert max(later - earlier for earlier, later in pairwise(within)) < MAX_GAP_S


@pytest.mark.real_time
def test_two_consoles_show_the_same_service_and_both_command_it(run: Run) -> None:
    _, url = started(run)
    run.until("flown", lambda said: said.count("verified by read-back") >= 4, 120.0)
    command = [*GCS, "console", "--zenoh", run.zenoh, "--console", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        second = url_in(other.stdout.readline())
        with feed(url) as one, feed(second) as two:
            for page in (one, two):
                assert len(until(page, lambda found: "vehicles" in found)["vehicles"]) == 4
            assert [answer["state"] for answer in order(second, "hold", 2)["answers"]][-1] == "done"
            assert [answer["state"] for answer in order(url, "resume", 2)["answers"]][-1] == "done"
            for page in (one, two):
                until(page, lambda found: any(a["action"] == "resume" for a in found.get("answers", ())))
        other.send_signal(signal.SIGINT)
        assert other.wait(20.0) == 0


@pytest.mark.real_time
def test_a_console_says_that_its_service_is_gone_and_goes_on_with_the_next_one(run: Run) -> None:
    first = run.serve("first")
    command = [*GCS, "console", "--zenoh", run.zenoh, "--console", "127.0.0.1:0"]
    run.until("first", lambda said: "in contact" in said, 120.0)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other, ExitStack() as ends:
        ends.callback(other.terminate)
        assert other.stdout is not None
        url = url_in(other.stdout.readline())
        with feed(url) as page:
            begun = until(page, lambda found: "mission" in found)["mission"]["begun"]
            until(page, lambda found: "vehicles" in found)
            first.kill()
            lost_ms = until(page, lambda found: found.get("lost") is not None)["lost"]
            assert abs(time.time() * 1e3 - lost_ms) < 30e3
            with pytest.raises(urllib.error.HTTPError) as refused:
                get(url + "/api/status")
            assert refused.value.code == 503
            with pytest.raises(urllib.error.HTTPError) as refused:
                order(url, "hold", 1)
            assert "NOT sent" in json.load(refused.value)["error"]
            run.serve("second")
            found = until(page, lambda found: found.get("mission", {}).get("begun", begun) != begun)
            assert (found["type"], found["lost"], len(found["vehicles"])) == ("snapshot", None, 4)


@pytest.mark.real_time
def test_the_console_ends_with_a_killed_service_and_its_port_is_free(run: Run) -> None:
    service, url = started(run)
    status(url)
    console = console_of(service.pid)
    console.suspend()
    service.kill()
    service.wait()
    console.resume()
    console.wait(20.0)
    with socket.create_server(("127.0.0.1", int(url.rpartition(":")[2]))):
        pass


@pytest.mark.real_time
def test_a_console_without_a_service_says_what_to_do() -> None:
    command = [*GCS, "console", "--zenoh", "tcp/127.0.0.1:9", "--mission", "none"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 1
    assert "is it running" in found.stderr
