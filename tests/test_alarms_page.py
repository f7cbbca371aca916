"""An operator would miss an alarm in the docs: the page of alarms quotes the program's texts."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "alarms.md").read_text(encoding="utf-8")


def quoted() -> list[str]:
    """Pieces of notices that the page quotes: first cells of its rows, between backticks."""
    cells = [row.split("|")[1] for row in PAGE.splitlines() if re.match(r"\| (alarm|warning|info) ", row)]
    found = [
        piece.strip(" :")
        for cell in cells
        for text in re.findall("`(.*?)`", cell)
        for piece in text.split("…")
    ]
    return [piece for piece in found if len(piece) > 3]


def test_every_text_that_the_page_quotes_is_in_the_program():
    source = " ".join(
        re.sub(r'"\s*\n\s*f?"', "", path.read_text(encoding="utf-8")) for path in (ROOT / "gcs").rglob("*.py")
    )
    # A text that is built of parts is searched by its parts.
    pieces = [part for piece in quoted() for part in re.split(r"(?<=rejected): |: (?=is the)", piece)]
    assert len(pieces) > 50
    assert [piece for piece in pieces if piece not in source] == []
