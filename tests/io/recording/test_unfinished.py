"""A run that was killed before its first record does not block the next one; nothing recorded is deleted."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.recorded import CONFIG, VERSIONS

from gcs.cli.run_setup import open_recorder
from gcs.config.schema import RecordingTable
from gcs.errors import RecordingError
from gcs.io.recording.folder import Run, remove_empty
from gcs.io.recording.reader import read
from gcs.io.recording.recorder import Recorder
from gcs.model import Tick

KILLED = """
import os, signal, sys
from pathlib import Path
from gcs.io.recording.recorder import Recorder
recorder = Recorder(Path(sys.argv[1]), "name = 'x'", {})
os.kill(os.getpid(), signal.SIGKILL)
"""


def start_in(folder: Path) -> None:
    with open_recorder(folder, "x", CONFIG, Run("x", 1), RecordingTable()) as recorder:
        recorder.record_event(Tick(7))


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    command = [sys.executable, "-P", "-c", KILLED, str(folder)]
    assert subprocess.run(command, cwd=Path(__file__).parents[3]).returncode == -signal.SIGKILL
    assert (folder / "run.mcap").stat().st_size > 0
    return folder


def test_a_run_killed_at_its_start_does_not_block_the_next(
    killed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start_in(killed)
    assert [record.value for record in read(killed)] == [Tick(7)]
    assert "had an empty recording" in capsys.readouterr().err


@pytest.mark.parametrize("length", [0, 5, 12, 40])
def test_nor_does_one_killed_while_it_wrote_the_header(killed: Path, length: int) -> None:
    path = killed / "run.mcap"
    path.write_bytes(path.read_bytes()[:length])
    start_in(killed)
    assert [record.value for record in read(killed)] == [Tick(7)]


def test_what_was_recorded_stays_although_the_run_was_killed(tmp_path: Path) -> None:
    start_in(tmp_path)
    whole = (tmp_path / "run.mcap").read_bytes()
    for content in (whole, whole[: len(whole) // 2], b"damaged" + whole[7:]):
        (tmp_path / "run.mcap").write_bytes(content)
        with pytest.raises(RecordingError, match="has a recording already"):
            start_in(tmp_path)
        assert (tmp_path / "run.mcap").read_bytes() == content


def test_mavlink_that_was_logged_stays(killed: Path) -> None:
    (killed / "link.tlog").write_bytes(b"x")
    with pytest.raises(RecordingError, match="has a recording already"):
        start_in(killed)


def test_a_recording_that_another_process_has_just_begun_is_not_replaced(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run", CONFIG, VERSIONS) as other:
        assert not remove_empty(tmp_path / "run")
        with pytest.raises(RecordingError, match="has a recording already"):
            start_in(tmp_path / "run")
        other.record_event(Tick(1))
    assert [record.value for record in read(tmp_path / "run")] == [Tick(1)]
