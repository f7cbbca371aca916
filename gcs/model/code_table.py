"""Enumerations of codes, with more than a value for each: its level, its texts, and so on."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Self, TypeAlias

Entry: TypeAlias = tuple[str, Mapping[str, object]]
"""Code, and the attributes of its member."""


class TableCode(StrEnum):
    """Code whose members are made from entries."""

    def __new__(cls, code: str, attributes: Mapping[str, object]) -> Self:
        """Make a member from its entry."""
        member = str.__new__(cls, code)
        member._value_ = code
        for name, value in attributes.items():
            setattr(member, name, value)
        return member
