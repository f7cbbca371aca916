"""The scripts in `examples` run as they are: a user's first result."""

from __future__ import annotations

import json
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
TRACKING = (Path(__file__).parents[1] / "docs" / "tracking.md").read_text(encoding="utf-8")
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


def test_a_model_of_ones_own_tracks_in_three_dimensions(tmp_path: Path) -> None:
    (line,) = run("own_models.py", cwd=tmp_path).splitlines()
    assert line.startswith("2 trajectories of x, y, z, vx, vy, vz, OSPA ")
    assert float(line.split()[-2]) < 15.0


REPORTS = "time,mmsi,lat,lon\n" + "".join(
    f"{1700000000 + 10 * k},{name},{45.0 + 0.01 * k * north:.6f},{9.0 + 0.02 * k:.6f}\n"
    for k in range(40)
    for name, north in (("A", 1), ("B", -1))
)


def test_reports_of_traffic_become_detections_that_can_be_scored(tmp_path: Path) -> None:
    (tmp_path / "reports.csv").write_text(REPORTS)
    (model,) = re.findall(r"^```toml\n(dt_s = 10\.0\n.*?)^```$", TRACKING, re.MULTILINE | re.DOTALL)
    shown = run("traffic_to_npz.py", "reports.csv", "set.npz", "time", "mmsi", "lat", "lon", cwd=tmp_path)
    (tmp_path / "model.toml").write_text(re.sub(r"(?m)^region_m = .*$", shown.splitlines()[1], model))
    assert shown.startswith("2 objects, 39 scans, ")
    words = ["track", "set.npz", "--model", "model.toml", "--cutoff-m", "2000", "--json"]
    command = [sys.executable, "-m", "gcs", *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=110, check=True)
    scores = json.loads(done.stdout.splitlines()[-1])
    assert scores["labels_per_object"] == 1.0
    assert scores["ospa_mean_m"] < 200.0
