"""`gcs plan`: what a script reads from it, what a person sees, and what it says of input that cannot be."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path

import pytest
from typer.testing import CliRunner

import gcs
from gcs.cli import app
from gcs.model import NoticeCode

MISSION = """name = "tiny"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 0.0
[map]  # a walled yard, and one blocked node in the north
width_m = 8.0
height_m = 6.0
nodes_east = 9
nodes_north = 7
boxes_m = [[0.7, 0.7, 7.3, 1.3], [0.7, 3.7, 7.3, 4.3], [0.7, 0.7, 1.3, 4.3], [6.7, 0.7, 7.3, 4.3],
    [3.7, 5.7, 4.3, 6.3]]
[[agents]]
system_id = 1
east_m = 1.0
north_m = 0.0
[planning]
shape = "pulled"
"""


@pytest.fixture
def tiny(tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(MISSION, encoding="utf-8")
    return str(path)


def plan(*arguments):
    result = CliRunner().invoke(app, ["plan", *map(str, arguments), "--json"], catch_exceptions=False)
    lines = result.stdout.splitlines()
    return result.exit_code, json.loads(lines[-1]) if lines else None, result.output


def test_a_scenario_is_planned_from_its_starts_to_its_places_of_birth():
    code, found, _ = plan("random-obstacles", "--seed", 3)
    assert code == 0
    assert [route["agent"] for route in found["routes"]] == [1, 2, 3, 4]
    assert len(found["unassigned_targets"]) == 1
    assert found["unassigned_agents"] == []
    assert set(found["timings_ms"]) == {"search", "assignment", "shaping"}
    assert all(ms > 0.0 for ms in found["timings_ms"].values())
    for route in found["routes"]:
        assert route["points_m"][0][0] == 120.0
    total_m = sum(route["length_m"] for route in found["routes"])
    assert found["total_length_m"] == pytest.approx(total_m)


def test_ways_home_are_named_and_drawn_where_a_mission_lands(tmp_path):
    scenario, picture = tmp_path / "landing.toml", tmp_path / "landing.png"
    text = (Path(gcs.__file__).parent / "scenarios" / "random-obstacles.toml").read_text(encoding="utf-8")
    scenario.write_text(text.replace("[mission]", '[mission]\nend = "land"'), encoding="utf-8")
    _, found, _ = plan(scenario, "--seed", 3, "--plot", picture)
    for route in found["routes"]:
        assert route["home_m"][-1] == route["points_m"][0]
        assert math.dist(route["home_m"][-2], route["home_m"][-1]) == pytest.approx(500.0)
    assert picture.stat().st_size > 10_000
    assert plan("random-obstacles", "--seed", 3)[1]["routes"][0]["home_m"] is None


@pytest.mark.parametrize(
    "places",
    [
        ["--agents", "0,0", "--agents", "8,0", "--targets", "0,6", "--targets", "8,6"],
        ["--targets=0,6", "--targets=8,6", "--agents=0,0", "--agents=8,0"],
    ],
)
def test_places_are_given_one_after_the_other(tiny, places):
    code, found, _ = plan(tiny, *places)
    assert code == 0
    routes = [(route["agent"], route["target"], route["grid_length_m"]) for route in found["routes"]]
    assert routes == [(1, [0, 0], 6), (2, [0, 1], 6)]


def test_a_route_is_no_longer_than_on_the_grid_and_its_length_is_that_of_its_points(tiny):
    code, found, _ = plan(tiny, "--agents", "1,5", "--targets", "8,1")
    assert code == 0
    [route] = found["routes"]
    assert (route["points_m"][0], route["points_m"][-1]) == ([1, 5], [8, 1])
    assert route["grid_length_m"] == pytest.approx(11.0)
    assert 10.0 < route["length_m"] < 11.0
    assert sum(math.dist(a, b) for a, b in pairwise(route["points_m"])) == pytest.approx(route["length_m"])


def test_the_picture_is_a_picture(tiny, tmp_path):
    png = tmp_path / "new" / "plan.png"
    code, _, said = plan(tiny, "--agents", "0,0", "--targets", "8,6", "--plot", png)
    assert code == 0
    assert png.read_bytes().startswith(b"\x89PNG")
    assert str(png) in said.replace("\n", "")


def test_unreachable_agents_stay_without_a_route_with_a_note(tiny):
    code, found, _ = plan(tiny, "--agents", "3,2", "--targets", "0,0")
    assert code == 1
    assert found["routes"] == []
    assert (found["unassigned_agents"], found["unassigned_targets"]) == ([1], [[0, 0]])
    assert found["notes"] == [
        f"agent 1: {NoticeCode.NO_PATH_TO_TARGETS.text}",
        NoticeCode.NO_PATH_FROM_AGENTS.text.format(target="T0.0"),
    ]


def test_a_start_inside_an_obstacle_is_left_with_a_note(tiny):
    code, found, _ = plan(tiny, "--agents", "4,6", "--targets", "8,6")
    assert code == 0
    left = NoticeCode.INSIDE_OBSTACLE.text.partition("{")[0]
    assert found["notes"][0].startswith(f"agent 1: {left}")


@pytest.mark.parametrize("places", [[], ["--agents", "1,0"]])
def test_a_plan_without_targets_is_reported_as_a_failure(tiny, places):
    code, found, _ = plan(tiny, *places)
    assert code == 1
    assert found["notes"] == [NoticeCode.NO_TARGETS.text]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "Missing argument"),
        (["nowhere"], "no such file or scenario"),
        (["prescribed", "--agents", "1;2"], "expected x,y"),
        (["prescribed", "--agents", "5,nan"], "lies off the map"),
        (["prescribed", "--targets", "-5000,100"], "lies off the map"),
        (["prescribed", "--plot", "plan.doc"], "expected a name that ends in"),
    ],
)
def test_mistakes_in_arguments_differ_from_plans_that_failed(arguments, said):
    code, found, output = plan(*arguments)
    assert code == 2
    assert found is None or said in found["mistakes"][0]["expected"]
    assert said in output.replace("\n", " ")


def test_agents_with_one_system_id_on_two_networks_are_both_planned_for(tmp_path):
    path = tmp_path / "two.toml"
    radio, other = "udpin:127.0.0.1:14550", '{ endpoint = "udpin:127.0.0.1:14551", network = 1 }'
    links = f'[links]\nmavlink = ["{radio}", {other}]\n'
    second = "[[agents]]\nsystem_id = 1\nnetwork = 1\neast_m = 7.0\nnorth_m = 5.0\n"
    path.write_text(MISSION + second + links, encoding="utf-8")
    _, found, output = plan(path, "--targets", "0,5", "--targets", "7,0")
    assert [route["agent"] for route in found["routes"]] == [1, 1 << 8 | 1]
    assert "1:1" in output
