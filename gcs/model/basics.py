"""Types that all records share: arrays, labels, time."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

NS_PER_S = 1_000_000_000

FloatArray: TypeAlias = npt.NDArray[np.float64]

Label: TypeAlias = tuple[int, int]
"""Identity of a track: (scan count at its birth, index within that scan); ordered."""

Kind: TypeAlias = Literal["agents", "targets"]

Level: TypeAlias = Literal["info", "warning", "alarm"]


def read_only(array: npt.ArrayLike) -> FloatArray:
    """Return a read-only float64 copy of an array."""
    result = np.array(array, dtype=np.float64)
    result.flags.writeable = False
    return result
