"""Central command is killed in mid-flight and started again: real processes, real sockets, a real SIGKILL."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs.config import read_text
from gcs.edge.reader import read
from gcs.edge.zenoh_bus import free_endpoint
from gcs.model import Fate, Plan, Resumed, UploadReport

SPEED = 8.0
GCS = [sys.executable, "-c", "from gcs.cli import main; main()"]


class Run:
    """The simulated side, and central command as often as it is started."""

    def __init__(self, folder: Path) -> None:
        text, _ = read_text("deterministic")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.zenoh = free_endpoint()
        text = text.replace("udpin:0.0.0.0:14550", f"udpin:127.0.0.1:{port}", 1)
        text = text.replace('zenoh = "tcp/127.0.0.1:7447"', f'zenoh = "{self.zenoh}"', 1)
        assert str(port) in text
        assert self.zenoh in text
        self.folder, self.file = folder, folder / "mission.toml"
        self.file.write_text(text)
        command = [sys.executable, "-m", "sim_vehicles", "run", str(self.file), "--speed", str(SPEED)]
        command += ["--gcs", f"127.0.0.1:{port}", "--zenoh", self.zenoh, "--json", "--until-stdin-closes"]
        self.world = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        assert self.world.stdout is not None
        started = next(e for line in self.world.stdout if (e := json.loads(line))["event"] == "started")
        self.epoch_ns: int = started["epoch_ns"]
        self.services: list[subprocess.Popen[bytes]] = []

    def serve(self, name: str) -> subprocess.Popen[bytes]:
        command = [*GCS, "run", str(self.file), "--headless", "--out", str(self.folder / name)]
        command += ["--journal", str(self.folder / "journal"), "--clock", f"{self.epoch_ns},{SPEED}"]
        with (self.folder / f"{name}.log").open("wb") as log:
            self.services.append(subprocess.Popen(command, stdout=log, stderr=log))
        return self.services[-1]

    def until(self, name: str, wanted: Callable[[str], bool], timeout_s: float = 60.0) -> str:
        """Wait until a service has printed what is wanted; return all that it printed."""
        deadline, said = time.monotonic() + timeout_s, ""
        while time.monotonic() < deadline:
            said = (self.folder / f"{name}.log").read_text()
            if wanted(said):
                return said
            time.sleep(0.05)
        raise AssertionError(f"not within {timeout_s} s:\n{said}")

    def all(self, name: str, kind: type) -> list[Any]:
        return [record.value for record in read(self.folder / name) if isinstance(record.value, kind)]

    def end(self) -> None:
        for service in self.services:
            if service.poll() is None:
                service.kill()
            service.wait()
        assert self.world.stdin is not None
        self.world.stdin.close()
        self.world.wait(20.0)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    running = Run(tmp_path)
    yield running
    running.end()


@pytest.mark.slow
def test_killed_and_started_again_it_uploads_nothing_twice_and_all_arrive(run: Run) -> None:
    first = run.serve("first")
    run.until("first", lambda said: said.count("verified by read-back") == 4)
    order = [*GCS, "order", "hold", "-v", "2", "--json"]
    held = subprocess.run(order, capture_output=True, text=True, check=False, timeout=60)
    assert held.returncode == 0, held.stderr
    first.send_signal(signal.SIGKILL)
    first.wait()
    run.serve("second")
    run.until("second", lambda said: said.count("flies the mission that it was given") == 4)
    order = [*GCS, "order", "resume", "-v", "2"]
    resumed = subprocess.run(order, capture_output=True, text=True, check=False, timeout=60)
    assert resumed.returncode == 0, resumed.stderr
    run.until("second", lambda said: "mission ended: 4 arrived, 0 lost" in said)
    run.services[-1].send_signal(signal.SIGINT)
    assert run.services[-1].wait(20.0) == 0
    assert len(run.all("first", UploadReport)) == 4
    assert len(run.all("second", Resumed)) == 1
    assert [report.vehicle for report in run.all("second", UploadReport)] in ([], [2])
    assert {f.vehicle for f in run.all("second", Fate) if f.fate == "arrived"} == {1, 2, 3, 4}
    assert "taken up again" in run.all("second", Plan)[0].reason
    run.serve("third")
    said = run.until("third", lambda said: "listening on" in said)
    assert "taking up" not in said  # the mission had ended
