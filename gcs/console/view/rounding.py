"""Numbers as pages show them."""

from __future__ import annotations

import math


def rounded(value: float | None, digits: int = 1) -> float | None:
    """Return a number as it is shown; None for no number."""
    return None if value is None or not math.isfinite(value) else round(float(value), digits)
