"""Warnings when detections do not fit their model: units, axes or an origin that differ.

No cell of such a file is wrong, and a poor result would be blamed on the tracker.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from gcs.io.detections.model_file import ModelTable, PositionSensor
from gcs.model import FloatArray, Sensor
from gcs.tracking.models.sensor_geometry import covers

_MIN_DETECTIONS: Final = 20
"""A sensor with fewer detections is not checked."""
_SMALL_SHARE: Final = 0.01
"""Share of a region's sides that uniform clutter exceeds."""


def sanity_warnings(model: ModelTable, sensors: Sequence[Sensor], z_m: Sequence[FloatArray]) -> list[str]:
    """Return a warning for each sensor with most detections outside its field, or all within a hundredth.

    `z_m` has the detections (m, 2) of each sensor.
    """
    return [text for i in range(len(sensors)) for text in _warnings(model, i, sensors[i], z_m[i])]


def _warnings(model: ModelTable, i: int, sensor: Sensor, z_m: FloatArray) -> Iterator[str]:
    z_m = z_m[np.isfinite(z_m).all(axis=1)]
    if len(z_m) < _MIN_DETECTIONS:
        return
    table = model.sensors[i] if model.sensors else model
    if isinstance(table, PositionSensor | ModelTable) and table.region_m is not None:
        low, high = np.reshape(table.region_m, (2, 2))
        inside = ((low <= z_m) & (z_m <= high)).all(axis=1)
        where = "region_m"
        if (np.ptp(z_m, axis=0) < _SMALL_SHARE * (high - low)).all():
            size_m = np.ptp(z_m, axis=0).max()
            yield (
                f"All {len(z_m)} detections of {sensor.name} lie within {size_m:.3g} m of each other, in a "
                f"region_m of {high[0] - low[0]:.6g} m by {high[1] - low[1]:.6g} m: are they in metres?"
            )
    else:
        inside = covers(sensor, z_m)
        where = "its field of view"
    outside = int((~inside).sum())
    if 2 * outside > len(z_m):
        yield (
            f"{outside} of {len(z_m)} detections of {sensor.name} lie outside {where}: "
            "are units, axes and origin those of the model?"
        )
