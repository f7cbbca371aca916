"""A run in Foxglove: its well-known schemas are what its panels look for, by name and by field."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config import parse
from gcs.io.recording.reader import read, read_info
from gcs.model import NS_PER_S, Notice, Picture, Plan

DEATH = Path(__file__).parents[2] / "recordings" / "death.mcap"
LAYOUT = Path(__file__).parents[3] / "docs" / "foxglove-layout.json"
REQUIRED = {
    "foxglove.LocationFix": "timestamp frame_id latitude longitude altitude position_covariance "
    "position_covariance_type",
    "foxglove.FrameTransform": "timestamp parent_frame_id child_frame_id translation rotation",
    "foxglove.GeoJSON": "geojson",
    "foxglove.Log": "timestamp level message name file line",
    "foxglove.SceneUpdate": "deletions entities",
}
"""Required fields of the published schemas."""


def export(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["export", *map(str, arguments)], catch_exceptions=False)
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture(scope="module")
def topics(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[int, str, Any]]]:
    """Time, schema and content of the messages of each topic, each valid by its schema in the file."""
    out = tmp_path_factory.mktemp("foxglove") / "run.foxglove.mcap"
    code, _ = export(DEATH, "-o", out)
    assert code == 0
    found = defaultdict(list)
    validators: dict[int, Any] = {}
    with out.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            content = json.loads(message.data)
            if schema.id not in validators:
                known = json.loads(schema.data)
                kind = jsonschema.validators.validator_for(known)
                kind.check_schema(known)
                validators[schema.id] = kind(known)
            validators[schema.id].validate(content)
            assert set(REQUIRED[schema.name].split()) <= content.keys()
            found[channel.topic].append((message.log_time, schema.name, content))
    return found


def test_each_vehicle_has_its_fixes_and_its_frame(topics: dict[str, list[tuple[int, str, Any]]]) -> None:
    origin = parse(read_info(DEATH).config_text, "recorded").local_frame
    fixes = {topic: rows for topic, rows in topics.items() if topic.endswith("/fix")}
    assert sorted(fixes) == [f"/vehicle/{n}/fix" for n in (1, 2, 3, 4)]
    frames = {(t_ns, row["child_frame_id"]): row["translation"] for t_ns, _, row in topics["/tf"]}
    for rows in fixes.values():
        for t_ns, name, fix in rows:
            assert name == "foxglove.LocationFix"
            assert fix["timestamp"] == {"sec": t_ns // NS_PER_S, "nsec": t_ns % NS_PER_S}
            here = frames[t_ns, fix["frame_id"]]
            assert origin.to_local(fix["latitude"], fix["longitude"]) == pytest.approx((here["x"], here["y"]))
            assert here["z"] == pytest.approx(fix["altitude"] - origin.alt_msl_m)


def test_the_log_has_every_notice(topics: dict[str, list[tuple[int, str, Any]]]) -> None:
    levels = {"info": 2, "warning": 3, "alarm": 4}
    notices = [(levels[r.value.level], r.value.line) for r in read(DEATH, only=[Notice])]
    assert [(row["level"], row["message"]) for _, _, row in topics["/notices"]] == notices


def test_the_scene_ends_with_the_present_routes_and_targets(
    topics: dict[str, list[tuple[int, str, Any]]],
) -> None:
    plan = [record.value for record in read(DEATH, only=[Plan])][-1]
    assert scene(topics["/scene/routes"]) == {f"route {route.vehicle}" for route in plan.routes}
    pictures = [r.value for r in read(DEATH, only=[Picture]) if r.value.kind == "targets"]
    names = {f"T{t.label[0]}.{t.label[1]}" for t in pictures[-1].tracks if t.estimated}
    assert scene(topics["/scene/targets"]) == names
    on_map = json.loads(topics["/map/targets"][-1][2]["geojson"])["features"]
    assert {one["properties"]["target"] for one in on_map} == names


def scene(rows: list[tuple[int, str, Any]]) -> set[str]:
    shown: set[str] = set()
    for _, _, row in rows:
        shown -= {one["id"] for one in row["deletions"]}
        shown |= {one["id"] for one in row["entities"]}
    return shown


def test_fence_and_no_fly_zones_are_on_the_map(tmp_path: Path) -> None:
    mission = tmp_path / "m.toml"
    text = read_info(DEATH).config_text
    mission.write_text(text + '\n[[fence.areas]]\nkind = "exclusion"\ncircle = [33.21, -87.58, 60.0]\n')
    code, said = export(DEATH, "-o", tmp_path / "r.mcap", "--config", mission)
    assert code == 0, said
    with (tmp_path / "r.mcap").open("rb") as file:
        found = {
            c.topic: json.loads(m.data)
            for _, c, m in make_reader(file).iter_messages(["/map/areas", "/scene/areas"])
        }
    (area,) = json.loads(found["/map/areas"]["geojson"])["features"]
    assert len(area["geometry"]["coordinates"]) == 49
    assert len(found["/scene/areas"]["entities"]) == 1


def test_a_log_has_fixes(flight: Path, tmp_path: Path) -> None:
    assert export(flight / "link.tlog", "-o", tmp_path / "log.mcap")[0] == 0
    with (tmp_path / "log.mcap").open("rb") as file:
        names = {c.topic for _, c, _ in make_reader(file).iter_messages()}
    assert "/tf" in names
    assert all(name == "/tf" or name.endswith("/fix") for name in names)


def test_the_layout_shows_topics_that_a_file_has(topics: dict[str, list[tuple[int, str, Any]]]) -> None:
    layout = json.loads(LAYOUT.read_text())["configById"]
    assert layout["RosOut!notices"]["topicToRender"] in topics
    assert {"/scene/routes", "/scene/targets"} <= layout["3D!scene"]["topics"].keys()


def test_the_run_itself_is_not_replaced(tmp_path: Path) -> None:
    own = tmp_path / "run.mcap"
    own.write_bytes(DEATH.read_bytes())
    code, said = export(own, "-o", own, "--force")
    assert (code, "is the run itself" in said) == (2, True)
    assert own.read_bytes() == DEATH.read_bytes()
