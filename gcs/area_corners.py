"""Corners of an area: no-fly zones, fences and obstacles have three or more."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

_MIN_CORNERS: Final = 3


def corner_error(corners: Collection[object]) -> str:
    """Return what is wrong with the corners of an area; empty if nothing.

    Pass a set where repeated corners count once.
    """
    count = len(corners)
    return "" if count >= _MIN_CORNERS else f"expected at least three different corners, got {count}"
