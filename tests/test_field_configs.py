"""A user would start from a mission file that does not even fit itself."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config import load
from gcs.core.preflight.mission_checks import mission_checks, rehearse
from gcs.core.preflight.return_heights import return_height_check, return_of, returns_check
from gcs.fence import fence_of, rally_of
from gcs.mavlink.autopilots import ARDUPLANE, PX4

FIELD = Path(__file__).parent.parent / "config" / "field"
GUIDE = (FIELD.parent.parent / "docs" / "field-guide.md").read_text(encoding="utf-8")
FILES = sorted(FIELD.glob("*.toml"))


def test_the_field_guide_has_its_three_files():
    assert {path.stem for path in FILES} == {"arduplane-sitl", "px4-sitl", "serial-radio"}


RETURN_PARAMETERS = {
    "arduplane-sitl": (ARDUPLANE, "RTL_ALTITUDE"),
    "px4-sitl": (PX4, "RTL_RETURN_ALT"),
}


@pytest.mark.parametrize("name", RETURN_PARAMETERS)
def test_vehicles_of_a_shipped_file_return_a_layer_apart_and_below_the_file_s_ceiling(name):
    """With the values that the field guide sets, and without a warning."""
    config = load(str(FIELD / f"{name}.toml"))
    profile, parameter = RETURN_PARAMETERS[name]
    set_m = re.findall(rf"^gcs param set CONFIG {parameter} (\d+) -v (\d+)", GUIDE, re.MULTILINE)
    values = {int(vehicle): {parameter: float(value)} for value, vehicle in set_m}
    assert set(values) == {agent.vehicle for agent in config.agents}
    rally_m = [point.alt_rel_m for point in rally_of(config)]
    ceiling_m = config.fence.max_alt_rel_m
    for vehicle, value in values.items():
        (row,) = return_height_check(vehicle, profile, value, rally_m, ceiling_m)
        assert row.level == "ok", row
    returns = [return_of(vehicle, profile, value, rally_m) for vehicle, value in values.items()]
    (row,) = returns_check(returns, config.mission.layer_step_m)
    assert row.level == "ok", row


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_field_file_is_whole_and_its_mission_fits_its_own_fence(path):
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 0, result.output
    assert "areas, ceiling" in result.output
    config = load(str(path))
    assert config.planning.retask == "confirm"
    assert fence_of(config, str(path)).areas
    assert rally_of(config) or path.stem == "arduplane-sitl"
    rehearsal = rehearse(config, 1, {})
    assert len(rehearsal.plan.routes) == len(config.agents)
    rows = mission_checks(config, rehearsal)
    assert [row.name for row in rows if row.level == "refused"] == []
