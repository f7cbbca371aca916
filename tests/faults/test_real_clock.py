"""The wall clock is set, and the process stopped, beneath a real `gcs run` with simulated vehicles."""

from __future__ import annotations

import signal
import time
from itertools import pairwise
from pathlib import Path

import pytest
from helpers.processes import Run, waited_ns

from gcs.io.recording.reader import read
from gcs.mavlink.frames.codec import scan
from gcs.model import NS_PER_S, AgentStatus, ClockStep, Plan, Send, UploadReport

STOPPED_S = 5.0
MAX_GAP_S = 1.2
HEARTBEAT = 0
FAKETIME = next(Path("/usr/lib").glob("*/faketime/libfaketimeMT.so.1"), None)
"""Debian's libfaketime, which sets the wall clock of one process."""


class WallClock:
    """The wall clock of one process, where libfaketime is installed."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "offset"
        self.set_by_s: list[int] = []
        self.set_by(0)
        self.environment = {
            "LD_PRELOAD": str(FAKETIME or ""), "FAKETIME_TIMESTAMP_FILE": str(self._file),
            "FAKETIME_NO_CACHE": "1", "FAKETIME_DONT_FAKE_MONOTONIC": "1", "FAKETIME_DONT_RESET": "1",
        }  # fmt: skip

    def set_by(self, step_s: int) -> None:
        self.set_by_s.append(step_s)
        temporary = self._file.with_suffix(".new")
        temporary.write_text(f"{sum(self.set_by_s):+d}\n")
        temporary.replace(self._file)


def heartbeats_ns(folder: Path) -> list[list[int]]:
    """Return when heartbeats were sent to each vehicle: run time, which begins as the machine's Unix time."""
    sent: dict[str, list[int]] = {}
    for record in read(folder):
        value = record.value
        if isinstance(value, Send) and any(f.message_id == HEARTBEAT for f in scan(value.data).frames):
            sent.setdefault(value.peer, []).append(record.t_ns)
    return list(sent.values())


def until_set(run: Run, times: int) -> None:
    """Wait until a service that may have waited for the processor has seen that its clock was set."""
    if FAKETIME is not None:
        run.until("flight", lambda said: said.count("clock of this machine was set") == times)


@pytest.mark.real_time
def test_a_service_whose_clock_is_set_and_that_is_stopped_in_flight_loses_no_vehicle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    wall, run = WallClock(tmp_path), Run(tmp_path)
    try:
        service = run.serve("flight", wall.environment)
        run.until("flight", lambda said: said.count("verified by read-back") == 4)
        flying_ns, waited_flying_ns = time.time_ns(), waited_ns(service)
        wall.set_by(-20)
        time.sleep(1.5)
        until_set(run, 1)
        stopped_ns, waited_stopped_ns = time.time_ns(), waited_ns(service)
        service.send_signal(signal.SIGSTOP)
        wall.set_by(3600)
        time.sleep(STOPPED_S)
        goes_on_ns = time.time_ns()
        service.send_signal(signal.SIGCONT)
        time.sleep(1.5)
        until_set(run, 2)
        wall.set_by(-600)
        time.sleep(1.5)
        until_set(run, 3)
        ends_ns, waited_ended_ns = time.time_ns(), waited_ns(service)
        service.send_signal(signal.SIGINT)
        assert service.wait(20.0) == 0
    finally:
        run.end()

    beats = heartbeats_ns(tmp_path / "flight")
    assert len(beats) == 4
    parts = (
        (flying_ns, stopped_ns, waited_stopped_ns - waited_flying_ns),
        (goes_on_ns, ends_ns, waited_ended_ns - waited_stopped_ns),
    )
    for times_ns in beats:
        for from_ns, to_ns, for_others_ns in parts:
            within_ns = [from_ns, *(t_ns for t_ns in times_ns if from_ns < t_ns < to_ns), to_ns]
            gap_ns = max(later - earlier for earlier, later in pairwise(within_ns))
            assert gap_ns <= MAX_GAP_S * NS_PER_S + for_others_ns
    assert not [agent for agent in run.all("flight", AgentStatus) if agent.status == "lost"]
    assert not [plan for plan in run.all("flight", Plan)[1:] if plan.changed]
    assert len(run.all("flight", UploadReport)) == 4, "no agent is tasked again"
    if FAKETIME is None:
        pytest.skip("stopped only: to set the clock needs libfaketime (apt-get install libfaketime)")
    steps_s = [step.step_ns / NS_PER_S for step in run.all("flight", ClockStep)]
    assert steps_s == pytest.approx(wall.set_by_s[1:], abs=0.2)
