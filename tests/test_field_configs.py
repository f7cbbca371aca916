"""A user would start from a mission file that does not even fit itself."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.command.mission_checks import mission_checks, rehearse
from gcs.config import load
from gcs.fence import fence_of, rally_of

FIELD = Path(__file__).parent.parent / "config" / "field"
FILES = sorted(FIELD.glob("*.toml"))


def test_the_field_guide_has_its_three_files():
    assert {path.stem for path in FILES} == {"arduplane-sitl", "px4-sitl", "serial-radio"}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_field_file_is_whole_and_its_mission_fits_its_own_fence(path):
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 0, result.output
    assert "areas, ceiling" in result.output
    config = load(str(path))
    assert config.planning.retask == "confirm"
    assert fence_of(config, str(path)).areas
    assert rally_of(config)
    rehearsal = rehearse(config, 1, {})
    assert len(rehearsal.plan.routes) == len(config.agents)
    rows = mission_checks(config, rehearsal)
    assert [row.name for row in rows if row.level == "refused"] == []
