"""The wall clock is set in flight: heartbeats, time-outs and the mission do not notice."""

import asyncio
import json
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest
from helpers.missions import short_mission
from helpers.noticed import noticed
from helpers.wall_clock import WallClock
from rich.console import Console

from gcs.cli.fly.demo_flight import run_demo
from gcs.cli.fly.demo_simulation import DemoOptions, DemoSimulation
from gcs.cli.prepare.preflight_checks import ScanListener, run_preflight
from gcs.config import load
from gcs.core.preflight.mission_checks import sensor_checks
from gcs.endpoints import Link, parse_endpoint
from gcs.io.clock import ClockWatch, RunClock
from gcs.io.links.manager import Links
from gcs.io.recording.reader import read
from gcs.io.zenoh.key_expressions import scan_key
from gcs.io.zenoh.scans import encode_scan
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.mavlink.frames.codec import scan
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    ClockStep,
    MissionEnded,
    Notice,
    NoticeCode,
    Plan,
    Scan,
    Send,
    Sensor,
    Tick,
    read_only,
)
from gcs.service.service import Service

STEPS_S = (0.5, -0.5, 1.5, -1.5, 20.0, -20.0, 600.0, -600.0, 3600.0, -3600.0)
SPEED = 5.0


@pytest.mark.parametrize("step_s", STEPS_S)
def test_run_time_goes_on_when_the_wall_clock_is_set(wall: WallClock, step_s: float) -> None:
    wall.t_ns, wall.monotonic_t_ns = 1_767_225_600 * NS_PER_S, 77 * NS_PER_S
    clock, watch = RunClock(), ClockWatch()
    before_ns = clock.now_ns()
    assert before_ns == wall.t_ns
    wall.t_ns += int(step_s * NS_PER_S)
    assert clock.now_ns() == before_ns
    assert watch.step_ns() == int(step_s * NS_PER_S)
    assert watch.step_ns() == 0


def test_a_step_is_a_notice_and_ticks_go_on(wall: WallClock) -> None:
    notices: list[Notice] = []
    ticks: list[int] = []

    class Sink:
        def event(self, event: object) -> None:
            if isinstance(event, Tick):
                ticks.append(event.t_ns)

        def effect(self, _t_ns: int, effect: object) -> None:
            if isinstance(effect, Notice):
                notices.append(effect)

    async def serve(bus: ZenohSession) -> None:
        links = Links([Link(parse_endpoint("udpin:127.0.0.1:0"))], [1], load("prescribed").local_frame)
        service = Service(load("prescribed"), 1, links, bus)
        service.sinks.append(Sink())
        stop, loop = asyncio.Event(), asyncio.get_running_loop()
        loop.call_later(0.5, setattr, wall, "set_by_ns", -600 * NS_PER_S)
        loop.call_later(1.5, stop.set)
        await asyncio.wait_for(service.run(RunClock(), stop), 10.0)

    with ZenohSession(listen=free_endpoint()) as bus:
        asyncio.run(serve(bus))
    (step,) = noticed(notices, NoticeCode.CLOCK_SET)
    assert step.parameters["step_s"] == pytest.approx(-600.0, abs=0.05)
    assert max(later - earlier for earlier, later in pairwise(ticks)) < 0.6 * NS_PER_S
    assert ticks[-1] - ticks[0] > 1.0 * NS_PER_S


@pytest.mark.real_time
def test_a_mission_is_flown_to_its_end_while_the_wall_clock_is_set(
    wall: WallClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started, ended = threading.Event(), threading.Event()

    class Started(ClockWatch):
        def __init__(self) -> None:
            super().__init__()
            started.set()

    def set_the_clock() -> None:
        started.wait()
        for step_s in STEPS_S:
            if ended.wait(0.4):
                return
            wall.set_by_ns += int(step_s * NS_PER_S)

    monkeypatch.setattr("gcs.service.service.ClockWatch", Started)
    setter = threading.Thread(target=set_the_clock, daemon=True)
    setter.start()
    folder = tmp_path / "run"
    options = DemoOptions(str(short_mission(tmp_path)), 1, SPEED, None, 0.0, 4, True, False, folder)
    try:
        with (tmp_path / "lines").open("w") as lines, DemoSimulation(options) as simulation:
            code = run_demo(simulation, Console(file=lines, width=200))
    finally:
        started.set()
        ended.set()
        setter.join()
    assert code == 0, (tmp_path / "lines").read_text()[-3000:]
    records = [(record.t_ns, record.value) for record in read(folder)]
    assert sum(isinstance(value, ClockStep) for _, value in records) == len(STEPS_S)
    assert not [value for _, value in records if isinstance(value, AgentStatus) and value.status == "lost"]
    assert sum(isinstance(value, MissionEnded) for _, value in records) == 1
    plans = [value for _, value in records if isinstance(value, Plan)]
    assert not [plan for plan in plans[1:] if plan.changed], "a step of the clock re-tasks no agent"
    beats: dict[str, list[int]] = {}
    for t_ns, value in records:
        if isinstance(value, Send) and any(frame.message_id == 0 for frame in scan(value.data).frames):
            beats.setdefault(value.peer, []).append(t_ns)
    assert len(beats) == 4
    for times_ns in beats.values():
        assert max(later - earlier for earlier, later in pairwise(times_ns)) <= 1.2 * NS_PER_S


@pytest.mark.parametrize("step_s", [-3600.0, -20.0, 20.0, 3600.0])
def test_preflight_judges_scans_by_the_run_clock(monkeypatch: pytest.MonkeyPatch, step_s: float) -> None:
    config, key = load("prescribed"), scan_key("prescribed", "radar")
    now_ns, listener = time.time_ns(), ScanListener(config, None)
    scan = Scan(
        0,
        now_ns,
        Sensor("radar", 0.9, 1e-6, read_only([[25.0, 0.0], [0.0, 25.0]]), (0.0, 0.0, 2000.0, 2000.0)),
        read_only([[100.0, 100.0]]),
    )
    payload = encode_scan(scan, config.local_frame)
    monkeypatch.setattr(time, "time_ns", lambda: now_ns + int(step_s * NS_PER_S))
    listener._on_scan(key, payload)
    (check,) = sensor_checks(listener.scans, listener.problems, 1.0)
    assert check.level == "ok", check.row


def test_preflight_warns_of_a_clock_that_was_set_during_the_checks(
    wall: WallClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    setter = threading.Timer(0.5, setattr, (wall, "set_by_ns", -20 * NS_PER_S))
    setter.start()
    with (tmp_path / "lines").open("w") as lines:
        run_preflight(
            "prescribed",
            Console(file=lines),
            wait_s=2.0,
            link="udpin:127.0.0.1:0",
            sensors=False,
            brief=False,
            seed=1,
            as_json=True,
        )
    setter.join()
    checks = json.loads(capsys.readouterr().out)["checks"]
    (clock,) = [check for check in checks if check["code"] == "clock-set"]
    assert clock["level"] == "warning"
    assert clock["parameters"]["step_s"] == pytest.approx(-20.0, abs=0.1)
