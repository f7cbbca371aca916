"""Kinds of mistakes in mission files, models, other files that are read, and options.

``python -m gcs.mistake_codes`` writes them as a table. A test compares it with `docs/operations.md`.
"""

from __future__ import annotations

import sys
from enum import StrEnum
from typing import Self


class MistakeCode(StrEnum):
    """Kind of a mistake. Its value is stable."""

    meaning: str

    def __new__(cls, code: str, meaning: str) -> Self:
        """Make a member from its code and what it means."""
        member = str.__new__(cls, code)
        member._value_ = code
        member.meaning = meaning
        return member

    NOT_FOUND = "not-found", "a file, folder or library that is needed is not there"
    NO_ACCESS = "no-access", "a file cannot be read or written: permissions, kind, or disk"
    INVALID_FILE = "invalid-file", "the file as a whole is not of the expected kind, or breaks its syntax"
    MISSING_KEY = "missing-key", "a key, table, column or option that is needed here is not given"
    UNKNOWN_KEY = "unknown-key", "there is no such key or table here"
    WRONG_TYPE = "wrong-type", "the value is of another type, or its text of another form"
    OUT_OF_RANGE = "out-of-range", "the number, or the length of the list, is not in the allowed range"
    UNKNOWN_NAME = "unknown-name", "the value is none of the allowed words, or names nothing that there is"
    DUPLICATE = "duplicate", "what must be unique is there twice: an id, a name, an endpoint"
    CONFLICT = "conflict", "this key and another one contradict or exclude each other"
    OUTSIDE_MAP = "outside-map", "a position is outside the map, the fence or the elevation model"
    BAD_SHAPE = "bad-shape", "corners make no polygon, or bounds no box"
    TOO_LARGE = "too-large", "the file holds more than is read"
    EXISTS = "exists", "the file, key or certificate that would be written is there already"
    INSECURE = "insecure", "others could read a key, change a list of nodes, or command the vehicles"
    BAD_CREDENTIALS = "bad-credentials", "a certificate or its key is damaged, expired, or not the one needed"


def mistake_table() -> str:
    """Return the codes with their meaning as a table in Markdown."""
    rows = [f"| `{code}` | {code.meaning} |" for code in MistakeCode]
    return "\n".join(["| code | meaning |", "|---|---|", *rows]) + "\n"


if __name__ == "__main__":
    sys.stdout.write(mistake_table())
