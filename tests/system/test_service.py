"""The service around the engine: failures are alarms, delays are notices."""

import asyncio
import errno
import time
from collections.abc import Iterator
from itertools import pairwise
from types import SimpleNamespace

import pytest

from gcs.config import load
from gcs.core.engine import Engine
from gcs.core.snapshot import encode_state
from gcs.endpoints import Link, parse_endpoint
from gcs.errors import LinkError, RecordingError
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.recording.reader import read
from gcs.io.recording.recorder import Recorder
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import NS_PER_S, Notice, NoticeCode, Snapshot, Tick, Truth
from gcs.service.journal import Journal, JournalSink
from gcs.service.service import Service


def loopback(port: int = 0) -> Links:
    link = Link(parse_endpoint(f"udpin:127.0.0.1:{port}"))
    return Links([link], [1, 2, 3, 4], load("prescribed").local_frame)


class Sink:
    """Keeps what it is given; may be slow or broken."""

    def __init__(self, *, slow_s=0.0, error=None):
        self.events, self.effects = [], []
        self._slow_s, self._error = slow_s, error

    def event(self, event):
        time.sleep(self._slow_s)
        if self._error is not None:
            raise self._error
        self.events.append(event)

    def effect(self, t_ns, effect):
        self.effects.append(effect)


@pytest.fixture
def service() -> Iterator[Service]:
    with ZenohSession(listen=free_endpoint()) as bus:
        yield Service(load("prescribed"), 1, loopback(), bus)


def told(sink, *codes):
    """The notices with some codes."""
    return [effect for effect in sink.effects if isinstance(effect, Notice) and effect.code in codes]


def serve(service, clock, seconds):
    async def run():
        stop = asyncio.Event()
        asyncio.get_running_loop().call_later(seconds, stop.set)
        await asyncio.wait_for(service.run(clock, stop), 20.0)

    asyncio.run(run())


def now() -> RunClock:
    epoch_ns = time.time_ns()
    return RunClock(epoch_ns, epoch_ns, 1.0)


def test_a_sink_that_fails_ends_the_run_with_its_own_error(service):
    service.sinks.append(Sink(error=RecordingError("run.mcap", "no space left on device")))
    with pytest.raises(RecordingError, match="no space left"):
        serve(service, now(), 10.0)


def test_a_journal_whose_error_shows_in_flight_ends_neither_service_nor_heartbeats(service, monkeypatch):
    """The check on load cannot know every consequence of a changed value."""
    clock, sink = now(), Sink()
    state = Engine(service.config, 1).state
    state.measured_t_ns = 77
    service.resume(Snapshot(clock.now_ns() - 10**9, encode_state(state)), state)
    effects = service.engine.effects

    def failing(event, frames=None):
        if isinstance(event, Tick) and service.engine.state.measured_t_ns == 77:
            raise KeyError(77)
        return effects(event, frames)

    monkeypatch.setattr(service.engine, "effects", failing)
    service.sinks.append(sink)
    serve(service, clock, 2.0)
    (alarm,) = [one for one in sink.effects if isinstance(one, Notice) and one.level == "alarm"]
    assert alarm.code is NoticeCode.JOURNAL_REFUSED
    assert "KeyError(77)" in alarm.parameters["problem"]
    assert service.engine.state.measured_t_ns == 0
    assert sum(isinstance(event, Tick) for event in sink.events) > 10


def test_an_error_long_after_a_restart_does_not_cost_the_state(service, monkeypatch):
    """Before, any later error of the program put an empty state in its place: zones and holds were gone."""
    monkeypatch.setattr("gcs.service.service._PROVEN_NS", NS_PER_S // 2)
    clock = now()
    began_t_ns = clock.now_ns()
    state = Engine(service.config, 1).state
    state.measured_t_ns = 77
    service.resume(Snapshot(began_t_ns - 10**9, encode_state(state)), state)
    effects = service.engine.effects

    def failing(event, frames=None):
        if isinstance(event, Tick) and event.t_ns > began_t_ns + NS_PER_S:
            raise KeyError(99)
        return effects(event, frames)

    monkeypatch.setattr(service.engine, "effects", failing)
    with pytest.raises(ExceptionGroup) as raised:
        serve(service, clock, 5.0)
    assert isinstance(raised.value.exceptions[0], KeyError)
    assert service.engine.state is state


def test_a_program_error_without_a_journal_still_ends_the_run(service, monkeypatch):
    def failing(_event, _frames=None):
        raise KeyError(77)

    monkeypatch.setattr(service.engine, "effects", failing)
    with pytest.raises(ExceptionGroup):
        serve(service, now(), 1.0)


def test_a_full_disk_ends_the_recording_and_not_the_flight(service, tmp_path, monkeypatch):
    def full(_part, _records, _sequence):
        raise OSError(errno.ENOSPC, "No space left on device")

    folder, sink = tmp_path / "run", Sink()
    with Recorder(folder, "", {}) as recorder:
        service.recorder = recorder
        service.sinks.append(sink)
        service.truth(Truth(1, ()))
        recorder.flush()
        monkeypatch.setattr("gcs.io.recording.part.RecordingPart.add", full)
        recorder._flush_at_s = 0.0  # at the next event
        serve(service, now(), 0.5)
        service.truth(Truth(2, ()))
    (notice,) = told(sink, NoticeCode.RECORDING_ENDED)
    assert str(folder) in notice.parameters["problem"]
    assert sum(isinstance(event, Tick) for event in sink.events) > 3
    assert next(record.value for record in read(folder)) == Truth(1, ())


def test_a_journal_that_cannot_be_written_is_reported_once_and_retried(service, tmp_path, monkeypatch):
    in_the_way = tmp_path / "runs"
    in_the_way.write_text("a file where the folder should be")
    notices = []
    monkeypatch.setattr(service, "on_notice", lambda subject, code, **_: notices.append((subject, code)))
    journal = Journal(in_the_way / "m.journal", "m", "")
    keeper = JournalSink(service, journal)
    keeper.write(1)
    keeper.close()
    keeper.write(2)
    keeper.close()
    in_the_way.unlink()
    keeper.write(3)
    keeper.close()
    codes = [NoticeCode.JOURNAL_UNWRITTEN, NoticeCode.JOURNAL_WRITTEN]
    assert notices == [("journal", code) for code in codes]
    snapshot = journal.read()
    assert snapshot is not None
    assert snapshot.t_ns == 3


@pytest.mark.parametrize("waits", [True, False])
def test_ctrl_c_waits_for_an_upload_and_twice_it_names_inconsistent_missions(service, monkeypatch, waits):
    under_way, sink = {3: "2/8"}, Sink()
    service.sinks.append(sink)
    monkeypatch.setattr(type(service.engine.state.tasking), "stages", property(lambda _: under_way))
    monkeypatch.setattr(service.engine.stages.tasking, "may_be_inconsistent", under_way.__contains__)

    async def run():
        loop, stop, at_once = asyncio.get_running_loop(), asyncio.Event(), asyncio.Event()
        loop.call_later(0.1, stop.set)
        loop.call_later(0.4, under_way.clear if waits else at_once.set)
        await asyncio.wait_for(service.run(now(), stop, at_once=at_once), 5.0)

    asyncio.run(run())
    notices = told(sink, NoticeCode.UPLOADS_AWAITED, NoticeCode.UPLOADS_UNFINISHED)
    codes = [NoticeCode.UPLOADS_AWAITED] + ([] if waits else [NoticeCode.UPLOADS_UNFINISHED])
    assert [notice.code for notice in notices] == codes
    assert all(notice.parameters["vehicles"] == (3,) for notice in notices)
    assert sum(isinstance(event, Tick) for event in sink.events) >= 5


def test_ticks_never_pile_up_behind_a_slow_consumer(service):
    slow = Sink(slow_s=0.2)
    service.sinks.append(slow)
    serve(service, now(), 1.5)
    ticks = [event.t_ns for event in slow.events if isinstance(event, Tick)]
    assert 3 <= len(ticks) <= 10
    assert all(later > earlier for earlier, later in pairwise(ticks))


def test_a_machine_that_cannot_keep_up_is_reported_once(service):
    epoch_ns = time.time_ns()
    slow = Sink(slow_s=0.1)
    service.sinks.append(slow)
    serve(service, RunClock(epoch_ns, epoch_ns, 20.0), 1.0)
    (notice,) = told(slow, NoticeCode.SERVICE_SLOW)
    assert "--speed" in notice.parameters["remedy"]
    assert service.health.worst_lag_s * NS_PER_S > 0.5 * NS_PER_S


def test_at_real_time_no_notice_names_an_option_that_gcs_run_lacks(service):
    slow = Sink()
    service.sinks.append(slow)
    service._watch_lag(NS_PER_S)
    (notice,) = told(slow, NoticeCode.SERVICE_SLOW)
    assert "--speed" not in notice.parameters["remedy"]
    assert "telemetry.rate_hz" in notice.parameters["remedy"]


def test_a_vehicle_that_signs_without_a_key_here_is_named_once(service, monkeypatch):
    sink = Sink()
    service.sinks.append(sink)
    monkeypatch.setattr(service.engine.stages.fleet, "is_signed", lambda vehicle: vehicle == 3)
    serve(service, now(), 0.5)
    (notice,) = told(sink, NoticeCode.KEY_MISSING)
    assert notice.vehicle == 3


def test_a_key_is_not_called_missing_before_the_bridge_has_told_its_keys(service, monkeypatch):
    told_of, keyed = [], [None]
    monkeypatch.setattr(service.engine.stages.fleet, "is_signed", lambda vehicle: vehicle == 3)
    monkeypatch.setattr(service.links, "is_keyed", lambda link, vehicle: keyed[0])
    monkeypatch.setattr(service, "_put", lambda news: told_of.append(news.notice.code))
    service._check_keys()
    assert told_of == []
    keyed[0] = False
    service._check_keys()
    assert told_of == [NoticeCode.KEY_MISSING]


def test_a_missing_key_is_told_until_the_vehicle_no_longer_signs(service, monkeypatch):
    signed, told_of, at_ns = {3}, [], [0]
    monkeypatch.setattr(service.engine.stages.fleet, "is_signed", lambda vehicle: vehicle in signed)
    monkeypatch.setattr(service, "clock", SimpleNamespace(now_ns=lambda: at_ns[0]))
    monkeypatch.setattr(service, "_put", lambda news: told_of.append(news.notice))
    for t_s in range(40):
        at_ns[0] = t_s * NS_PER_S
        if t_s in (5, 20):  # one frame without a signature is no end
            signed.clear()
        elif t_s == 6:
            signed.add(3)
        service._check_keys()
    assert [notice.code for notice in told_of] == [NoticeCode.KEY_MISSING, NoticeCode.KEY_NOT_MISSING]
    assert told_of[1].ended == (told_of[0].key,)
    assert told_of[1].t_ns == 30 * NS_PER_S


def test_a_port_that_is_taken_is_named_with_what_to_do(service):
    with pytest.raises(LinkError, match=r"cannot listen here.*links\.mavlink"):
        loopback(service.links.port)
