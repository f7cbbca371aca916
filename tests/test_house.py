"""The house rules: style, types and layers, behind the one command that runs the tests."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ROOMS = ["gcs", "sim_vehicles", "tests"]

CHECKS = {
    "ruff": [sys.executable, "-m", "ruff", "check", *ROOMS],
    "format": [sys.executable, "-m", "ruff", "format", "--check", *ROOMS],
    "mypy": [sys.executable, "-m", "mypy"],
    "layers": [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"],
}


@pytest.mark.parametrize("check", CHECKS)
def test_house_rule_holds(check: str) -> None:
    done = subprocess.run(CHECKS[check], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
