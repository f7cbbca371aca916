"""What vehicles reported while central command was dead would be lost, or fill the disk of the bridge."""

from __future__ import annotations

from pathlib import Path

from helpers.frame_bytes import frame

from gcs.io.recording.frame_log import FrameLog
from gcs.io.recording.tlog import LogFrame, read_log
from gcs.model import NS_PER_S

HEARTBEAT = frame(0, bytes(9))
START_NS = 1_700_000_000 * NS_PER_S


def parts(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.tlog"))


def times(folder: Path) -> list[int]:
    found = []
    for part in parts(folder):
        with part.open("rb") as file:
            found += [entry.t_ns for entry in read_log(file) if isinstance(entry, LogFrame)]
    return found


def test_datagrams_are_kept_with_their_times(tmp_path: Path) -> None:
    log = FrameLog(tmp_path / "frames", 100_000, 0)
    log.write([(START_NS, HEARTBEAT), (START_NS + NS_PER_S, HEARTBEAT * 2)])
    log.write([(START_NS + 2 * NS_PER_S, HEARTBEAT)])
    assert times(tmp_path / "frames") == [START_NS + n * NS_PER_S for n in (0, 1, 1, 2)]
    assert log.problem == ""


def test_the_newest_frames_are_kept_within_the_size(tmp_path: Path) -> None:
    max_bytes = 8_000
    log = FrameLog(tmp_path, max_bytes, 0)
    for n in range(1_000):
        log.write([(START_NS + n * NS_PER_S, HEARTBEAT)])
    kept = times(tmp_path)
    assert sum(part.stat().st_size for part in parts(tmp_path)) <= max_bytes
    assert kept == [START_NS + n * NS_PER_S for n in range(1_000 - len(kept), 1_000)]
    assert len(kept) > 100


def test_a_new_start_begins_a_new_part_and_counts_the_old_ones(tmp_path: Path) -> None:
    for start in range(30):
        log = FrameLog(tmp_path, 8_000, 0)
        log.write([(START_NS + start * NS_PER_S, HEARTBEAT * 20)])
        log.close()
    assert sum(part.stat().st_size for part in parts(tmp_path)) <= 8_000
    assert times(tmp_path)[-1] == START_NS + 29 * NS_PER_S


def test_a_disk_that_is_full_for_a_time_is_told_and_tried_again(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.write_text("a file in its place")
    log = FrameLog(folder, 100_000, 0)
    log.write([(START_NS, HEARTBEAT)])
    assert log.problem
    folder.unlink()
    log.write([(START_NS + NS_PER_S, HEARTBEAT)])
    assert log.problem == ""
    assert times(folder) == [START_NS + NS_PER_S]


def test_the_disk_keeps_the_space_that_others_need(tmp_path: Path) -> None:
    log = FrameLog(tmp_path, 100_000, 10**18)
    log.write([(START_NS, HEARTBEAT)])
    assert "min_free_mb" in log.problem
    assert times(tmp_path) == []
