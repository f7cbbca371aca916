"""A replay from the middle would begin at another place, or read the whole recording before."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from helpers.recorded import CONFIG, T0_NS, VERSIONS, a_run, record

from gcs.io.recording.folder import MCAP_NAME, Run
from gcs.io.recording.index import snapshot_places
from gcs.io.recording.reader import Damage, read
from gcs.io.recording.recorder import DiskBudget, Recorder
from gcs.model import NS_PER_S, Event, Snapshot, Tick

SECONDS = 30


@pytest.fixture(params=["one part", "several parts"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    budget = DiskBudget(rotate_bytes=40_000) if request.param == "several parts" else DiskBudget()
    with Recorder(tmp_path / "run", CONFIG, VERSIONS, Run("demo", 1), budget) as recorder:
        for _, steps in itertools.groupby(a_run(SECONDS), key=lambda one: one[0] // NS_PER_S):
            record(recorder, steps)
            recorder.flush()
    parts = len(list((tmp_path / "run").glob("*.mcap")))
    assert (parts > 2) is (request.param == "several parts")
    return tmp_path / "run"


def test_every_snapshot_is_found_at_its_time(folder: Path) -> None:
    places = snapshot_places(folder)
    assert [place.t_ns for place in places] == [T0_NS + second * NS_PER_S for second in range(SECONDS)]
    assert [place.part for place in places] == sorted(place.part for place in places)


def test_a_reader_that_starts_at_a_snapshot_reads_it_and_all_that_follows(folder: Path) -> None:
    whole = [(record.sequence, record.payload) for record in read(folder)]
    for place in snapshot_places(folder):
        records = list(read(folder, start=place))
        assert isinstance(records[0].value, Snapshot)
        assert records[0].t_ns == place.t_ns
        assert [(one.sequence, one.payload) for one in records] == whole[-len(records) :]


def test_a_start_counts_also_where_other_records_alone_are_asked_for(folder: Path) -> None:
    place = snapshot_places(folder)[4]
    values = [record.value for record in read(folder, only=(Tick,), start=place)]
    assert isinstance(values[0], Snapshot)
    assert [type(value) for value in values if isinstance(value, Event)] == [Tick] * (SECONDS - 5)


def test_a_recording_that_was_cut_off_has_its_snapshots_up_to_there(folder: Path) -> None:
    path = folder / MCAP_NAME
    found = [place for place in snapshot_places(folder) if place.part == 0]
    data = path.read_bytes()
    for end in range(0, len(data), 997):
        path.write_bytes(data[:end])
        if end < 8:
            continue
        left = snapshot_places(path)
        assert left == tuple(found[: len(left)])
        for place in left[-1:]:
            values = [record.value for record in read(path, start=place)]
            assert isinstance(values[0], Snapshot | Damage)
            assert isinstance(values[-1], Damage)


@pytest.mark.parametrize("step", [13, 101])
def test_damaged_bytes_cost_snapshots_and_nothing_else(folder: Path, step: int) -> None:
    path = folder / MCAP_NAME
    data = path.read_bytes()
    for at in range(8, len(data), len(data) // step):
        path.write_bytes(data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :])
        for place in snapshot_places(path)[:3]:
            list(itertools.islice(read(path, start=place), 50))
