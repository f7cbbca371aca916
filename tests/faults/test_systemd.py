"""systemd would take a service for dead that lives, or wait for ever for its start: a real process."""

from __future__ import annotations

import signal
import socket
import time
from pathlib import Path

import pytest
from helpers.processes import Run, free_port

UNITS = sorted((Path(__file__).parents[2] / "config" / "systemd").glob("*.service"))


def received(manager: socket.socket) -> list[str]:
    messages = []
    manager.setblocking(False)
    while True:
        try:
            messages.append(manager.recv(100).decode())
        except BlockingIOError:
            return messages


@pytest.mark.real_time
def test_systemd_hears_of_the_start_of_signs_of_life_and_of_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(f"\0{tmp_path.name}-{time.monotonic_ns()}")
        address = f"@{manager.getsockname()[1:].decode()}"
        run = Run(tmp_path)
        try:
            environment = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "300000"}
            service = run.serve("flown", environment, ("--console", f"127.0.0.1:{free_port()}"))
            run.until("flown", lambda said: said.count("verified by read-back") == 4)
            early = received(manager)
            assert early[0] == "READY=1"
            assert early.count("READY=1") == 1  # its bridge and its console do not speak for it
            time.sleep(1.0)
            assert received(manager).count("WATCHDOG=1") >= 5
            service.send_signal(signal.SIGSTOP)
            received(manager)
            time.sleep(1.0)
            assert received(manager) == []  # systemd would end it now
            service.send_signal(signal.SIGCONT)
            service.send_signal(signal.SIGINT)
            assert service.wait(20.0) == 0
            assert received(manager)[-1] == "STOPPING=1"
        finally:
            run.end()


@pytest.mark.parametrize(
    "unit", [one for one in UNITS if "gcs run" in one.read_text()], ids=lambda path: path.stem
)
def test_each_unit_waits_for_the_start_and_watches_the_program(unit: Path) -> None:
    lines = unit.read_text().splitlines()
    assert {"Type=notify", "KillSignal=SIGINT", "NoNewPrivileges=yes"} <= set(lines)
    assert any(line.startswith("WatchdogSec=") for line in lines)
