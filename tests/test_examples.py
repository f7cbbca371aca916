"""The scripts in `examples` run as they are: a user's first result."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.field_vehicles import free_port, vehicle_process

from gcs.geo import LocalFrame
from sim_vehicles.vehicle.vehicle import VehicleSpec

EXAMPLES = Path(__file__).parents[1] / "examples"
ELSEWHERE = {"ros2_bridge.py": "tests/console/test_ros2_bridge.py"}
"""Examples that need a service: their tests."""
MAX_LINES = 40
NUMBERS = r"-?\d+ -?\d+"


def run(name: str, *arguments: str, cwd: Path) -> str:
    command = [sys.executable, str(EXAMPLES / name), *arguments]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=110, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_tracking_gives_two_trajectories_and_a_score(tmp_path: Path) -> None:
    *tracks, score = run("track_a_data_set.py", "--scans", "20", cwd=tmp_path).splitlines()
    assert len(tracks) == 2
    assert all(re.search(rf"at the end {NUMBERS} m", line) for line in tracks)
    assert float(score.split()[1]) < 20.0


def test_planning_gives_each_target_to_an_agent(tmp_path: Path) -> None:
    shown = run("plan_a_swarm.py", "--plot", "plan.png", cwd=tmp_path)
    assert sorted(re.findall(r"target (\d)", shown)) == ["0", "1"]
    assert shown.count("no target") == 1
    assert (tmp_path / "plan.png").read_bytes()[:4] == b"\x89PNG"


def test_uploading_stores_the_mission_on_a_vehicle(tmp_path: Path) -> None:
    port = free_port()
    spec = VehicleSpec(1, 100.0, 100.0, 0.0, 100.0, 15.0)
    with vehicle_process([spec], LocalFrame(33.2, -87.6, 60.0), port):
        shown = run("upload_a_mission.py", f"udpin:127.0.0.1:{port}", cwd=tmp_path)
    assert "verified by read-back" in shown
    assert "  5: command 17, 33.20000 -87.60000, 120 m" in shown


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_each_example_is_short_and_tested_here(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MAX_LINES
    assert path.name in Path(__file__).read_text(encoding="utf-8")
