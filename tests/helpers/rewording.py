"""Other words for notices and checks: tests that pass with them read codes and parameters, not texts."""

from __future__ import annotations

import codecs
import re

from gcs.core.preflight.check_codes import CheckCode
from gcs.model import NoticeCode


def reword_notices() -> None:
    """Replace the text of every code of a notice or check; its fields stay."""
    for code in NoticeCode:
        code.text = reworded(code.text)
    for check in CheckCode:
        for part in ("found", "wanted", "remedy"):
            if text := getattr(check, part):
                setattr(check, part, reworded(text))


def reworded(template: str) -> str:
    """Return a template with its letters replaced, except for those of its fields."""
    pieces = re.split(r"(\{.*?\})", template)
    return "§ " + "".join(
        piece if piece.startswith("{") else codecs.encode(piece, "rot13") for piece in pieces
    )
