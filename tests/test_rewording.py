"""A better wording of a notice would break programs and tests that read its text.

SWARM_GCS_REWORD=1 gives all notices other words (`helpers/rewording.py`); tests have to pass with them as
well. Some do so in each session (`REWORDED` in `conftest.py`).
"""

from __future__ import annotations

import os
import string
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.rewording import reworded

from gcs.model import NoticeCode

TESTS = Path(__file__).parent
PURE = ("core", "mavlink", "model", "planning", "tracking", "recordings", "report", "cli", "service")
"""Folders with tests in one process."""


def fields(template: str) -> list[tuple[str | None, str | None]]:
    return [(name, form) for _, name, form, _ in string.Formatter().parse(template)]


@pytest.mark.parametrize("code", list(NoticeCode))
def test_other_words_keep_the_fields(code):
    other = reworded(code.text)
    assert other != code.text
    assert fields(other) == fields(code.text)
    assert other.count("[") == code.text.count("[")


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("folder", PURE)
def test_all_tests_of_the_core_pass_with_other_words(folder):
    options = ("-n", "0", "-p", "no:cacheprovider", "--tb", "short")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, str(TESTS / folder)],
        env={**os.environ, "SWARM_GCS_REWORD": "1"},
        cwd=TESTS.parent,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-1000:]
