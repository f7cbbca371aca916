"""Columns of a table of detections, found by their titles (see `docs/tracking.md`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.errors import ConfigError
from gcs.io.detections.table_files import DETECTION_TITLES, LOG_RATIO, ORIGIN, SENSOR, Table, title_error
from gcs.mistake_codes import MistakeCode
from gcs.model import BoolArray, FloatArray, IntArray, Sensor
from gcs.tracking.models.sensor_geometry import map_coordinates

_BEARING_UNIT_RAD: Final = {"bearing_deg": math.pi / 180.0, "bearing_rad": 1.0}
_MAX_BEARING_RAD: Final = 7.0
"""As for published scans: a turn and some noise."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Numbers of the columns; None for those that a table does not have."""

    time: str
    """Title of the first column, one of `TIME_TITLES`."""
    sensor: int | None
    position: tuple[int, int] | None
    polar: tuple[int, int] | None
    """Range and bearing."""
    bearing_unit_rad: float
    origin: int | None
    log_ratio: int | None

    def is_detection(self, rows: FloatArray) -> BoolArray:
        """Return True for each row (n,) with a detection; others are empty scans."""
        pairs = [rows[:, pair] for pair in (self.position, self.polar) if pair is not None]
        return np.asarray(~np.isnan(np.hstack(pairs)).all(axis=1))

    def positions(self, rows: FloatArray, sensor: Sensor) -> FloatArray:
        """Return east/north (n, 2) of a sensor's rows, NaN for a range below 0."""
        if self.polar is None or sensor.polar is None:
            assert self.position is not None
            return rows[:, self.position]
        z = rows[:, self.polar] * [1.0, self.bearing_unit_rad]
        z[z[:, 0] < 0.0] = np.nan
        return map_coordinates(sensor.polar, z)


def find_columns(table: Table) -> Columns:
    """Find the columns by their titles.

    Raises
    ------
    ConfigError
        A title is missing, or bearings are more than a turn.
    """
    bearing = next((title for title in _BEARING_UNIT_RAD if title in table.titles), "")
    position = table.pair("x", "y")
    polar = table.pair("range_m", bearing)
    if position is None and polar is None:
        raise title_error(table.path, DETECTION_TITLES, ",".join(table.titles))
    unit_rad = _BEARING_UNIT_RAD.get(bearing, 1.0)
    if polar is not None:
        largest = np.nanmax(np.abs(table.rows[:, polar[1]]), initial=0.0)
        if largest * unit_rad > _MAX_BEARING_RAD:
            problem = "expected bearings of at most a turn; are they in its unit?"
            raise ConfigError(str(table.path), bearing, MistakeCode.OUT_OF_RANGE, problem)
    sensor = table.column((SENSOR,))
    origin = table.column((ORIGIN,))
    log_ratio = table.column((LOG_RATIO,))
    return Columns(table.titles[0], sensor, position, polar, unit_rad, origin, log_ratio)


def sensor_of_rows(table: Table, columns: Columns, sensors: tuple[Sensor, ...]) -> IntArray:
    """Return the number of the sensor of each row (n,).

    Raises
    ------
    ConfigError
        The model does not have a row's sensor, or the table lacks the columns of its measurements.
    """
    names = [sensor.name for sensor in sensors]
    if columns.sensor is not None:
        number_of_word = np.array([names.index(w) if w in names else -1 for w in table.words], np.int64)
        word = table.rows[:, columns.sensor].astype(np.int64)
        number = number_of_word[word]
        if (number < 0).any():
            unknown = table.words[word[number < 0][0]]
            problem = f"{unknown!r} is not in the model, which has: {', '.join(names)}"
            raise ConfigError(str(table.path), SENSOR, MistakeCode.UNKNOWN_NAME, problem)
    elif len(sensors) == 1:
        number = np.zeros(len(table.rows), np.int64)
    else:
        problem = f"is missing; expected a column that names the sensor of each row: {', '.join(names)}"
        raise ConfigError(str(table.path), SENSOR, MistakeCode.MISSING_KEY, problem)
    for i in np.unique(number):
        if sensors[i].polar is None and columns.position is None:
            raise ConfigError(
                str(table.path),
                "x",
                MistakeCode.MISSING_KEY,
                f"is missing, but {names[i]} measures positions",
            )
    return number
