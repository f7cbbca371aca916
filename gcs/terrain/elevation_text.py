"""Elevation models as text, so that a mission file carries the ground that it was planned on.

The text is JSON of one line: name and resolution of the file, the nodes, and their heights in decimetres. Of
those the text has the difference to what the three nodes to the south-west let expect, little-endian in 32
bits, byte by byte, compressed by zlib, in Base64.
"""

from __future__ import annotations

import base64
import math
import zlib
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Final

import msgspec
import numpy as np
from msgspec import Meta

from gcs.errors import TerrainFileError
from gcs.model import FloatArray
from gcs.terrain.elevation_grid import Elevation
from gcs.terrain.grid_nodes import MAX_NODES

_UNITS_PER_M: Final = 10.0
_MIN_UNITS: Final = -5_000 - 1
_MAX_UNITS: Final = 90_000 + 1

Number = Annotated[float, Meta(ge=-1e7, le=1e7)]
Length = Annotated[float, Meta(gt=0.0, le=1e6)]
Count = Annotated[int, Meta(ge=2, le=MAX_NODES)]


@dataclass(frozen=True, eq=False)
class ElevationModel:
    """Elevation of the ground, and where it is from.

    Attributes
    ----------
    file : str
        Name of the file.
    resolution_m : float
        Width of the file's pixels.
    elevation : Elevation
        The ground.
    remarks : tuple of str
        What a user should know of it.
    """

    file: str
    resolution_m: float
    elevation: Elevation
    remarks: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return file, resolution, and lowest and highest ground."""
        low = self.elevation.heights_msl_m.min()
        high = self.elevation.heights_msl_m.max()
        return f"{self.file}, pixels of {self.resolution_m:.3g} m, ground {low:.0f} to {high:.0f} m AMSL"


class _Text(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    file: str
    resolution_m: Length
    origin_m: tuple[Number, Number]
    spacing_m: Length
    shape: tuple[Count, Count]
    heights: str
    remarks: tuple[str, ...] = ()


def encode_model(model: ElevationModel) -> str:
    """Return the text of an elevation model."""
    elevation = model.elevation
    units = np.rint(elevation.heights_msl_m * _UNITS_PER_M).astype(np.int32)
    differences = np.diff(np.diff(units, axis=0, prepend=0), axis=1, prepend=0)
    by_byte = differences.astype("<i4").reshape(-1, 1).view(np.uint8).T
    text = _Text(
        file=model.file,
        resolution_m=model.resolution_m,
        origin_m=elevation.origin_m,
        spacing_m=elevation.spacing_m,
        shape=elevation.heights_msl_m.shape,
        heights=base64.b64encode(zlib.compress(by_byte.tobytes())).decode(),
        remarks=model.remarks,
    )
    return msgspec.json.encode(text).decode()


def is_model_text(text: str) -> bool:
    """Return True if a text is that of an elevation model, and not the name of a file."""
    return text.lstrip().startswith("{")


@lru_cache(maxsize=4)
def decode_model(text: str) -> ElevationModel:
    """Return the elevation model of a text.

    Raises
    ------
    TerrainFileError
        When the text is damaged.
    """
    try:
        found = msgspec.json.decode(text, type=_Text)
        heights_msl_m = _heights(found.heights, found.shape)
    except (ValueError, RecursionError, zlib.error) as error:
        raise TerrainFileError(f"a damaged elevation model ({error})") from None
    elevation = Elevation(found.origin_m, found.spacing_m, heights_msl_m)
    return ElevationModel(found.file, found.resolution_m, elevation, found.remarks)


def _heights(text: str, shape: tuple[int, int]) -> FloatArray:
    count = math.prod(shape)
    if count > MAX_NODES:
        raise ValueError(f"{count} nodes; expected {MAX_NODES} at most")
    inflate = zlib.decompressobj()
    data = inflate.decompress(base64.b64decode(text, validate=True), 4 * count)
    if len(data) != 4 * count:
        raise ValueError(f"{len(data)} bytes of heights; expected {4 * count}")
    by_byte = np.frombuffer(data, dtype=np.uint8).reshape(4, count)
    differences = np.ascontiguousarray(by_byte.T).view("<i4").reshape(shape).astype(np.int64)
    units = differences.cumsum(axis=1).cumsum(axis=0)
    if units.min() < _MIN_UNITS or units.max() > _MAX_UNITS:
        raise ValueError("heights out of range")
    return units / _UNITS_PER_M
