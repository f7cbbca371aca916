"""A long run is split into files, and read as one."""

from pathlib import Path

import pytest
from helpers.recorded import CONFIG, EVENTS, VERSIONS, in_parts, texts, whole
from mcap.reader import make_reader

from gcs.errors import RecordingError
from gcs.io.recording.mcap_file import mcap_paths, recording_bytes
from gcs.io.recording.reader import Damage, read, read_info
from gcs.io.recording.recorder import Recorder
from gcs.io.recording.tlog import LogFrame, read_log


def test_a_long_run_is_split_and_read_as_one(tmp_path: Path) -> None:
    values = in_parts(tmp_path / "run", 60, 30_000)
    parts = mcap_paths(tmp_path / "run")
    assert [path.name for path in parts[:3]] == ["run.mcap", "run-002.mcap", "run-003.mcap"]
    records = list(read(tmp_path / "run"))
    assert texts(whole(records)) == texts(values)
    assert [r.sequence for r in records] == list(range(len(values)))
    assert recording_bytes(tmp_path / "run") == sum(path.stat().st_size for path in parts)


def test_each_part_is_whole_in_itself(tmp_path: Path) -> None:
    values = in_parts(tmp_path / "run", 60, 30_000)
    total = 0
    for path in mcap_paths(tmp_path / "run"):
        alone = list(read(path))
        assert not any(isinstance(r.value, Damage) for r in alone)
        assert isinstance(alone[0].value, EVENTS)
        assert read_info(path) == read_info(tmp_path / "run")
        with path.open("rb") as file:
            summary = make_reader(file, validate_crcs=True).get_summary()
        assert summary is not None
        assert summary.statistics.message_count == len(alone)
        total += len(alone)
    assert total == len(values)
    logs = sorted((tmp_path / "run").glob("link*.tlog"))
    assert len(logs) == len(mcap_paths(tmp_path / "run")) > 2
    frames_logged = sum(isinstance(part, LogFrame) for log in logs for part in read_log(log.open("rb")))
    assert frames_logged == 60 * 4


def test_a_part_that_is_missing_or_damaged_ends_the_reading_and_is_named(tmp_path: Path) -> None:
    values = in_parts(tmp_path / "run", 60, 30_000)
    parts = mcap_paths(tmp_path / "run")
    second = len(list(read(parts[0])))
    data = parts[1].read_bytes()
    parts[1].write_bytes(data[: len(data) // 2])
    *records, last = list(read(tmp_path / "run"))
    assert isinstance(last.value, Damage)
    assert last.value.file == "run-002.mcap"
    assert "run-002.mcap, part 2 of" in last.value.problem
    assert second < len(records) < len(values)
    parts[1].unlink()
    *records, last = list(read(tmp_path / "run"))
    assert isinstance(last.value, Damage)
    assert "records are missing" in last.value.problem
    assert len(records) == second
    parts[0].unlink()
    with pytest.raises(RecordingError, match=r"run\.mcap: cannot be read"):
        list(read(tmp_path / "run"))
    with pytest.raises(RecordingError, match="has a recording already"):
        Recorder(tmp_path / "run", CONFIG, VERSIONS)
