"""A run is an asset: what was recorded comes back exactly."""

import json
import tracemalloc
from pathlib import Path

import pytest
from helpers.recorded import CONFIG, VERSIONS, frames, texts, whole

from gcs.errors import RecordingError
from gcs.io.recording.folder import Run
from gcs.io.recording.reader import read, read_info
from gcs.io.recording.recorder import Recorder
from gcs.io.recording.topics import TOPICS, Recordable
from gcs.model import Datagram, Notice, NoticeCode, Scan, Tick


def test_everything_comes_back_in_the_order_of_consumption(recording: tuple[Path, list[Recordable]]) -> None:
    folder, values = recording
    records = list(read(folder))
    assert [type(r.value) for r in records] == [type(value) for value in values]
    assert texts(whole(records)) == texts(values)
    assert [r.sequence for r in records] == list(range(len(values)))
    assert {type(value) for value in values} == set(TOPICS)
    scan = next(value for value in whole(records) if isinstance(value, Scan))
    assert scan.z_m.shape == (0, 2)
    assert not scan.z_m.flags.writeable


def test_the_mcap_file_alone_is_enough(recording: tuple[Path, list[Recordable]]) -> None:
    folder, values = recording
    assert len(list(read(folder / "run.mcap"))) == len(values)
    assert read_info(folder / "run.mcap").config_text == CONFIG


def test_the_folder_records_its_run(recording: tuple[Path, list[Recordable]]) -> None:
    folder, _ = recording
    assert (folder / "mission.toml").read_text(encoding="utf-8") == CONFIG
    assert json.loads((folder / "versions.json").read_text()) == VERSIONS
    assert (read_info(folder).config_text, read_info(folder).versions) == (CONFIG, VERSIONS)


def test_the_seed_is_part_of_the_recording(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run", CONFIG, VERSIONS, Run("demo", 2**40)) as recorder:
        recorder.record_event(Tick(1))
    assert read_info(tmp_path / "run").run == Run("demo", 2**40)


def test_a_recording_without_a_seed_has_none(recording: tuple[Path, list[Recordable]]) -> None:
    assert read_info(recording[0]).run is None


def test_a_flight_is_never_overwritten(recording: tuple[Path, list[Recordable]]) -> None:
    folder, values = recording
    with pytest.raises(RecordingError, match="has a recording already"):
        Recorder(folder, CONFIG, VERSIONS)
    assert len(list(read(folder))) == len(values)


def test_a_folder_that_cannot_be_made_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="cannot be written"):
        Recorder(tmp_path / "file" / "run", CONFIG, VERSIONS)


def test_memory_does_not_grow_with_the_run(tmp_path: Path) -> None:
    """A forgotten flush must not gather the run in memory: chunks are written when they are full."""
    with Recorder(tmp_path / "run", CONFIG, VERSIONS) as recorder:
        tracemalloc.start()
        for number in range(6000):
            recorder.record_effect(
                number, Notice(number, NoticeCode.AUTOPILOT_INFO, 1, {"said": "x" * 10_000})
            )
        _, peak_bytes = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak_bytes < 20_000_000  # 60 MB went through


def test_a_closed_recorder_takes_nothing_more(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run", CONFIG, VERSIONS)
    recorder.record_event(Tick(1))
    recorder.close()
    recorder.close()
    recorder.flush()
    with pytest.raises(RecordingError, match="is closed"):
        recorder.record_event(Tick(2))
    assert [record.value for record in read(tmp_path / "run")] == [Tick(1)]


def test_times_outside_the_format_do_not_stop_the_recording(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run", CONFIG, VERSIONS) as recorder:
        recorder.record_event(Datagram(-5, "udp", "x", frames(1, 1)))
    (only,) = list(read(tmp_path / "run"))
    assert only.value == Datagram(-5, "udp", "x", frames(1, 1))
