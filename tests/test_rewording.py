"""A better wording of a notice or a check would break programs and tests that read its text.

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

from gcs.core.preflight.check_codes import CheckCode
from gcs.model import NoticeCode

TESTS = Path(__file__).parent
PURE = ("core", "mavlink", "model", "planning", "tracking", "recordings", "report", "cli", "service")
"""Folders with tests in one process."""


def fields(template: str) -> list[tuple[str | None, str | None]]:
    return [(name, form) for _, name, form, _ in string.Formatter().parse(template)]


CHECK_TEXTS = {text for code in CheckCode for text in (code.found, code.wanted, code.remedy) if text}
TEXTS = sorted({code.text for code in NoticeCode} | CHECK_TEXTS)


@pytest.mark.parametrize("text", TEXTS)
def test_other_words_keep_the_fields(text):
    other = reworded(text)
    assert other != text
    assert fields(other) == fields(text)
    assert other.count("[") == text.count("[")


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
