"""Terminals, pipes and disks stop taking anything in flight: the vehicles do not notice."""

import asyncio
import contextlib
import io
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from helpers.missions import short_mission
from rich.console import Console

from gcs.cli.run_setup import display
from gcs.config import load
from gcs.endpoints import Link, parse_endpoint
from gcs.errors import RecordingError
from gcs.io.background_writer import BackgroundWriter, QueuedText, off_loop
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.recording.folder import Run
from gcs.io.recording.reader import Record, read
from gcs.io.recording.recorder import _FLUSH_PERIOD_S, Recorder
from gcs.io.recording.recorder_thread import _HAND_OVER_PERIOD_S, RecorderThread
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.mavlink.frames.codec import scan
from gcs.model import NS_PER_S, Datagram, Event, MissionEnded, Notice, NoticeCode, Send, Tick
from gcs.service.journal import Journal, JournalSink
from gcs.service.service import Service

GCS = (sys.executable, "-P", "-c", "from gcs.cli import main; main()")
SPEED = 5
SILENT_S = 2.0
"""Run time; a vehicle that was heard more often than this is never lost."""
SPEAKS_S = 3.0
"""Wall time at the end within which each vehicle was heard."""
HEARTBEAT = 0
WORKED_TICKS = 30
GIVE_UP_S = 30.0


class Ticks:
    """Notes when the loop worked a tick, and what was said."""

    def __init__(self) -> None:
        self.t_ns: list[int] = []
        self.notices: list[Notice] = []

    def event(self, event: Event) -> None:
        if isinstance(event, Tick):
            self.t_ns.append(event.t_ns)

    def effect(self, _t_ns: int, effect: object) -> None:
        if isinstance(effect, Notice):
            self.notices.append(effect)

    def has(self, code: NoticeCode, *subjects: str) -> bool:
        return set(self.subjects(code)) >= set(subjects)

    def subjects(self, code: NoticeCode) -> list[object]:
        return [notice.subject for notice in self.notices if notice.code is code]


@pytest.fixture
def service() -> Iterator[Service]:
    config = load("prescribed")
    with ZenohSession(listen=free_endpoint()) as bus:
        links = Links([Link(parse_endpoint("udpin:127.0.0.1:0"))], [1, 2, 3, 4], config.local_frame)
        yield Service(config, 1, links, bus)


@pytest.fixture
def short_stuck_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Report a blocked output after a second."""
    monkeypatch.setattr("gcs.io.background_writer._STUCK_S", 1.0)


class Blocked:
    """An output that takes nothing until it is released."""

    def __init__(self) -> None:
        self._released = threading.Event()
        self.calls, self.gave_up = 0, False

    def __call__(self, *_arguments: object) -> None:
        self.calls += 1
        if not self._released.wait(GIVE_UP_S):
            self.gave_up = True

    def release(self) -> None:
        self._released.set()


def serve(
    service: Service, is_enough: Callable[[Ticks], bool], blocked: Blocked, console: Console | None = None
) -> Ticks:
    """Run a service until it has worked on beside a blocked output, and enough was said of it."""
    ticks = Ticks()
    service.sinks.append(ticks)

    async def work() -> None:
        service.on_notice("test", NoticeCode.LINK_OPEN)
        while not blocked.calls:
            await asyncio.sleep(0.02)
        begun = len(ticks.t_ns)
        while len(ticks.t_ns) < begun + WORKED_TICKS or not is_enough(ticks):
            await asyncio.sleep(0.02)
        blocked.release()

    async def run() -> None:
        stop = asyncio.Event()
        view = display(service, console, speed=1.0, headless=False) if console else contextlib.nullcontext()
        async with view:
            running = asyncio.create_task(service.run(RunClock(), stop))
            await asyncio.wait_for(work(), 60.0)
            stop.set()
            await asyncio.wait_for(running, 20.0)

    asyncio.run(run())
    assert not blocked.gave_up, "the loop waited for the output"
    return ticks


def heartbeats(records: list[Record]) -> list[list[int]]:
    """Return the times of the heartbeats to each vehicle."""
    sent: dict[tuple[str, str], list[int]] = {}
    for record in records:
        value = record.value
        if isinstance(value, Send) and any(f.message_id == HEARTBEAT for f in scan(value.data).frames):
            sent.setdefault((value.link, value.peer), []).append(record.t_ns)
    return list(sent.values())


def gaps_s(records: list[Record]) -> list[float]:
    """Return the seconds of run time between what came from each vehicle; all of them speak to the end."""
    heard: dict[str, list[int]] = {}
    for record in records:
        if isinstance(record.value, Datagram):
            heard.setdefault(record.value.peer, []).append(record.t_ns)
    for times in heard.values():
        assert (records[-1].t_ns - times[-1]) / NS_PER_S / SPEED < SPEAKS_S, "a simulated vehicle stopped"
    return [(b - a) / NS_PER_S for times in heard.values() for a, b in pairwise(times)]


def demo(folder: Path, *arguments: str) -> list[str]:
    mission = str(short_mission(folder.parent))
    command = [*GCS, "demo", mission, "--speed", str(SPEED), "--pack", "4", "--out", str(folder)]
    return [*command, *arguments]


def assert_flown(folder: Path, code: int) -> list[NoticeCode]:
    """Check that the mission was flown and heartbeats went on; return what is said of the view."""
    records = list(read(folder))
    values = [record.value for record in records]
    last_tenth_ns = records[-1].t_ns - (records[-1].t_ns - records[0].t_ns) // 10
    assert [times[-1] > last_tenth_ns for times in heartbeats(records)] == [True] * 4
    assert [value for value in values if isinstance(value, MissionEnded)]
    longest_s = max(gaps_s(records))
    if code != 0:
        assert code == 1
        assert longest_s > SILENT_S, "a vehicle was lost though its simulation had its share of the processor"
    return [value.code for value in values if isinstance(value, Notice) and value.subject == "view"]


# ---------------------------------------------------------------- whole missions, as a user runs them


@pytest.mark.real_time
def test_an_unread_terminal_loses_frames_and_nothing_else(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "120", "LINES": "40"}
    process = subprocess.Popen(
        demo(tmp_path / "run"), stdin=theirs, stdout=theirs, stderr=theirs, env=environment
    )
    try:
        code = process.wait(110.0)
    finally:
        process.kill()
        os.close(ours)
        os.close(theirs)
    (said,) = assert_flown(tmp_path / "run", code)
    assert said is NoticeCode.OUTPUT_BLOCKED


@pytest.mark.real_time
def test_a_pipe_that_is_closed_is_an_alarm_and_the_mission_is_flown_to_its_end(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}  # and what it lacks ends nothing either
    command = demo(tmp_path / "run", "--headless")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment)
    assert process.stdout is not None
    try:
        line = next(line for line in process.stdout if b"first plan" in line)
        process.stdout.close()
        code = process.wait(110.0)
    finally:
        process.kill()
    assert b"1 -> " in line
    (said,) = assert_flown(tmp_path / "run", code)
    assert said is NoticeCode.OUTPUT_ENDED


@pytest.mark.real_time
def test_a_terminal_that_hangs_up_is_an_alarm_and_the_mission_is_flown_to_its_end(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    process = subprocess.Popen(
        demo(tmp_path / "run"),
        stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
        env={**os.environ, "TERM": "xterm"},
    )  # fmt: skip
    os.close(theirs)
    try:
        shown = b""
        while b"Agents" not in shown:
            shown += os.read(ours, 65536)
        process.send_signal(signal.SIGHUP)
        os.close(ours)
        code = process.wait(110.0)
    finally:
        process.kill()
    (said,) = assert_flown(tmp_path / "run", code)
    assert said is NoticeCode.OUTPUT_ENDED


# ---------------------------------------------------------------- the loop alone, with one output that stops


def fill(terminal: int) -> None:
    """Write to a terminal until it takes no more."""
    os.set_blocking(terminal, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(terminal, b"." * 512)
    os.set_blocking(terminal, True)


@pytest.mark.usefixtures("short_stuck_time")
def test_an_unread_live_view_does_not_delay_ticks(service: Service) -> None:
    ours, theirs = os.openpty()
    fill(theirs)
    with open(theirs, "w") as terminal:  # noqa: PTH123  a descriptor
        console = Console(
            file=terminal, force_terminal=True, width=120, height=40, _environ={"TERM": "xterm"}
        )
        with off_loop(console) as view:
            service.outputs.append(view.writer)
            blocked = Blocked()
            blocked.calls = 1  # the terminal is full from the start
            ticks = serve(service, lambda seen: seen.has(NoticeCode.OUTPUT_BLOCKED, "view"), blocked, console)
            os.read(ours, 4096)  # lets the end be written
            assert not view.writer.is_idle
            threading.Thread(target=read_all, args=(ours,), daemon=True).start()
    assert ticks.subjects(NoticeCode.OUTPUT_BLOCKED) == ["view"]


def read_all(descriptor: int) -> None:
    with contextlib.suppress(OSError):
        while os.read(descriptor, 65536):
            pass


@pytest.mark.usefixtures("short_stuck_time")
def test_a_disk_that_blocks_does_not_delay_ticks_and_nothing_is_missing(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = Blocked()
    monkeypatch.setattr("gcs.io.recording.part.RecordingPart.flush", blocked)
    monkeypatch.setattr("gcs.service.journal.os.fsync", blocked)
    with RecorderThread(Recorder(tmp_path / "run", "", {}, Run("prescribed", 1))) as recorder:
        keeper = JournalSink(service, Journal(tmp_path / "m.journal", "m", ""))
        service.recorder = recorder
        service.outputs += [recorder.writer, keeper.writer]
        service.sinks.append(keeper)
        ticks = serve(
            service, lambda seen: seen.has(NoticeCode.DISK_BLOCKED, "recording", "journal"), blocked
        )
    recorded = [record.value for record in read(tmp_path / "run")]
    assert [value.t_ns for value in recorded if isinstance(value, Tick)] == ticks.t_ns


@pytest.mark.real_time
def test_a_disk_that_blocks_for_long_ends_the_recording_and_not_the_flight(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = Blocked()
    monkeypatch.setattr("gcs.io.recording.part.RecordingPart.flush", blocked)
    monkeypatch.setattr("gcs.io.recording.recorder_thread._MAX_WAITING_RECORDS", 20)
    service.recorder = recorder = RecorderThread(Recorder(tmp_path / "run", "", {}))
    service.outputs.append(recorder.writer)
    ticks = serve(service, lambda seen: any(one.level == "alarm" for one in seen.notices), blocked)
    recorder.close()
    (alarm,) = [notice for notice in ticks.notices if notice.level == "alarm"]
    assert alarm.code is NoticeCode.RECORDING_ENDED
    assert "the disk blocks" in alarm.parameters["problem"]


@pytest.mark.usefixtures("short_stuck_time")
def test_a_subscriber_that_does_not_read_does_not_delay_ticks(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = Blocked()
    monkeypatch.setattr(ZenohSession, "publish", blocked)
    serve(service, lambda seen: seen.has(NoticeCode.OUTPUT_BLOCKED, "zenoh"), blocked)


@pytest.mark.real_time
def test_after_a_crash_at_most_a_second_is_missing(tmp_path: Path) -> None:
    code = """
import sys, time
from pathlib import Path
from gcs.io.recording.recorder import _FLUSH_PERIOD_S, Recorder
from gcs.io.recording.recorder_thread import _HAND_OVER_PERIOD_S, RecorderThread
from gcs.model import Tick
recorder = RecorderThread(Recorder(Path(sys.argv[1]), "", {}))
for number in range(1_000_000):
    recorder.record_event(Tick(number))
    print(number, flush=True)
    time.sleep(0.01)
"""
    command = [sys.executable, "-P", "-c", code, str(tmp_path / "run")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        recorded = int(process.stdout.readline())
        for _ in range(3):
            recorded = next(n for n in map(int, process.stdout) if n > recorded + 20)
            while last_tick(tmp_path / "run") < recorded:
                process.stdout.readline()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    assert last_tick(tmp_path / "run") >= recorded
    assert _FLUSH_PERIOD_S + _HAND_OVER_PERIOD_S < 1.0


def last_tick(run: Path) -> int:
    """Return the last tick that is on the disk, -1 for none."""
    with contextlib.suppress(RecordingError):
        return max((r.value.t_ns for r in read(run) if isinstance(r.value, Tick)), default=-1)
    return -1


# ---------------------------------------------------------------- one writer


class Panic(BaseException):
    """As a library of Rust raises it."""


def test_a_panic_in_a_job_is_told_and_ends_that_output_only() -> None:
    """The thread ended: nothing more was written, and the notice said that a viewer was slow."""

    def job() -> None:
        raise Panic("no shared memory")

    writer = BackgroundWriter("x", 2)
    writer.put(job)
    assert writer.drain(5.0)
    assert writer.notice() == (NoticeCode.OUTPUT_ENDED, {"cause": "no shared memory"})
    assert writer.put(lambda: None) is False


def test_a_full_writer_refuses_and_an_error_ends_it() -> None:
    released, done = threading.Event(), []
    writer = BackgroundWriter("x", 2)
    assert writer.put(released.wait)
    assert writer.put(lambda: done.append(1))
    assert not writer.put(lambda: done.append(2))
    released.set()
    assert writer.drain(10.0)
    assert (done, writer.dropped) == ([1], 1)

    def fail() -> None:
        raise BrokenPipeError(32, "Broken pipe")

    writer.put(fail)
    assert writer.drain(10.0)
    assert not writer.put(lambda: done.append(3))
    assert writer.notice() == (NoticeCode.OUTPUT_ENDED, {"cause": "Broken pipe"})
    assert writer.notice() is None


def test_what_an_encoding_lacks_is_written_in_ascii() -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    read_end, write_end = os.pipe()
    stream.fileno = lambda: write_end  # type: ignore[method-assign]
    text = QueuedText(stream)
    text.write("1 → 2.3 – ☃\n")
    assert text.writer.drain(10.0)
    assert os.read(read_end, 100) == b"1 -> 2.3 - ?\n"


def test_a_recording_that_fails_is_reported_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_arguments: object) -> None:
        raise OSError(28, "No space left on device")

    recorder = RecorderThread(Recorder(tmp_path / "run", "", {}))
    monkeypatch.setattr("gcs.io.recording.part.RecordingPart.add", full)
    recorder.record_event(Tick(1))
    with pytest.raises(RecordingError, match="No space left"):
        recorder.close()
    recorder.close()
