"""Missions for QGroundControl: a pilot flies from a .plan what the service would have uploaded."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.cli.prepare.sketch.plan_and_kml import read_plan
from gcs.config import load
from gcs.fence import Area, Fence, fence_of, rally_of
from gcs.mavlink.autopilots import ARDUPLANE, PROFILES, PX4, AutopilotProfile
from gcs.mavlink.mission.geofence_rally import fence_items, list_difference, rally_items
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home, Item
from gcs.mavlink.mission.plan_file import plan_document
from gcs.model import Mission, Waypoint

MISSION = """name = "fenced"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[map]
width_m = 2000.0
height_m = 2000.0
[mission]
end = "{end}"
[[agents]]
system_id = 1
east_m = 300.0
north_m = 300.0
course_deg = 45.0
[[agents]]
system_id = 7
east_m = 600.0
north_m = 300.0
[[fence.areas]]
kind = "inclusion"
corners_deg = [[33.19, -87.61], [33.19, -87.57], [33.23, -87.57], [33.23, -87.61]]
[[fence.areas]]
kind = "exclusion"
circle = [33.2150001, -87.5900001, 60.5]
[[rally]]
lat_deg = 33.2021234
lon_deg = -87.5951234
alt_rel_m = 80
"""
TARGETS = ["--targets", "1500,1500", "--targets", "1500,500"]


def written(folder: Path, *options: str, end: str = "loiter") -> dict[str, dict[str, Any]]:
    path = folder / "fenced.toml"
    path.write_text(MISSION.format(end=end), encoding="utf-8")
    arguments = ["plan", str(path), *TARGETS, "--plan-files", str(folder / "plans"), *options]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return {one.name: json.loads(one.read_text()) for one in (folder / "plans").iterdir()}


def items_of(document: dict[str, Any]) -> list[Item]:
    """The items that QGroundControl uploads from a .plan; null is NaN."""
    found = []
    for row in document["mission"]["items"]:
        *params, lat_deg, lon_deg, z_m = (math.nan if value is None else value for value in row["params"])
        place = round(lat_deg * 1e7), round(lon_deg * 1e7)
        found.append(Item(row["command"], row["frame"], *place, z_m, *params, int(row["autoContinue"])))
    return found


@pytest.mark.parametrize("profile", PROFILES, ids=lambda one: one.name)
def test_items_come_back_as_they_are_uploaded(profile: AutopilotProfile) -> None:
    points = tuple(Waypoint(33.2 + n * 1.23e-4, -87.6 - n * 3.21e-5, 100.123 + n, 43.0) for n in range(3))
    msl = Waypoint(33.2011, -87.6011, 220.5, 30.0, "msl")
    home = Home(33.2, -87.6, 70.0)
    for mission in (
        Mission(1, 1, points, 70.0),
        Mission(1, 1, (*points, msl), 70.0, wait=msl),
        Mission(1, 1, points, end="land", return_waypoints=(points[0],)),
    ):
        for from_ground in (False, True):
            items = build_items(profile, mission, home, from_ground=from_ground)
            document = json.loads(json.dumps(plan_document(profile, items, home, 15.0, Fence(), ())))
            assert [repr(one) for one in items_of(document)] == list(map(repr, items[profile.home_items :]))
            assert document["mission"]["firmwareType"] == profile.autopilot


@pytest.mark.parametrize("autopilot", ["arduplane", "px4"])
def test_every_vehicle_gets_its_route_fence_and_rally_points(tmp_path: Path, autopilot: str) -> None:
    documents = written(tmp_path, "--autopilot", autopilot)
    assert sorted(documents) == ["vehicle-1.plan", "vehicle-7.plan"]
    firmware = {"arduplane": ARDUPLANE, "px4": PX4}[autopilot].autopilot
    config = load(str(tmp_path / "fenced.toml"))
    for document in documents.values():
        assert document["mission"]["firmwareType"] == firmware
        items = items_of(document)
        assert [one.command for one in items[:-1]] == [16] * (len(items) - 1)
        assert items[-1].command == 17
        read = read_plan_back(tmp_path, document)
        areas = tuple(Area(a.stay_in, a.corners, *_circle(a.circle)) for a in read.areas)
        sent = fence_of(config)
        by_kind = sorted(areas, key=lambda area: not area.stay_in)
        assert list_difference(1, fence_items(sent), fence_items(Fence(tuple(by_kind)))) == ""
        assert [one[:2] for one in read.rally] == [(33.2021234, -87.5951234)]
        assert read.rally[0][2] == rally_items(rally_of(config))[0].z_m


def _circle(circle: tuple[float, float, float] | None) -> tuple[tuple[float, float], float]:
    return ((0.0, 0.0), 0.0) if circle is None else (circle[:2], circle[2])


def read_plan_back(folder: Path, document: dict[str, Any]) -> Any:
    path = folder / "again.plan"
    path.write_text(json.dumps(document), encoding="utf-8")
    return read_plan(path)


def test_a_mission_that_lands_ends_at_the_start_of_its_vehicle(tmp_path: Path) -> None:
    documents = written(tmp_path, end="land")
    config = load(str(tmp_path / "fenced.toml"))
    for agent in config.agents:
        document = documents[f"vehicle-{agent.system_id}.plan"]
        landing = document["mission"]["items"][-1]
        assert landing["command"] == 21
        here_m = config.local_frame.to_local(*landing["params"][4:6])
        assert here_m == pytest.approx((agent.east_m, agent.north_m), abs=0.02)
        assert document["mission"]["plannedHomePosition"][2] == 70.0


def test_a_plan_begins_a_mission_file(tmp_path: Path) -> None:
    written(tmp_path)
    source, out = tmp_path / "plans" / "vehicle-1.plan", tmp_path / "again.toml"
    result = CliRunner().invoke(app, ["init", str(source), "-o", str(out)])
    assert result.exit_code == 0, result.output
    again = load(str(out))
    (start,) = again.agents
    assert again.local_frame.to_geodetic(start.east_m, start.north_m) == pytest.approx(
        load(str(tmp_path / "fenced.toml")).local_frame.to_geodetic(300.0, 300.0), abs=1e-6
    )
    places = [(birth.east_m, birth.north_m) for birth in again.births]
    assert (
        len(set(places)) == len(places) > 0
    )  # the waypoint at the target and the loiter there are one place
    assert fence_of(again).areas
    assert [row.alt_rel_m for row in rally_of(again)] == [80]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--autopilot", "betaflight"], "expected arduplane or px4"),
        (["--plan-files", "/dev/null/x"], "cannot be written"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, options: list[str], said: str) -> None:
    path = tmp_path / "fenced.toml"
    path.write_text(MISSION.format(end="loiter"), encoding="utf-8")
    result = CliRunner().invoke(app, ["plan", str(path), *TARGETS, *options], catch_exceptions=False)
    assert result.exit_code == 2
    assert said in " ".join(result.output.split())
