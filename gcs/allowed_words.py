"""Allowed words of a value: the error of a misspelt one lists them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin, get_type_hints

_INVALID = "Invalid enum value"


def with_allowed_words(problem: str, kind: Any, path: str = "") -> str:
    """Return an error of msgspec about a value; of a word that is not allowed, with those that are.

    `path` leads from a value of the type `kind` to the wrong one, such as ".frame" or "[3].kind".
    """
    if not problem.startswith(_INVALID):
        return problem
    for field in re.findall(r"\.(\w+)|\[", path):
        kind = next((one for part in _parts(kind) if (one := _child(part, field)) is not None), None)
    words = [f'"{word}"' for part in _parts(kind) if get_origin(part) is Literal for word in get_args(part)]
    expected = f"one of {', '.join(words)}" if len(words) > 1 else "".join(words)
    return f"expected {expected}, got{problem.removeprefix(_INVALID)}" if words else problem


def _parts(kind: Any) -> Iterator[Any]:
    """Yield a type, and those that it is made of by `Annotated` and `|`."""
    yield kind
    if get_origin(kind) is not Literal and get_origin(kind) not in (list, tuple, dict):
        for part in get_args(kind):
            yield from _parts(part)


def _child(kind: Any, field: str) -> Any:
    """Return the type of a field, or of the elements of a list if `field` is empty; None without one."""
    if not field:
        return get_args(kind)[0] if get_origin(kind) in (list, tuple) else None
    return get_type_hints(kind, include_extras=True).get(field) if isinstance(kind, type) else None
