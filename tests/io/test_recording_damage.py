"""What is cut off or damaged is read up to the break, and the break is said."""

from pathlib import Path

import numpy as np
import pytest
from helpers.recorded import texts, whole
from mcap.reader import make_reader

from gcs.errors import RecordingError
from gcs.io.recording.reader import Damage, read, read_info
from gcs.io.recording.topics import Recordable


@pytest.mark.parametrize("step", [1, 997])
def test_a_truncated_recording_is_read_up_to_the_break(
    recording: tuple[Path, list[Recordable]], tmp_path: Path, step: int
) -> None:
    folder, values = recording
    data = (folder / "run.mcap").read_bytes()
    cuts = (
        range(0, 600, 7) if step == 1 else [*range(600, len(data), step), *range(len(data) - 30, len(data))]
    )
    expected = texts(values)
    path = tmp_path / "run.mcap"
    most = 0
    for cut in cuts:
        path.write_bytes(data[:cut])
        *records, last = list(read(path))
        assert isinstance(last.value, Damage), cut
        assert last.value.records == len(records)
        assert "cut off" in last.value.problem
        assert texts(whole(records)) == expected[: len(records)]
        assert len(records) >= most
        most = len(records)
        read_info(path)
    if step > 1:
        assert most == len(values)


def test_a_damaged_recording_gives_true_records_up_to_the_reported_damage(
    recording: tuple[Path, list[Recordable]], tmp_path: Path
) -> None:
    folder, values = recording
    data = (folder / "run.mcap").read_bytes()
    expected = texts(values)
    rng = np.random.default_rng(3)
    path = tmp_path / "run.mcap"
    reported = 0
    for _ in range(150):
        hurt = bytearray(data)
        at = int(rng.integers(8, len(data)))
        hurt[at : at + 4] = rng.bytes(4)
        path.write_bytes(hurt)
        records = list(read(path))
        read_info(path)
        values_read = whole(records)
        assert texts(values_read) == expected[: len(values_read)]
        reported += isinstance(records[-1].value, Damage)
        assert len(values_read) == len(values) or isinstance(records[-1].value, Damage)
    assert reported > 30


def test_a_missing_piece_in_the_middle_is_noticed(
    recording: tuple[Path, list[Recordable]], tmp_path: Path
) -> None:
    folder, values = recording
    data = (folder / "run.mcap").read_bytes()
    with (folder / "run.mcap").open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    gone = chunks[10]
    path = tmp_path / "run.mcap"
    path.write_bytes(data[: gone.chunk_start_offset] + data[gone.chunk_start_offset + gone.chunk_length :])
    *records, last = list(read(path))
    assert isinstance(last.value, Damage)
    assert "records are missing" in last.value.problem
    assert 0 < len(records) < len(values)


def test_a_false_length_costs_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + b"\x06" + (2**62).to_bytes(8, "little") + bytes(100))
    (only,) = list(read(path))
    assert isinstance(only.value, Damage)


@pytest.mark.parametrize("content", [b"PK\x03\x04 a zip file", b"hello"])
def test_a_file_that_is_no_recording_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "flight.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="is no recording"):
        list(read(path))
    with pytest.raises(RecordingError, match="has no recording"):
        list(read(tmp_path))


@pytest.mark.parametrize("version", [b"2", b"4"])
def test_a_recording_of_another_format_version_is_refused_with_the_software_that_reads_it(
    recording: tuple[Path, list[Recordable]], tmp_path: Path, version: bytes
) -> None:
    folder, _ = recording
    data = (folder / "run.mcap").read_bytes()
    path = tmp_path / "run.mcap"
    path.write_bytes(data.replace(b"version\x01\0\0\x003", b"version\x01\0\0\0" + version, 1))
    for use in (read_info, lambda path: list(read(path))):
        with pytest.raises(RecordingError, match=r"has recording format .*Read it with swarm-gcs 0\.1\.0"):
            use(path)


def test_a_recording_without_a_format_version_is_refused(
    recording: tuple[Path, list[Recordable]], tmp_path: Path
) -> None:
    folder, _ = recording
    data = (folder / "run.mcap").read_bytes()
    path = tmp_path / "run.mcap"
    path.write_bytes(data.replace(b"\x06\0\0\0format", b"\x06\0\0\0formed", 1))
    with pytest.raises(RecordingError, match="has recording format 1; this version reads format 3"):
        list(read(path))
