"""A newcomer would search for a file that is not there, or does something else."""

from __future__ import annotations

from pathlib import Path

from helpers.modules_page import modules_page

PAGE = Path(__file__).parents[1] / "docs" / "modules.md"


def test_the_page_is_what_the_files_say() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert modules_page() == text, "run: python tests/helpers/modules_page.py > docs/modules.md"
