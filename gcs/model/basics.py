"""Types that all records share: arrays, labels, time."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, get_args

import msgspec
import numpy as np
import numpy.typing as npt

NS_PER_S = 1_000_000_000

FloatArray: TypeAlias = npt.NDArray[np.float64]
Float32Array: TypeAlias = npt.NDArray[np.float32]
IntArray: TypeAlias = npt.NDArray[np.int64]
Int32Array: TypeAlias = npt.NDArray[np.int32]
UInt32Array: TypeAlias = npt.NDArray[np.uint32]
Int16Array: TypeAlias = npt.NDArray[np.int16]
UInt16Array: TypeAlias = npt.NDArray[np.uint16]
ByteArray: TypeAlias = npt.NDArray[np.uint8]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
KeyArray: TypeAlias = npt.NDArray[np.uint64]
"""Hash keys, or the state of a random generator."""

Label: TypeAlias = tuple[int, int]
"""Identity of a track: (scan count at its birth, index within that scan); ordered."""

Kind: TypeAlias = Literal["agents", "targets"]

Level: TypeAlias = Literal["info", "warning", "alarm"]


def read_only(array: npt.ArrayLike) -> FloatArray:
    """Return a read-only float64 copy of an array."""
    result = np.array(array, dtype=np.float64)
    result.flags.writeable = False
    return result


def array_parts(array: npt.NDArray[Any]) -> tuple[str, tuple[int, ...], bytes]:
    """Return dtype, shape and bytes of an array, for MessagePack."""
    return array.dtype.str, array.shape, np.ascontiguousarray(array).tobytes()


def array_of_parts(expected: Any, parts: Any) -> npt.NDArray[Any]:
    """Return the read-only array of `array_parts`; `expected` is its type, such as `FloatArray`.

    Raises
    ------
    ValueError, msgspec.ValidationError
        If it is none, or of another dtype.
    """
    dtype, shape, data = msgspec.convert(parts, tuple[str, tuple[int, ...], bytes])
    wanted = np.dtype(get_args(get_args(expected)[1])[0])
    if dtype != wanted.str:
        raise ValueError(f"expected an array of {wanted}, got {dtype}")
    return np.frombuffer(data, wanted).reshape(shape)
