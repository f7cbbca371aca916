"""What about detections does not fit their model: units, axes and origins that are not what somebody thought.

Such a mistake is no error in any cell, and shows as a poor result that one blames on the tracker.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, Protocol

import numpy as np

from gcs.io.detections.model_file import ModelTable, PositionSensor
from gcs.model import FloatArray, Sensor
from gcs.tracking.models.sensors import covers

_ENOUGH: Final = 20
"""Detections of a sensor: of fewer nothing is said."""
_SMALL: Final = 0.01
"""Share of a region's sides that uniform clutter does not keep to."""


class _Look(Protocol):
    @property
    def sensor(self) -> Sensor: ...
    @property
    def z_m(self) -> FloatArray: ...


def doubts(table: ModelTable, sensors: Sequence[Sensor], looks: Sequence[_Look]) -> tuple[str, ...]:
    """Say of which sensor most detections lie outside of what it sees, or all in a speck of it."""
    return tuple(text for i in range(len(sensors)) for text in _doubts(table, i, sensors[i], looks))


def _doubts(table: ModelTable, i: int, sensor: Sensor, looks: Sequence[_Look]) -> Iterator[str]:
    seen = np.concatenate([np.empty((0, 2)), *(look.z_m for look in looks if look.sensor is sensor)])
    seen = seen[np.isfinite(seen).all(axis=1)]
    if len(seen) < _ENOUGH:
        return
    made_of = table.sensors[i] if table.sensors else table
    if isinstance(made_of, PositionSensor | ModelTable) and made_of.region_m is not None:
        low, high = np.reshape(made_of.region_m, (2, 2))
        inside = ((low <= seen) & (seen <= high)).all(axis=1)
        where = "region_m"
        if (np.ptp(seen, axis=0) < _SMALL * (high - low)).all():
            size_m = np.ptp(seen, axis=0).max()
            yield (
                f"All {len(seen)} detections of {sensor.name} lie within {size_m:.3g} m of each other, in a "
                f"region_m of {high[0] - low[0]:.6g} m by {high[1] - low[1]:.6g} m: are they in metres?"
            )
    else:
        inside, where = covers(sensor, seen), "what it sees"
    outside = int((~inside).sum())
    if 2 * outside > len(seen):
        yield (
            f"{outside} of {len(seen)} detections of {sensor.name} lie outside {where}: "
            "are units, axes and origin those of the model?"
        )
