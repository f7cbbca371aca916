"""Which column of a table of detections is what: when, by which sensor, and where.

The first column is the scan (k) or a time (t_s, t_ns); the others are found by their titles: x and y,
`sensor` for the name of each row's sensor, and `range_m` with `bearing_deg` or `bearing_rad`, what a
range/bearing sensor measured, clockwise from north. A table without titles has the columns k, x, y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from gcs.errors import ConfigError
from gcs.io.detections.tables import FIRST, SENSOR, Numbers
from gcs.model import FloatArray, Sensor
from gcs.tracking.models.sensors import map_coordinates

TIMES: Final = {"t_s": 1e9, "t_ns": 1.0}
"""Titles of a first column that is a time, and what makes nanoseconds of it."""
ORIGIN: Final = "src"
"""Title of the number of a detection's true object, 0 for clutter."""
_BEARINGS: Final = {"bearing_deg": math.pi / 180.0, "bearing_rad": 1.0}
_MOST_BEARING_RAD: Final = 7.0
"""As of those that are published: a turn and some noise."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Numbers of the columns; None for those that a table has not."""

    time: str
    """Title of the first one: "k" or one of `TIMES`."""
    sensor: int | None
    place: tuple[int, int] | None
    """x, y."""
    polar: tuple[int, int] | None
    """Range and bearing."""
    origin: int | None
    """Number of the true object of a detection, for `gcs track --baseline true-association` only."""
    bearing_rad: float = 1.0
    """What makes radians of a bearing."""

    def measured(self, rows: FloatArray) -> npt.NDArray[np.bool_]:
        """Return which rows (n,) are detections; the others say that a sensor looked and saw nothing."""
        pairs = [rows[:, pair] for pair in (self.place, self.polar) if pair is not None]
        return np.asarray(~np.isnan(np.hstack(pairs)).all(axis=1))

    def places(self, rows: FloatArray, sensor: Sensor) -> FloatArray:
        """Return east/north (n, 2) of a sensor's rows, NaN for a range below 0."""
        if self.polar is None or sensor.polar is None:
            assert self.place is not None
            return rows[:, self.place]
        z = rows[:, self.polar] * [1.0, self.bearing_rad]
        z[z[:, 0] < 0.0] = np.nan
        return map_coordinates(sensor.polar, z)


def columns(path: Path, numbers: Numbers) -> Columns:
    """Find the columns by their titles.

    Raises
    ------
    ConfigError
        When one is missing.
    """
    if not numbers.titles:
        return Columns("k", None, (1, 2), None, 3 if numbers.rows.shape[-1] > 3 else None)
    time = numbers.titles[0]
    if time not in FIRST:
        expected = "is the title of the first column; expected k, t_s or t_ns"
        raise ConfigError(str(path), time, expected)
    titles = {title: i for i, title in reversed(list(enumerate(numbers.titles)))}
    bearings = [title for title in _BEARINGS if title in titles]
    if ("range_m" in titles) != (len(bearings) == 1):
        raise ConfigError(str(path), "range_m", f"expected a range_m with one of {', '.join(_BEARINGS)}")
    place = (titles["x"], titles["y"]) if "x" in titles and "y" in titles else None
    polar = (titles["range_m"], titles[bearings[0]]) if bearings else None
    if place is None and polar is None:
        raise ConfigError(str(path), "x", "is missing; expected columns x,y or range_m,bearing_deg")
    if numbers.rows.shape[1] < len(numbers.titles):
        found = f"{len(numbers.titles)} columns as the titles say, found {numbers.rows.shape[1]}"
        raise ConfigError(str(path), "", f"expected {found}")
    scale = _BEARINGS[bearings[0]] if bearings else 1.0
    if (
        polar is not None
        and np.nanmax(np.abs(numbers.rows[:, polar[1]]), initial=0.0) * scale > _MOST_BEARING_RAD
    ):
        raise ConfigError(
            str(path), bearings[0], "expected bearings of at most a turn; are they in its unit?"
        )
    return Columns(time, titles.get(SENSOR), place, polar, titles.get(ORIGIN), scale)


def which(path: Path, numbers: Numbers, found: Columns, sensors: tuple[Sensor, ...]) -> npt.NDArray[np.int64]:
    """Return which of the model's sensors made each row (n,).

    Raises
    ------
    ConfigError
        When a row's sensor is not in the model, or measures what the table has no columns for.
    """
    names = [sensor.name for sensor in sensors]
    if found.sensor is None:
        if len(sensors) > 1:
            listed = ", ".join(names)
            raise ConfigError(
                str(path),
                SENSOR,
                f"is missing; expected a column that names the sensor of each row: {listed}",
            )
        number = np.zeros(len(numbers.rows), np.int64)
    else:
        word = numbers.rows[:, found.sensor].astype(np.int64)
        of_word = np.array([names.index(w) if w in names else -1 for w in numbers.words], np.int64)
        number = of_word[word]
        if (number < 0).any():
            unknown = numbers.words[word[number < 0][0]]
            listed = ", ".join(names)
            raise ConfigError(str(path), SENSOR, f"{unknown!r} is not in the model, which has: {listed}")
    if found.place is None:
        for i in np.unique(number):
            if sensors[i].polar is None:
                raise ConfigError(str(path), "x", f"is missing, but {names[i]} measures positions")
    return number
