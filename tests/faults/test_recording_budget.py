"""A recording fills no disk, survives its folder, is private to its owner, and blocks no start."""

import os
import re
import shutil
import stat
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console

from gcs.cli.fly.live_service import RunStorage, serve
from gcs.cli.run_setup import open_recorder
from gcs.config import load, read_text
from gcs.config.schema import RecordingTable
from gcs.endpoints import Link, parse_endpoint
from gcs.errors import JournalError, LinkError, RecordingError
from gcs.io.clock import RunClock
from gcs.io.links.garbage import GarbageFilter
from gcs.io.links.manager import Links
from gcs.io.recording.folder import Run
from gcs.io.recording.reader import Damage, read
from gcs.io.recording.recorder import DiskBudget, Recorder
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.model import NS_PER_S, Datagram, Notice, NoticeCode, Parameter, Snapshot, Tick
from gcs.service.journal import Journal
from gcs.service.resume import resume_from_journal
from gcs.service.service import Service

WRITTEN = Snapshot(1, b"the state")
RNG = np.random.default_rng(5)


def heartbeat() -> bytes:
    return Encoder(1, 1)(mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3))


def test_a_flood_of_garbage_leaves_all_frames_and_a_sample() -> None:
    gate, kept, frames = GarbageFilter(), 0, 0
    for number in range(6_000):  # ten minutes of 14 kB/s
        t_ns = number * NS_PER_S // 10
        noise = RNG.bytes(1400)
        for data, good in ((noise, b""), (noise[:700] + heartbeat() + noise[700:], heartbeat())):
            taken = gate.filter_datagram(t_ns, "udp", scan(data)).data
            assert good[-12:-2] in taken or not good
            frames += heartbeat()[:1] in taken and bool(good)
            kept += len(taken)
    assert frames == 6_000
    assert kept < 65_536 + 600 * 2_000 + 6_000 * 30
    assert kept > 600_000
    ((link, dropped),) = gate.take_dropped(600 * NS_PER_S).items()
    assert link == "udp"
    assert dropped > 10_000_000
    assert gate.take_dropped(600 * NS_PER_S) == {}


def test_frames_alone_pass_as_they_came() -> None:
    gate = GarbageFilter()
    unknown = b"\xfd\x00\x00\x00\x00\x01\x01\xff\xff\x0f\x00\x00"
    for data in (heartbeat(), heartbeat() * 3, unknown, heartbeat() + unknown):
        frames = scan(data)
        for _ in range(10_000):
            assert gate.filter_datagram(0, "udp", frames) is frames
    assert gate.take_dropped(0) == {}


def test_the_processed_events_are_the_recorded_ones() -> None:
    config = load("prescribed")
    here = [Link(parse_endpoint("udpin:127.0.0.1:0"))]
    with ZenohSession(listen=free_endpoint()) as bus:
        links = Links(here, [1], config.local_frame)
        service = Service(config, 1, links, bus)
        for _ in range(1000):
            service.on_datagram("udp", "a:1", scan(RNG.bytes(1400)))
        service.on_datagram("udp", "a:1", scan(heartbeat()))
        links.close()
        queued = [service._queue.get_nowait() for _ in range(service._queue.qsize())]
    taken = [event.data for event, _ in queued if isinstance(event, Datagram)]
    assert taken[-1] == heartbeat()
    assert 10 < len(taken) < 60


def filled(folder: Path, budget: DiskBudget, notices: list[NoticeCode]) -> tuple[str, int]:
    """Record until the budget is used up; return why it ended and how many records there were."""
    recorder = Recorder(folder, "name = 'x'", {}, None, budget)
    recorder.notify = lambda code, **_: notices.append(code)
    for number in range(10_000):
        try:
            recorder.record_event(Datagram(number, "udp", "a:1", RNG.bytes(1000)))
            recorder.flush()
        except RecordingError as error:
            return str(error), number
    return "", 10_000


def test_a_budget_ends_the_recording_in_order_and_deletes_nothing(tmp_path: Path) -> None:
    notices: list[NoticeCode] = []
    problem, count = filled(tmp_path / "run", DiskBudget(300_000, 2e6), notices)
    assert "recording.max_gb" in problem
    assert notices == [NoticeCode.DISK_LOW]
    size = sum(path.stat().st_size for path in (tmp_path / "run").iterdir())
    assert 1.9e6 < size < 2.2e6
    assert (tmp_path / "run" / "run-003.mcap").exists()
    records = list(read(tmp_path / "run"))
    assert not any(isinstance(record.value, Damage) for record in records)
    assert len(records) == count + 1


def test_a_disk_keeps_space_for_the_journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notices: list[str] = []
    left = iter(range(5_000_000_000, 0, -100_000_000))

    class Disk:
        f_frsize = 1

        @property
        def f_bavail(self) -> int:
            return next(left)

    monkeypatch.setattr(os, "statvfs", lambda _: Disk())
    problem, count = filled(tmp_path / "run", DiskBudget(min_free_bytes=200e6), notices)
    assert "recording.min_free_mb" in problem
    assert len(notices) == 1
    assert 40 < count < 60
    journal = Journal(tmp_path / "x.journal", "x", "y")
    journal.write(WRITTEN)
    assert journal.read() is not None


def test_the_alarm_of_low_disk_space_ends_when_the_disk_is_cleared(tmp_path, monkeypatch) -> None:
    notices: list[Notice] = []
    disk = SimpleNamespace(f_frsize=1, f_bavail=0)
    monkeypatch.setattr(os, "statvfs", lambda _: disk)
    with Recorder(tmp_path / "run", "name = 'x'", {}, None, DiskBudget(min_free_bytes=200e6)) as recorder:
        recorder.notify = lambda code, **parameters: notices.append(Notice(0, code, "recording", parameters))
        for number, free in enumerate((5_000_000_000, 900_000_000, 800_000_000, 5_000_000_000)):
            disk.f_bavail = free
            recorder.record_event(Datagram(number, "udp", "a:1", b"x"))
            recorder.flush()
    low, over = notices
    assert (low.code, low.level) == (NoticeCode.DISK_LOW, "alarm")
    assert low.key in over.ended


@pytest.mark.parametrize("how", ["deleted", "moved"])
def test_a_recording_whose_folder_goes_away_goes_on_in_another(tmp_path: Path, how: str) -> None:
    notices: list[NoticeCode] = []
    folder = tmp_path / "run"
    with Recorder(folder, "name = 'x'", {}, Run("x", 1)) as recorder:
        recorder.notify = lambda code, **_: notices.append(code)
        for number in range(100):
            recorder.record_event(Tick(number))
        recorder.flush()
        if how == "deleted":
            shutil.rmtree(folder)
        else:
            folder.rename(tmp_path / "aside")
            folder.mkdir()
        for number in range(100, 200):
            recorder.record_event(Tick(number))
        recorder.flush()
    assert recorder.folder == (folder if how == "deleted" else tmp_path / "run-2")
    assert notices == [NoticeCode.RECORDING_MOVED]
    assert [record.t_ns for record in read(recorder.folder)] == [*range(100, 200)]
    if how == "moved":
        assert len([1 for record in read(tmp_path / "aside") if isinstance(record.value, Tick)]) == 100


def test_recordings_and_journals_are_their_owners_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = os.umask(0)
    try:
        with open_recorder(None, "x", "name = 'x'", Run("x", 1), RecordingTable()) as recorder:
            recorder.record_event(Tick(1))
        Journal(Path("runs") / "x.journal", "x", "y").write(WRITTEN)
    finally:
        os.umask(before)
    assert len(list(recorder.folder.iterdir())) == 4
    for path in (Path("runs"), *Path("runs").rglob("*")):
        expected = 0o700 if path.is_dir() else 0o600
        assert stat.S_IMODE(path.stat().st_mode) == expected, path


def test_a_start_that_fails_leaves_no_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "flight"
    monkeypatch.setattr("gcs.cli.fly.live_service.warm_up", lambda *_: None)
    mission = tmp_path / "m.toml"
    text, _ = read_text("prescribed")
    taken = Links([Link(parse_endpoint("udpin:127.0.0.1:0"))], [1], load("prescribed").local_frame)
    mission.write_text(re.sub(r'"udpin:[^"]*"', f'"udpin:127.0.0.1:{taken.port}"', text, count=1))

    def start() -> None:
        serve(
            str(mission),
            1,
            Console(quiet=True),
            headless=True,
            storage=RunStorage(recording=out, journal=None, resume=None),
            clock=RunClock(),
        )

    for _ in range(2):
        with pytest.raises(LinkError):
            start()
        assert not out.exists()
    out.mkdir()
    (out / "mission.toml").write_text("mine")
    with pytest.raises(LinkError):
        start()
    assert [path.name for path in out.iterdir()] == ["mission.toml"]
    taken.close()


def test_a_damaged_journal_is_an_alarm_with_a_remedy(tmp_path: Path) -> None:
    path = tmp_path / "x.journal"
    path.write_bytes(b"nothing of ours\n")
    journal, news = Journal(path, "x", "y"), []

    class Started:
        def on_notice(self, subject: str, code: NoticeCode, /, **parameters: Parameter) -> None:
            news.append(Notice(0, code, subject, parameters))

    resume_from_journal(Started(), journal, None, 0, Console(quiet=True))  # type: ignore[arg-type]
    (notice,) = news
    assert (notice.code, notice.subject) == (NoticeCode.JOURNAL_REFUSED, "journal")
    assert "damaged" in notice.parameters["problem"]
    with pytest.raises(JournalError, match=r"damaged.*--no-resume"):
        resume_from_journal(Started(), journal, True, 0, Console(quiet=True))  # type: ignore[arg-type]
