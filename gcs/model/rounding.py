"""Rounding of numbers as displays show them."""

from __future__ import annotations

import math


def rounded(value: float | None, digits: int = 1) -> float | None:
    """Return a number as it is shown; None for no number."""
    return None if value is None or not math.isfinite(value) else round(float(value), digits)


def rounded_place(east_m: float, north_m: float) -> tuple[float, float]:
    """Return a position as it is shown."""
    return round(float(east_m), 1), round(float(north_m), 1)
