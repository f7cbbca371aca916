"""An editor would refuse a valid mission file, or accept a mistake."""

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config.json_schema import mission_file_schema

ROOT = Path(__file__).parents[2]
FILES = sorted([*ROOT.glob("config/scenarios/*.toml"), *ROOT.glob("config/field/*.toml")])
MISSION = {
    "name": "m",
    "frame": {"lat_deg": 46.8, "lon_deg": 9.8, "alt_msl_m": 1560.0},
    "agents": [{"system_id": 1, "east_m": 10.0, "north_m": 20.0}],
}
validator = jsonschema.Draft202012Validator(mission_file_schema())


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_schema_accepts_the_shipped_mission_files(file):
    validator.validate(tomllib.loads(file.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    "change",
    [
        {"agents": [{"system_id": 1, "lat_deg": 46.8, "lon_deg": 9.8}]},
        {"links": {"mavlink": ["udpin:0.0.0.0:14550", {"endpoint": "udpin:0.0.0.0:14560"}]}},
        {"simulation": {"anything": 1}},
    ],
)
def test_the_schema_accepts_other_forms(change):
    validator.validate(MISSION | change)


@pytest.mark.parametrize(
    "change",
    [
        {"agents": [{"system_id": 1, "east_m": 10.0}]},
        {"agents": [{"system_id": 251, "east_m": 10.0, "north_m": 20.0}]},
        {"mission": {"altitude_m": 100.0}},
        {"mission": {"end": "orbit"}},
        {"planning": {"separation_m": -1.0}},
    ],
)
def test_the_schema_refuses_mistakes(change):
    with pytest.raises(jsonschema.ValidationError):
        validator.validate(MISSION | change)


def test_keys_are_explained_as_in_the_reference():
    tables = mission_file_schema()["$defs"]
    assert tables["MissionTable"]["properties"]["layer_step_m"]["description"].startswith("metres, 0 ... 200")
    assert "description" in tables["Config"]["properties"]["takeoff"]


def test_the_command_prints_the_schema_or_the_reference():
    printed = CliRunner().invoke(app, ["schema"])
    assert json.loads(printed.output)["title"] == "Mission file of swarm-gcs"
    reference = CliRunner().invoke(app, ["schema", "--toml"])
    assert tomllib.loads(reference.output)["name"] == "reference"
