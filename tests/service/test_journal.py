"""A journal that is damaged, hostile or another's must cost no more than a clean start."""

from __future__ import annotations

from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rich.console import Console

from gcs.config import load, read_text
from gcs.config.key_overrides import override_keys
from gcs.core.engine import Engine
from gcs.core.snapshot import decode_state, encode_state
from gcs.core.state import State
from gcs.errors import JournalError
from gcs.model import NS_PER_S, Event, NoticeCode, Parameter, Snapshot, Tick
from gcs.service.journal import Journal, JournalSink, fingerprint
from gcs.service.resume import resume_from_journal
from gcs.service.service import Service
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import parse_scenario

MINE = fingerprint("name = 'm'", 1)
WRITTEN = Snapshot(7, encode_state(Engine(load("prescribed"), 1).state))


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    return Journal(tmp_path / "runs" / "m.journal", "m", MINE)


def test_what_was_written_is_read_and_nothing_else_lies_about(journal: Journal) -> None:
    assert journal.read() is None
    journal.write(WRITTEN)
    journal.write(WRITTEN)
    assert journal.read() == WRITTEN
    assert [path.name for path in journal.path.parent.iterdir()] == ["m.journal"]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda d: b"", "damaged"),
        (lambda d: d[: len(d) // 2], "checksum"),
        (lambda d: d[:-3], "checksum"),
        (lambda d: d.replace(b"active", b"lost!!"), "checksum"),
        (lambda d: d.replace(b'"journal":4', b'"journal":3'), "version 3"),
        (lambda d: b"[" * 100_000, "damaged"),
        (lambda d: b"\xff\xfe" + d, "damaged"),
    ],
)
def test_damage_is_named(journal: Journal, spoil, words: str) -> None:
    journal.write(WRITTEN)
    journal.path.write_bytes(spoil(journal.path.read_bytes()))
    with pytest.raises(JournalError, match=words):
        journal.read()


def test_an_upload_that_began_after_its_plan_is_in_the_journal_at_once(
    journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a restart its mission would be taken for another station's, and the vehicle suspended.

    The plan and the upload of one event are written once: with hundreds of vehicles each takes some 10 ms.
    """
    written: list[Snapshot] = []
    counts = [0]
    monkeypatch.setattr("gcs.io.background_writer.BackgroundWriter.put", lambda _, job: job() or True)
    monkeypatch.setattr(journal, "write", written.append)

    def on_event(event: Event) -> None:
        sink.event(event)
        counts.append(len(written))
        assert counts[-1] - counts[-2] <= 1
        if isinstance(event, Tick):
            saved = decode_state("the journal", written[-1].data)
            assert saved.tasking.uploads.keys() >= run.engine.state.tasking.uploads.keys()

    text, source = read_text("prescribed")
    scenario = parse_scenario(override_keys(text, ["links.max_parallel_uploads=1"], source), source)
    run = VirtualRun(scenario, 1, on_event, lambda t_ns, effect: sink.effect(t_ns, effect))
    sink = JournalSink(SimpleNamespace(engine=run.engine), journal)  # type: ignore[arg-type]
    run.run(10.0)
    assert len(written) > 4


class Started:
    """A service that was made, and not run yet."""

    def __init__(self) -> None:
        self.engine = Engine(load("prescribed"), 1)
        self.config = self.engine.config
        self.notices: list[NoticeCode] = []

    resume = Service.resume

    def on_notice(self, _subject: str, code: NoticeCode, /, **_parameters: Parameter) -> None:
        self.notices.append(code)


def damaged() -> bytes:
    state = Engine(load("prescribed"), 1).state
    state.perception.trackers.targets.filter.scans = -1
    return encode_state(state)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x82",
        WRITTEN.data[:-1],
        encode_state(State.initial([1, 2])),
        encode_state(Engine(load("swarm-50"), 1).state),
        damaged(),
    ],
    ids=["empty", "cut", "short", "two vehicles", "fifty vehicles", "damaged tracker"],
)
def test_a_journal_with_a_right_checksum_may_still_make_no_sense(journal: Journal, data: bytes) -> None:
    journal.write(Snapshot(7, data))
    service = Started()
    with pytest.raises(JournalError, match="--no-resume"):
        resume_from_journal(service, journal, True, 8, Console(quiet=True))  # type: ignore[arg-type]
    resume_from_journal(service, journal, None, 8, Console(quiet=True))  # type: ignore[arg-type]
    assert service.notices == [NoticeCode.JOURNAL_REFUSED]
    assert service.engine.state.agents.keys() == {1, 2, 3, 4}
    service.engine.step(Tick(9))


def test_another_mission_file_or_seed_is_reported(journal: Journal) -> None:
    journal.write(WRITTEN)
    other = Journal(journal.path, "m", fingerprint("name = 'm'", 2))
    with pytest.raises(JournalError, match="another mission file or seed"):
        other.read()


def test_a_journal_that_cannot_be_written_is_an_error_and_the_old_one_stays(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(JournalError, match="cannot be written"):
        Journal(tmp_path / "file" / "m.journal", "m", MINE).write(WRITTEN)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(st.integers(0, 10**6), st.binary(min_size=1, max_size=8))
def test_any_change_of_bytes_is_an_error_of_ours_or_changes_nothing(
    journal: Journal, place: int, junk: bytes
) -> None:
    journal.write(WRITTEN)
    data = journal.path.read_bytes()
    place %= len(data)
    journal.path.write_bytes(data[:place] + junk + data[place + len(junk) :])
    try:
        found = journal.read()
    except JournalError:
        return
    assert found == WRITTEN


def test_a_mission_that_has_ended_is_not_resumed_and_the_operator_is_told(journal: Journal) -> None:
    """Vehicles that have arrived get new tasks, which an operator does not expect of a restart."""
    state = Engine(load("prescribed"), 1).state
    state.has_ended = True
    journal.write(Snapshot(7, encode_state(state)))
    for now_ns, is_told in ((8, True), (7 + 3600 * NS_PER_S, False)):
        service, output = Started(), StringIO()
        resume_from_journal(service, journal, None, now_ns, Console(file=output))  # type: ignore[arg-type]
        assert not service.engine.state.has_ended
        assert ("has ended: a new one begins" in output.getvalue()) is is_told
