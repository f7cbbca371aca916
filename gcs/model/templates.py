"""Templates of texts, with named fields in the form of `str.format`.

A part in square brackets is left out if one of its fields is missing or empty. Formats for fields, besides
Python's:

=============  ====================================================
``{x:agent}``   name of a vehicle: "17", or "2:17" on network 2
``{x:agents}``  names of vehicles: "agents 1, 3"
=============  ====================================================
"""

from __future__ import annotations

import string
from collections.abc import Mapping
from functools import cache
from typing import Any, Final, TypeAlias

from gcs.model.vehicle_ids import named, vehicle_name
from gcs.safe_text import printable

Parameter: TypeAlias = int | float | str | tuple[int, ...]


def plain_value(value: Parameter) -> Parameter:
    """Return a value of Python's own types (numbers may be numpy's), with printable characters only."""
    if isinstance(value, str):
        return printable(value)
    return float(value) if isinstance(value, float) else value


class _TextFormatter(string.Formatter):
    """Python's formatter, with names of vehicles."""

    def get_value(self, key: int | str, _args: object, kwargs: Mapping[str, Any]) -> Any:
        """Return a parameter; a dash for one that a recording of another version lacks."""
        return kwargs.get(str(key), "–")

    def format_field(self, value: Any, format_spec: str) -> str:
        """Return a value in words; a value of another type as it is."""
        try:
            match format_spec:
                case "agent":
                    return vehicle_name(value)
                case "agents":
                    return named(value)
            return str(super().format_field(value, format_spec))
        except (TypeError, ValueError):
            return str(value)


_FORMATTER: Final = _TextFormatter()


def fill(template: str, values: Mapping[str, Any]) -> str:
    """Return a template with its values."""
    return "".join(
        _FORMATTER.vformat(part, (), values)
        for part, names in _parts(template)
        if names is None or all(values.get(name) not in (None, "") for name in names)
    )


@cache
def _parts(template: str) -> tuple[tuple[str, frozenset[str] | None], ...]:
    """Return the parts of a template; optional ones, in square brackets, with the names of their fields."""
    parts: list[tuple[str, frozenset[str] | None]] = []
    for number, piece in enumerate(template.replace("]", "[").split("[")):
        names = frozenset(name for _, name, _, _ in _FORMATTER.parse(piece) if name)
        parts.append((piece, names if number % 2 else None))
    return tuple(parts)
