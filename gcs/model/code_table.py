"""Enumerations of codes, with more than a value for each: its level, its texts, and so on."""

from __future__ import annotations

from dataclasses import fields
from enum import StrEnum
from typing import Any, Self


class TableCode(StrEnum):
    """Code whose entry is a dataclass: `code` is the value, its other fields are attributes of the member."""

    def __new__(cls, entry: Any) -> Self:
        """Make a member from its entry."""
        member = str.__new__(cls, entry.code)
        member._value_ = entry.code
        for field in fields(entry):
            if field.name != "code":
                setattr(member, field.name, getattr(entry, field.name))
        return member
