"""What somebody sees who types `gcs` for the first time."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from gcs.cli import app


def test_version_is_that_of_the_package() -> None:
    shown = CliRunner().invoke(app, ["--version"])
    assert shown.exit_code == 0
    assert shown.stdout.strip() == f"gcs {importlib.metadata.version('swarm-gcs')}"


def test_help_lists_every_command_by_its_use() -> None:
    shown = CliRunner().invoke(app, ["--help"]).stdout
    places = [shown.index(title) for title in ("Fly", "Before a flight", "Recordings")]
    assert places == sorted(places)
    for command in ("demo", "montecarlo", "order", "preflight", "fence", "keys", "plan", "replay", "track"):
        assert f" {command} " in shown


@pytest.mark.parametrize("command", ["demo", "run", "plan", "replay", "report", "track", "order", "keys"])
def test_every_command_explains_itself(command: str) -> None:
    shown = CliRunner().invoke(app, [command, "--help"])
    assert shown.exit_code == 0
    assert "Usage:" in shown.stdout


def test_the_short_form_of_help_and_the_package_itself_are_understood() -> None:
    for arguments in (["-h"], ["order", "-h"], ["order", "hold", "-h"]):
        assert "Usage:" in CliRunner().invoke(app, arguments).stdout
    command = [sys.executable, "-P", "-m", "gcs", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("gcs ")
