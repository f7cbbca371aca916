"""Places in degrees in a mission file, converted to the local frame before validation.

A position is `east_m` and `north_m`, or `lat_deg` and `lon_deg`. All tables have metres.
"""

from __future__ import annotations

import math
from typing import Any

from gcs.config.schema import FrameTable, Latitude, Longitude
from gcs.config.validation import Table, convert
from gcs.errors import ConfigError
from gcs.geo import LocalFrame
from gcs.mistake_codes import MistakeCode

_DEGREES = ("lat_deg", "lon_deg")
_METRES = ("east_m", "north_m")
_MAX_DISTANCE_M = 100_000.0
"""Maximum distance from the origin; a tangent plane is inaccurate beyond."""
_DIGITS = 3
"""Rounding to millimetres keeps a corner of the map inside it."""


class _Degrees(Table, frozen=True, kw_only=True):
    lat_deg: Latitude
    lon_deg: Longitude


def with_local_places(raw: object, source: str) -> tuple[object, list[ConfigError]]:
    """Return the plain data of a mission file with positions in metres, and the mistakes in them.

    A mistake is a position given in both ways or in part, an invalid one, or one far from the frame's origin.
    It is replaced by the origin, so that the rest of its row can be validated.
    """
    if not isinstance(raw, dict) or not isinstance(raw.get("frame"), dict):
        return raw, []  # validation refuses this
    rows = {name: raw[name] for name in ("agents", "births") if isinstance(raw.get(name), list)}
    if not any(_is_in_degrees(row) for some in rows.values() for row in some):
        return raw, []
    try:
        table = convert(raw["frame"], FrameTable, source, "frame")
        frame = LocalFrame(table.lat_deg, table.lon_deg, table.alt_msl_m)
    except ConfigError:
        frame = None  # validation refuses this
    mistakes: list[ConfigError] = []
    local = {name: _all_local(some, frame, source, name, mistakes) for name, some in rows.items()}
    return raw | local, mistakes


def local_places(rows: list[Any], frame: LocalFrame, source: str, key: str) -> list[Any]:
    """Return rows of a list of tables with `east_m` and `north_m` in place of `lat_deg` and `lon_deg`.

    Raises
    ------
    ConfigError
        For the mistakes of `with_local_places`.
    """
    mistakes: list[ConfigError] = []
    local = _all_local(rows, frame, source, key, mistakes)
    if mistakes:
        raise ConfigError.of_all(mistakes)
    return local


def _all_local(
    rows: list[Any], frame: LocalFrame | None, source: str, key: str, mistakes: list[ConfigError]
) -> list[Any]:
    local = []
    for index, row in enumerate(rows):
        if _is_in_degrees(row):
            east_m = north_m = 0.0
            try:
                east_m, north_m = _local(row, frame, source, f"{key}[{index}]")
            except ConfigError as error:
                mistakes.append(error)
            rest = {name: value for name, value in row.items() if name not in _DEGREES}
            row = rest | {"east_m": round(east_m, _DIGITS), "north_m": round(north_m, _DIGITS)}
        local.append(row)
    return local


def _is_in_degrees(row: object) -> bool:
    return isinstance(row, dict) and any(name in row for name in _DEGREES)


def _local(row: Any, frame: LocalFrame | None, source: str, key: str) -> tuple[float, float]:
    metres = [name for name in _METRES if name in row]
    if metres:
        given = " and ".join([*metres, *(name for name in _DEGREES if name in row)])
        expected = "expected either `east_m` and `north_m`, or `lat_deg` and `lon_deg`"
        raise ConfigError(source, key, MistakeCode.CONFLICT, f"{expected}, got {given}")
    place = convert({name: row[name] for name in _DEGREES if name in row}, _Degrees, source, key)
    if frame is None:
        return 0.0, 0.0
    east_m, north_m = frame.to_local(place.lat_deg, place.lon_deg)
    distance_m = math.hypot(east_m, north_m)
    if distance_m > _MAX_DISTANCE_M or math.cos(math.radians(place.lon_deg - frame.lon_deg)) < 0.0:
        raise ConfigError(
            source,
            key,
            MistakeCode.OUTSIDE_MAP,
            f"{place.lat_deg}°, {place.lon_deg}° lies far from the frame's origin "
            f"({frame.lat_deg:.3f}°, {frame.lon_deg:.3f}°); are latitude and longitude swapped?",
        )
    return east_m, north_m
