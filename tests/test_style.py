"""Style and layers, checked by the command that runs the tests; `.ci/run` checks the types, too."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CHECKED = ["gcs", "sim_vehicles", "tests"]

CHECKS = {
    "ruff": [sys.executable, "-m", "ruff", "check", *CHECKED],
    "format": [sys.executable, "-m", "ruff", "format", "--check", *CHECKED],
    "layers": [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"],
}


@pytest.mark.parametrize("check", CHECKS)
def test_style_and_layers_hold(check: str) -> None:
    done = subprocess.run(CHECKS[check], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
