"""Sanitising of text from outside before it is shown or stored.

Texts of vehicles, sensors, ground stations and files may hold escape sequences that clear a screen or conceal
an alarm, and characters that reverse or hide others.
"""

from __future__ import annotations

import unicodedata

REPLACEMENT = "\N{REPLACEMENT CHARACTER}"
_SPACE = "Zs"
"""Unicode category of spaces, which Python does not call printable."""


def printable(text: str, keep: str = "") -> str:
    """Replace every character that is not shown as itself.

    These are control characters (C0, DEL, C1), format characters (bidirectional, zero-width, tags), line and
    paragraph separators, lone surrogates and unassigned code points.

    Parameters
    ----------
    text : str
        Text from outside.
    keep : str
        Characters to keep, such as a newline.
    """
    if text.isprintable():
        return text
    return "".join(c if _is_visible(c) or c in keep else REPLACEMENT for c in text)


def _is_visible(character: str) -> bool:
    return character.isprintable() or unicodedata.category(character) == _SPACE
