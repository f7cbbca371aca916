"""What a user pastes from docs/library.md works."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest
from helpers.field_vehicles import free_port, vehicle_process

from gcs.geo import LocalFrame
from sim_vehicles.vehicle.vehicle import VehicleSpec

PAGE = Path(__file__).parents[1] / "docs" / "library.md"
TRACK, MODELS, PLAN, UPLOAD, STONE_SOUP, RECORDING = re.findall(
    r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL
)


def run(code: str) -> list[str]:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, "docs/library.md", "exec"), {})
    return printed.getvalue().splitlines()


def test_the_data_set_has_one_object() -> None:
    (line,) = run(TRACK)
    assert re.fullmatch(r"\(\d+, \d+\) \((\d+),\) \(\1, 4\) \(\1, 4, 4\)", line), line


def test_models_of_the_user_track_the_object() -> None:
    (line,) = run(MODELS)
    state = [float(word) for word in line.partition("[")[2].strip("]").split()]
    assert state == pytest.approx([880.0, 465.0, 20.0, -15.0], abs=10.0)


def test_each_target_gets_an_agent() -> None:
    assert sorted(line.split()[1] for line in run(PLAN)) == ["-1", "0", "1"]


def test_the_mission_is_stored_and_flown() -> None:
    port = free_port()
    assert "14550" in UPLOAD
    with vehicle_process(
        [VehicleSpec(1, 100.0, 100.0, 0.0, 100.0, 15.0)], LocalFrame(33.2, -87.6, 60.0), port
    ):
        first, *items = run(UPLOAD.replace("14550", str(port)))
    assert first.startswith("True equal verified by read-back")
    assert len(items) == 5


def test_our_tracker_runs_in_stone_soup() -> None:
    pytest.importorskip("stonesoup")
    lines = run(STONE_SOUP)
    assert len(lines) == 30
    assert re.search(r"\{'\d+\.\d+': ", lines[-1])


def test_the_scans_of_a_recording_feed_their_trackers() -> None:
    pytest.importorskip("stonesoup")
    recording = Path(__file__).parent / "recordings" / "death.mcap"
    lines = run(RECORDING.replace('"runs/prescribed-1"', repr(str(recording))))
    assert len(lines) > 10
    assert all(int(line.split()[-1]) > 0 for line in lines)
