"""Plain data into tables, and what is wrong with it in words for somebody who edits TOML."""

from __future__ import annotations

import re
from typing import TypeVar

import msgspec

from gcs.errors import ConfigError

T = TypeVar("T")

_WORDS = {
    "object": "a table",
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
}
"""What msgspec calls types, and what somebody does who edits TOML."""
_WHERE = re.compile(r"^(?P<problem>.*?)(?: - at `(?P<path>[^`]*)`)?$", re.DOTALL)


class Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A TOML table: unknown keys are mistakes."""


def convert(raw: object, to: type[T], source: str, prefix: str = "") -> T:
    """Validate plain data against a table type.

    Raises
    ------
    ConfigError
        With the dotted key at fault and what was expected there.
    """
    try:
        return msgspec.convert(raw, to)
    except RecursionError:
        raise ConfigError(source, prefix, "is nested too deeply") from None
    except msgspec.ValidationError as error:
        match = _WHERE.match(str(error))
        assert match is not None
        path = (match["path"] or "$").removeprefix("$").removeprefix(".")
        key = ".".join(part for part in (prefix, path) if part)
        raise ConfigError(source, key, _plain(match["problem"])) from None


def _plain(problem: str) -> str:
    """Put msgspec's wording into words for somebody who edits TOML."""
    problem = re.sub(r"Object missing required field `(\w+)`", r"the key `\1` is missing here", problem)
    problem = re.sub(
        r"Object contains unknown field `(\w+)`",
        r"unknown key `\1`: misspelt, or in the wrong table?",
        problem,
    )
    problem = problem.replace(" | null`", "`")  # TOML has none: it is what a key without a value gets
    for word, plain in _WORDS.items():
        problem = problem.replace(f"`{word}`", plain)
    return problem.replace("Expected", "expected")
