"""Command or its bridge stops, is killed and comes back beneath real vehicles: real processes and sockets."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.heartbeat_tap import HeartbeatTap
from helpers.noticed import noticed
from helpers.processes import Run, bridges, free_port, node_of

from gcs.io.recording.tlog import LogFrame, read_log
from gcs.io.zenoh.session import free_endpoint
from gcs.model import NS_PER_S, AgentStatus, Notice, NoticeCode, Resumed, Scan, Tick, UploadReport

STOPPED_S = 5.0
MAX_GAP_S = 1.5
HEARTBEAT_S = 1.0
"""On a busy machine. The bridge sends a heartbeat after 0.35 s without one."""
FAILOVER_S = 3.0
JOURNAL_S = 1.0
"""Until the journal has the end of the uploads."""


class Flight:
    def __init__(self, folder: Path) -> None:
        relay = free_port()
        self.run = Run(folder, relay=relay)
        self.tap = HeartbeatTap(relay, self.run.port)

    def serve(self, name: str) -> subprocess.Popen[bytes]:
        service = self.run.serve(name)
        self.run.until(name, lambda said: said.count("verified by read-back") == 4)
        time.sleep(JOURNAL_S)
        return service

    def wait_for_heartbeats(self) -> None:
        """Wait until all vehicles hear heartbeats again."""
        since_s = time.monotonic() + 0.5
        while min(times[-1] for times in self.tap.heard_s.values()) < since_s:
            assert time.monotonic() < since_s + 30.0
            time.sleep(0.1)

    def end(self) -> None:
        self.run.end()
        self.tap.end()


@pytest.fixture
def flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Flight]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    flying = Flight(tmp_path)
    yield flying
    flying.end()
    for bridge in bridges(tmp_path):
        bridge.kill()


def standby_of(flight: Flight, name: str) -> subprocess.Popen[bytes]:
    """Start a standby; wait until it follows."""
    standby = flight.run.serve(name, arguments=("--role", "standby"))
    flight.run.until(name, lambda said: "follows it" in said)
    return standby


def frames_of(folder: Path) -> Iterator[LogFrame]:
    """Yield the frames that a bridge has kept."""
    for part in sorted(folder.glob("*.tlog")):
        with part.open("rb") as file:
            yield from (entry for entry in read_log(file) if isinstance(entry, LogFrame))


def lost(flight: Flight, name: str) -> list[AgentStatus]:
    return [one for one in flight.run.all(name, AgentStatus) if one.status == "lost"]


def start_of_a_bridge_s() -> float:
    """Return how long a bridge's program takes to start on this machine, as busy as it is now."""
    began_s = time.monotonic()
    subprocess.run([sys.executable, "-P", "-c", "import gcs.service.bridge_process"], check=True)
    return time.monotonic() - began_s


@pytest.mark.real_time
def test_vehicles_hear_heartbeats_while_command_is_stopped(flight: Flight) -> None:
    service = flight.serve("flown")
    begin_s = time.monotonic()
    service.send_signal(signal.SIGSTOP)
    time.sleep(STOPPED_S)
    service.send_signal(signal.SIGCONT)
    time.sleep(2.0)
    gaps_s = flight.tap.gaps_s(begin_s, time.monotonic())
    assert len(gaps_s) == 4
    assert max(gaps_s) < MAX_GAP_S
    service.send_signal(signal.SIGINT)
    assert service.wait(20.0) == 0
    assert not lost(flight, "flown")


@pytest.mark.real_time
def test_vehicles_hear_heartbeats_while_command_is_killed_and_started_again(flight: Flight) -> None:
    """Without them for some seconds, vehicles begin their failsafes: only real time shows it."""
    first = flight.serve("first")
    begin_s = time.monotonic()
    first.kill()
    flight.run.serve("second")
    flight.run.until_told("second", NoticeCode.ONBOARD_VERIFIED, 4)
    gaps_s = flight.tap.gaps_s(begin_s, time.monotonic())
    assert len(gaps_s) == 4
    assert max(gaps_s) < MAX_GAP_S


def test_a_command_that_is_killed_and_started_again_takes_its_bridge_over(
    flight: Flight, tmp_path: Path
) -> None:
    first = flight.serve("first")
    (bridge,) = bridges(tmp_path)
    first.kill()
    second = flight.run.serve("second")
    flight.run.until_told("second", NoticeCode.ONBOARD_VERIFIED, 4)
    assert bridges(tmp_path) == [bridge]
    second.send_signal(signal.SIGINT)
    assert second.wait(20.0) == 0
    assert len(flight.run.all("second", Resumed)) == 1
    assert not flight.run.all("second", UploadReport)
    assert not lost(flight, "second")
    bridge.wait(5.0)


@pytest.mark.real_time
def test_without_a_command_the_heartbeats_end_after_the_time_of_a_failover(
    flight: Flight, tmp_path: Path
) -> None:
    text = flight.run.file.read_text().replace("[links]", f"[links]\nfailover_s = {FAILOVER_S}", 1)
    flight.run.file.write_text(text)
    service = flight.serve("flown")
    (bridge,) = bridges(tmp_path)
    service.kill()
    killed_s = time.monotonic()
    killed_unix_s = time.time()
    bridge.wait(FAILOVER_S + 10.0)
    last_s = [max(times) for times in flight.tap.heard_s.values()]
    assert all(FAILOVER_S - MAX_GAP_S < one - killed_s < FAILOVER_S + MAX_GAP_S for one in last_s)
    kept = list(frames_of(tmp_path / "deterministic-bridge-main"))
    for vehicle in range(1, 5):  # in no recording of command
        times_ns = [one.t_ns for one in kept if one.frame.system_id == vehicle]
        assert max(times_ns) / NS_PER_S > killed_unix_s + FAILOVER_S - MAX_GAP_S


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("end", "cause"),
    [
        (signal.SIGKILL, "killed by SIGKILL"),
        pytest.param(signal.SIGTERM, "exit code 0", marks=pytest.mark.slow),
    ],
)
def test_a_bridge_that_ends_is_started_again_with_an_alarm(
    flight: Flight, tmp_path: Path, end: signal.Signals, cause: str
) -> None:
    service = flight.serve("flown")
    (bridge,) = bridges(tmp_path)
    begin_s = time.monotonic()
    bridge.send_signal(end)
    (alarm, *_) = flight.run.until_told("flown", NoticeCode.BRIDGE_ENDED)
    assert alarm.parameters["cause"] == cause
    time.sleep(5.0)
    gap_s = max(flight.tap.gaps_s(begin_s, time.monotonic()))
    assert gap_s < HEARTBEAT_S + 0.5 + 1.3 * start_of_a_bridge_s()
    (new,) = bridges(tmp_path)
    assert new != bridge
    service.send_signal(signal.SIGINT)
    assert service.wait(20.0) == 0
    assert not lost(flight, "flown")


def with_standby(flight: Flight) -> None:
    """Name a standby in the mission file."""
    named = f'[links]\nstandby = "{flight.run.standby}"'
    flight.run.file.write_text(flight.run.file.read_text().replace("[links]", named, 1))


@pytest.mark.real_time
@pytest.mark.parametrize("stop", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_a_standby_takes_over_and_nothing_is_uploaded_again(
    flight: Flight, tmp_path: Path, stop: signal.Signals
) -> None:
    with_standby(flight)
    first = flight.serve("first")
    standby = standby_of(flight, "second")
    (bridge,) = bridges(tmp_path)
    time.sleep(2.0)
    begin_s = time.monotonic()
    node = node_of(first)
    node.send_signal(stop)
    flight.run.until("second", lambda said: "takes over" in said, 10.0)
    took_s = time.monotonic() - begin_s
    flight.run.until_told("second", NoticeCode.ONBOARD_VERIFIED, 4)
    assert took_s < 5.0
    if stop == signal.SIGSTOP:  # it must not command any more
        node.send_signal(signal.SIGCONT)
        flight.run.until("first", lambda said: "commands the vehicles" in said, 20.0)
        (resumed,) = flight.run.all("second", Resumed)
        assert flight.run.all("first", Tick)[-1].t_ns < resumed.t_ns  # nor answer orders
        flight.run.until("first", lambda said: "follows it" in said)
    assert bridges(tmp_path) == [bridge]
    assert max(flight.tap.gaps_s(begin_s, time.monotonic())) < MAX_GAP_S
    flight.run.until("second", lambda _: bool(flight.run.all("second", Scan)), 10.0)
    standby.send_signal(signal.SIGINT)
    assert standby.wait(20.0) == 0
    assert len(flight.run.all("second", Resumed)) == 1
    assert not flight.run.all("second", UploadReport)
    assert not lost(flight, "second")


@pytest.mark.real_time
def test_a_standby_takes_over_the_bridge_that_was_started_again(flight: Flight, tmp_path: Path) -> None:
    with_standby(flight)
    first = flight.serve("first")
    standby_of(flight, "second")
    bridges(tmp_path)[0].kill()
    flight.run.until_told("first", NoticeCode.BRIDGE_ENDED)
    flight.wait_for_heartbeats()
    (bridge,) = bridges(tmp_path)
    until_s = time.monotonic() + 10.0
    while not any(f'"pid":{bridge.pid},' in one.read_text() for one in tmp_path.rglob("*.json")):
        assert time.monotonic() < until_s, "the bridge was not noted for other nodes"
        time.sleep(0.05)
    first.kill()
    flight.run.until("second", lambda said: "takes over" in said, 10.0)
    time.sleep(3.0)
    assert bridges(tmp_path) == [bridge]
    assert not noticed(flight.run.all("second", Notice), NoticeCode.BRIDGE_ENDED)


@pytest.mark.real_time
@pytest.mark.timeout(400)  # nodes start several times
def test_a_standby_starts_the_bridge_again_that_ended_with_command(flight: Flight, tmp_path: Path) -> None:
    with_standby(flight)
    first = flight.serve("first")
    standby_of(flight, "second")
    node_of(first).kill()
    bridges(tmp_path)[0].kill()
    flight.run.until("second", lambda said: "takes over" in said, 20.0)
    flight.run.until_told("second", NoticeCode.ONBOARD_VERIFIED, 4)
    flight.run.until("first", lambda said: "follows it" in said)
    assert len(bridges(tmp_path)) == 1
    assert not flight.run.all("second", UploadReport)


@pytest.mark.real_time
@pytest.mark.timeout(400)
def test_a_node_that_was_killed_becomes_the_standby_of_the_one_that_took_over(
    flight: Flight, tmp_path: Path
) -> None:
    with_standby(flight)
    first = flight.serve("first")
    second = standby_of(flight, "second")
    begin_s = time.monotonic()
    node_of(first).kill()
    flight.run.until("second", lambda said: "takes over" in said, 10.0)
    flight.run.until("first", lambda said: "follows it" in said)
    node_of(second).kill()
    flight.run.until("first", lambda said: "takes over" in said, 10.0)
    flight.run.until("second", lambda said: said.count("follows it") == 2)
    flight.run.until_told("first-2", NoticeCode.ONBOARD_VERIFIED, 4)
    assert max(flight.tap.gaps_s(begin_s, time.monotonic())) < MAX_GAP_S
    first.send_signal(signal.SIGINT)
    assert first.wait(20.0) == 0
    assert second.wait(20.0) == 0  # with command
    for name in ("second", "first-2"):
        assert not flight.run.all(name, UploadReport)
        assert not lost(flight, name)
    assert not bridges(tmp_path)


@pytest.mark.real_time
def test_a_standby_ends_with_a_command_that_ends_in_order(flight: Flight) -> None:
    with_standby(flight)
    first = flight.serve("first")
    standby = standby_of(flight, "second")
    first.send_signal(signal.SIGINT)
    assert first.wait(20.0) == 0
    assert standby.wait(20.0) == 0
    assert "takes over" not in flight.run.printed("second")


@pytest.fixture
def bridge(flight: Flight) -> Iterator[subprocess.Popen[bytes]]:
    """A bridge that is run by itself, as on another machine."""
    endpoint = free_endpoint()
    with flight.run.file.open("a") as file:
        file.write(f'\n[[links.bridges]]\nname = "main"\nzenoh = "{endpoint}"\n')
    running = flight.run.serve("bridge", arguments=("--role", "bridge"))
    flight.run.until("bridge", lambda said: "command connects to" in said)
    yield running
    running.kill()


@pytest.mark.real_time
def test_a_bridge_elsewhere_serves_one_command_after_the_other_and_never_two(
    flight: Flight, bridge: subprocess.Popen[bytes], tmp_path: Path
) -> None:
    first = flight.serve("first")
    assert not bridges(tmp_path)  # none was started
    text = flight.run.file.read_text()
    own = flight.run.file.with_name("other.toml")
    own.write_text(text.replace(flight.run.zenoh, free_endpoint(), 1))
    other = flight.run.serve("other", arguments=("--journal", str(tmp_path / "other-journal")), file=own)
    assert other.wait(60.0) == 2
    assert "commands the vehicles" in flight.run.printed("other")
    assert not flight.run.all("other", UploadReport)
    begin_s = time.monotonic()
    first.kill()
    first.wait()
    second = flight.run.serve("second")
    flight.run.until_told("second", NoticeCode.ONBOARD_VERIFIED, 4)
    assert max(flight.tap.gaps_s(begin_s, time.monotonic())) < MAX_GAP_S
    second.send_signal(signal.SIGINT)
    assert second.wait(20.0) == 0
    assert bridge.poll() is None  # it waits for the next command
    bridge.send_signal(signal.SIGINT)
    assert bridge.wait(20.0) == 0


@pytest.mark.real_time
def test_of_two_bridges_one_may_end_and_a_standby_still_takes_over(flight: Flight) -> None:
    with_standby(flight)
    text = flight.run.file.read_text()
    own = f'mavlink = "udpin:127.0.0.1:{flight.run.port}"'
    two = (
        f'mavlink = [{{ endpoint = "udpin:127.0.0.1:{flight.run.port}", bridge = "hill" }}, '
        f'{{ endpoint = "udpin:127.0.0.1:{free_port()}", bridge = "mast" }}]'
    )
    text = text.replace(own, two, 1).replace("[[links.forward]]", '[[links.forward]]\nbridge = "hill"', 1)
    for name in ("hill", "mast"):
        text += f'\n[[links.bridges]]\nname = "{name}"\nzenoh = "{free_endpoint()}"\n'
    flight.run.file.write_text(text)
    running = [
        flight.run.serve(name, arguments=("--role", "bridge", "--bridge", name)) for name in ("hill", "mast")
    ]
    for name in ("hill", "mast"):
        flight.run.until(name, lambda said: "command connects to" in said)
    first = flight.serve("first")
    standby = standby_of(flight, "second")
    running[1].kill()
    time.sleep(4.0)
    begin_s = time.monotonic()
    first.kill()
    flight.run.until("second", lambda said: "takes over" in said, 10.0)
    flight.run.until_told("second", NoticeCode.ONBOARD_VERIFIED, 4)
    assert max(flight.tap.gaps_s(begin_s, time.monotonic())) < MAX_GAP_S
    standby.send_signal(signal.SIGINT)
    assert standby.wait(20.0) == 0
    assert not flight.run.all("second", UploadReport)
    running[0].send_signal(signal.SIGINT)
    assert running[0].wait(20.0) == 0
