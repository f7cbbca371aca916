"""Text from outside, made safe to show and to store.

What vehicles, sensors, other ground stations and files say may hold escape sequences that clear a screen,
write to a clipboard or conceal an alarm, and characters that turn or hide what follows them.
"""

from __future__ import annotations

import unicodedata

REPLACEMENT = "\N{REPLACEMENT CHARACTER}"
_SPACE = "Zs"
"""The Unicode category of spaces, which Python does not call printable."""


def printable(text: str, keep: str = "") -> str:
    """Replace every character that is not shown as itself.

    These are control characters (C0, DEL, C1), format characters (bidirectional, zero-width, tags), line and
    paragraph separators, lone surrogates and what Unicode has not assigned.

    Parameters
    ----------
    text : str
        From outside.
    keep : str
        Characters that stay, such as a newline.
    """
    if text.isprintable():
        return text
    return "".join(c if _is_shown(c) or c in keep else REPLACEMENT for c in text)


def _is_shown(character: str) -> bool:
    return character.isprintable() or unicodedata.category(character) == _SPACE
