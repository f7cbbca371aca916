"""A script that writes mission files would have to read sentences to repair its mistakes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config import parse, read_text
from gcs.errors import ConfigError
from gcs.mistake_codes import MistakeCode, mistake_table
from sim_vehicles.cli import app as sim_vehicles

ROOT = Path(__file__).parents[2]
REFERENCE = (ROOT / "config" / "reference.toml").read_text(encoding="utf-8")


def found(text: str) -> list[tuple[str, MistakeCode]]:
    with pytest.raises(ConfigError) as caught:
        parse(text, "m.toml")
    return [(one.key, one.code) for one in caught.value.all]


@pytest.mark.parametrize(
    ("before", "after", "key", "code"),
    [
        ("[map]\n", "[map]\nwide_m = 3.0\n", "map", MistakeCode.UNKNOWN_KEY),
        ("\nlat_deg = ", "\n# lat_deg = ", "frame", MistakeCode.MISSING_KEY),
        ('retask = "auto"', "retask = 3", "planning.retask", MistakeCode.WRONG_TYPE),
        ('retask = "auto"', 'retask = "never"', "planning.retask", MistakeCode.UNKNOWN_NAME),
        ("\nwidth_m = ", "\nwidth_m = -", "map.width_m", MistakeCode.OUT_OF_RANGE),
        ('zenoh = "tcp/', 'zenoh = "', "links.zenoh", MistakeCode.WRONG_TYPE),
        ("[map]\n", "[map\n", "", MistakeCode.INVALID_FILE),
    ],
)
def test_a_mistake_has_the_code_of_its_kind(before: str, after: str, key: str, code: MistakeCode) -> None:
    assert before in REFERENCE
    assert (key, code) in found(REFERENCE.replace(before, after, 1))


def test_the_kinds_across_keys() -> None:
    text, source = read_text("prescribed")
    assert found(re.sub(r"^system_id = 2$", "system_id = 1", text, count=1, flags=re.MULTILINE)) == [
        ("agents[1].system_id", MistakeCode.DUPLICATE)
    ], source
    assert found(re.sub(r"^east_m = .*$", "east_m = -1e6", text, count=1, flags=re.MULTILINE)) == [
        ("agents[0]", MistakeCode.OUTSIDE_MAP)
    ]


@pytest.mark.parametrize("command", ["check", "plan", "preflight", "simulate"])
def test_each_command_with_json_lists_all_mistakes(command: str, tmp_path: Path) -> None:
    file = tmp_path / "m.toml"
    text = REFERENCE.replace('retask = "auto"', 'retask = "never"', 1)
    file.write_text(text.replace("[map]\n", "[map]\nwide_m = 3.0\n", 1), encoding="utf-8")
    if command == "simulate":
        arguments = ["simulate", json.dumps({"scenario": str(file), "seed": 1, "runs": 1, "as_json": True})]
        result = CliRunner().invoke(sim_vehicles, arguments)
    else:
        result = CliRunner().invoke(app, [command, str(file), "--json"])
    assert result.exit_code == 2
    mistakes = json.loads(result.stdout.splitlines()[-1])["mistakes"]
    assert {(one["key"], one["code"]) for one in mistakes} == {
        ("map", "unknown-key"),
        ("planning.retask", "unknown-name"),
    }
    assert {one["file"] for one in mistakes} == {str(file)}
    assert all(one["expected"] for one in mistakes)


def test_a_right_file_has_no_mistakes() -> None:
    result = CliRunner().invoke(app, ["check", "prescribed", "--json"])
    assert (result.exit_code, json.loads(result.stdout)) == (0, {"mistakes": []})


def test_the_log_has_the_mistakes_of_a_run_that_does_not_begin(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["run", str(tmp_path / "none.toml"), "--log-format", "json"])
    (line,) = result.output.splitlines()
    (mistake,) = json.loads(line)["parameters"]["mistakes"]
    assert (result.exit_code, mistake["code"]) == (2, "not-found")


def test_the_documentation_has_the_table() -> None:
    page = (ROOT / "docs" / "operations.md").read_text(encoding="utf-8")
    assert mistake_table() in page, "run: python -m gcs.mistake_codes"


def test_each_code_is_used_somewhere() -> None:
    source = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "gcs").rglob("*.py"))
    used = set(re.findall(r"MistakeCode\.([A-Z_]+)", source))
    assert set(MistakeCode.__members__) == used
    assert all(code.value == code.name.lower().replace("_", "-") for code in MistakeCode)
