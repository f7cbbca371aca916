"""A process that is killed or a disk that is full costs the last second, no more."""

import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs.io.recording.mcap_file import mcap_paths
from gcs.io.recording.reader import Damage, read
from gcs.model import (
    Tick,
)

CHILD = """
import sys, time
from pathlib import Path
from gcs.io.recording.recorder import Recorder, DiskBudget
from gcs.model import Datagram, Tick
recorder = Recorder(Path(sys.argv[1]), "name = 'x'", {}, None, DiskBudget(int(sys.argv[2])))
for number in range(100_000):
    recorder.record_event(Tick(number))
    if number % 500 == 499:
        recorder.flush()
        print(number + 1, flush=True)
        time.sleep(0.002)
"""


@pytest.mark.parametrize("rotate_bytes", [10_000, 500_000_000])
def test_after_sigkill_everything_flushed_is_there(tmp_path: Path, rotate_bytes: int) -> None:
    folder = tmp_path / "run"
    child = subprocess.Popen(
        [sys.executable, "-P", "-c", CHILD, str(folder), str(rotate_bytes)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    assert child.stdout is not None
    promised = [int(child.stdout.readline()) for _ in range(7)][-1]
    child.send_signal(signal.SIGKILL)
    rest = child.stdout.read().split()
    child.wait()
    child.stdout.close()
    promised = int(rest[-1]) if rest else promised
    *records, last = list(read(folder))
    assert isinstance(last.value, Damage)
    assert "cut off" in last.value.problem
    assert len(records) >= promised
    assert [r.value for r in records] == [Tick(number) for number in range(len(records))]


FULL = """
import resource, sys
from pathlib import Path
from gcs.io.recording.recorder import Recorder, DiskBudget
from gcs.errors import RecordingError
from gcs.model import Notice, NoticeCode
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
try:
    with Recorder(Path(sys.argv[1]), "name = 'x'", {}) as recorder:
        number = 0
        while True:
            said = {"said": str(hash(str(number)))}
            recorder.record_effect(number, Notice(number, NoticeCode.AUTOPILOT_INFO, 1, said))
            number += 1
            if number % 100 == 0:
                recorder.flush()
                print(number, flush=True)
except RecordingError as error:
    print(error)
"""


def test_on_a_full_disk_the_run_is_warned_and_flushed_records_stay(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    done = subprocess.run(
        [sys.executable, "-P", "-c", FULL, str(folder)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        check=True,
    )
    *promised, error = done.stdout.splitlines()
    assert "cannot be written any further" in error
    assert done.stderr == ""
    *records, last = list(read(folder))
    assert isinstance(last.value, Damage)
    assert len(records) >= int(promised[-1]) > 0


SMALL_DISK = """
import sys
from pathlib import Path
from gcs.io.recording.recorder import Recorder, DiskBudget
from gcs.errors import RecordingError
from gcs.model import Tick
try:
    with Recorder(Path(sys.argv[1]), "name = 'x'", {}, None, DiskBudget(40_000)) as recorder:
        for number in range(10_000_000):
            recorder.record_event(Tick(hash(str(number)) % 2**60))
            if number % 500 == 499:
                recorder.flush()
                print(number + 1, flush=True)
except RecordingError as error:
    print(error)
"""


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    mount = ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", str(tmp_path)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("may not mount a small disk here")
    yield tmp_path
    subprocess.run(["umount", str(tmp_path)], check=True)


def test_a_disk_that_fills_while_parts_are_written_keeps_flushed_records(small_disk: Path) -> None:
    command = [sys.executable, "-P", "-c", SMALL_DISK, str(small_disk / "run")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[2], check=True)
    *promised, error = done.stdout.splitlines()
    assert "No space left on device" in error
    assert len(mcap_paths(small_disk / "run")) > 2
    *records, last = list(read(small_disk / "run"))
    assert isinstance(last.value, Damage)
    assert len(records) >= int(promised[-1]) > 0
