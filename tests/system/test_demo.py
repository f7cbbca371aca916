"""`gcs demo` as a user runs it: real processes, real UDP, real zenoh."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from helpers.missions import short_mission

from gcs.cli import app
from gcs.io.recording.reader import read
from gcs.model import AgentStatus, MissionEnded, Plan, Truth

GCS = [sys.executable, "-P", "-c", "from gcs.cli import main; main()"]
SPEED = "8"


class Demo:
    """A running `gcs demo`, its lines as they come."""

    def __init__(self, out: Path, *arguments: str) -> None:
        self.out = out
        command = [*GCS, "demo", *arguments, "--headless", "--speed", SPEED, "--out", str(out), "--json"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.lines: list[str] = []
        self._news = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            with self._news:
                self.lines.append(line.rstrip())
                self._news.notify_all()

    def await_line(self, pattern: str, timeout_s: float = 60.0) -> re.Match[str]:
        """Wait for a line that matches; return the match."""
        deadline = time.monotonic() + timeout_s
        seen = 0
        with self._news:
            while True:
                for line in self.lines[seen:]:
                    if match := re.search(pattern, line):
                        return match
                seen = len(self.lines)
                if not self._news.wait(max(0.0, deadline - time.monotonic())):
                    raise AssertionError(f"no line like {pattern!r} in:\n" + "\n".join(self.lines))

    def pids(self) -> list[int]:
        """Process ids of all vehicles."""
        self.await_line(r"plan: first plan")
        return [int(m[1]) for line in self.lines if (m := re.search(r"vehicle \d+ is process (\d+)", line))]

    def result(self, timeout_s: float = 100.0) -> dict[str, Any]:
        """Wait for the end; return the JSON object on the last line."""
        assert self.process.stdout is not None
        self.process.wait(timeout_s)
        self._reader.join(5.0)
        last = self.process.stdout.read().strip().splitlines()[-1]
        result: dict[str, Any] = json.loads(last)
        return result

    def stop(self) -> None:
        """Leave nothing behind, also when a test fails."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


@pytest.fixture
def demo(tmp_path: Path, request: pytest.FixtureRequest) -> Any:
    arguments = getattr(request, "param", ())
    if arguments == "short":
        arguments = (str(short_mission(tmp_path)), "--pack", "4", "--loss", "0.1")
    running = Demo(tmp_path / "run", *arguments)
    yield running
    running.stop()


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # gone before, or while it was read
        return False


@pytest.mark.parametrize("demo", ["short"], indirect=True)
def test_a_mission_is_flown_over_lossy_links_recorded_and_evaluated(demo: Demo) -> None:
    result = demo.result()
    assert demo.process.returncode == 0, demo.lines
    keys = "scenario seed outcome reason duration_s agents targets_total targets_reached retasks uploads"
    keys += " upload_failures ospa_agents_mean_m ospa_targets_mean_m scan_ms_p99 plan_ms_p99 recording links"
    assert list(result) == keys.split()
    assert result["outcome"] == "complete"
    assert [agent["status"] for agent in result["agents"]] == ["arrived"] * 4
    assert len({agent["target"] for agent in result["agents"]}) == 4
    assert result["upload_failures"] == 0
    assert result["ospa_agents_mean_m"] < 5.0
    assert result["ospa_targets_mean_m"] < 5.0
    assert (demo.out / "run.png").stat().st_size > 10_000
    values = [record.value for record in read(demo.out)]
    assert sum(isinstance(value, MissionEnded) for value in values) == 1
    assert sum(isinstance(value, Truth) for value in values) > 20


@pytest.mark.real_time
@pytest.mark.parametrize("demo", [("prescribed", "--seed", "3", "--loss", "0.2")], indirect=True)
def test_killed_vehicles_lossy_links_and_hostile_bytes_are_seen_through(demo: Demo) -> None:
    port = int(demo.await_line(r"listens on UDP port (\d+)")[1])
    hostile = threading.Thread(target=_bombard, args=(port, demo.process), daemon=True)
    hostile.start()
    pids = demo.pids()
    demo.await_line(r" 3[0-9]\.\d\d s")  # run time: all are on their way
    os.kill(pids[3], signal.SIGKILL)
    result = demo.result()
    assert demo.process.returncode == 0, demo.lines
    assert [agent["status"] for agent in result["agents"]] == ["arrived", "lost", "arrived", "lost"]
    statuses = [record.value for record in read(demo.out) if isinstance(record.value, AgentStatus)]
    plans = [record.value for record in read(demo.out) if isinstance(record.value, Plan)]
    loss = next(status for status in statuses if status.vehicle == 4)
    assert any(plan.t_ns >= loss.t_ns and "agent 4 lost" in plan.reason for plan in plans)


def _bombard(port: int, process: subprocess.Popen[str]) -> None:
    """Garbage, truncated frames, and an unknown system with vehicle 1's id, until the demo ends."""
    heartbeat = bytes.fromhex("fd09000000010100000000000000020351040350d1")
    unknown_system = bytes.fromhex("fd0900000007010000000000000002035104034a3c")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        count = 0
        while process.poll() is None and count < 20_000:
            for data in (os.urandom(64), heartbeat, heartbeat[:9], unknown_system, b"\xfd" * 40, b""):
                sender.sendto(data, ("127.0.0.1", port))
            count += 1
            time.sleep(0.01)


@pytest.mark.real_time
def test_ctrl_c_ends_every_process_and_leaves_a_readable_recording(demo: Demo) -> None:
    pids = demo.pids()
    demo.await_line(r" [1-9]\d\.\d\d s")
    demo.process.send_signal(signal.SIGINT)
    result = demo.result(30.0)
    assert demo.process.returncode == 130
    assert result["outcome"] == "incomplete"
    deadline = time.monotonic() + 5.0
    while any(is_running(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert len(pids) == 4
    assert not any(is_running(pid) for pid in pids)
    values = [record.value for record in read(demo.out)]
    assert any(isinstance(value, Plan) for value in values)
    assert type(values[-1]).__name__ != "Damage"


@pytest.mark.real_time
def test_vehicles_end_when_the_demo_is_killed(demo: Demo) -> None:
    pids = demo.pids()
    demo.await_line(r" [34]\d\.\d\d s")  # seconds of wall time after the first plan, which is flushed by then
    demo.process.kill()
    deadline = time.monotonic() + 10.0
    while any(is_running(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(is_running(pid) for pid in pids)
    assert any(isinstance(record.value, Plan) for record in read(demo.out))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["demo", "no-such-scenario"], "shipped scenarios"),
        (["check", "no-such-file.toml"], "no such file or scenario"),
        (["simulate", "no-such-scenario"], "shipped scenarios"),
        (["simulate", "prescribed", "--out", "/dev/null/run"], "choose another folder"),
        (["demo", "--headless", "--out", "/dev/null"], "it is a file"),
    ],
)
def test_a_mistake_is_one_readable_line_and_exit_code_2(
    arguments: list[str], words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        app(arguments)
    assert ended.value.code == 2
    assert words in " ".join(capfd.readouterr().err.split())
