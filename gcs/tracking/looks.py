"""What a tracker takes of a scan: the detections that are usable, in the order in which gates find them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.tracking import gates, sensors

if TYPE_CHECKING:
    import numpy.typing as npt

    from gcs.model import FloatArray, Sensor

_LEAST_CLUTTER_PER_M2 = 1e-15


class Look(NamedTuple):
    """The usable detections of a scan, in the order of `gates.strips`."""

    z: FloatArray
    """(m, 2) as the sensor measured them."""
    place_m: FloatArray
    """(m, 2) east/north."""
    log_clutter: FloatArray
    """(m,) of the clutter intensity there, per unit of `z`."""
    rows: npt.NDArray[np.int64]
    """(m,) which detection of the scan each is."""
    taken: int
    """How many the scan had, usable or not."""


def look_at(sensor: Sensor, z_m: FloatArray, clutter_per_m2: FloatArray | None) -> Look:
    """Take detections (m, 2) that are finite, among clutter of such an intensity (m,) or of the sensor's."""
    place_m = np.array(z_m, dtype=np.float64).reshape(-1, 2)
    if clutter_per_m2 is None:
        clutter_per_m2 = sensors.clutter_per_m2(sensor, place_m)
    clutter = np.maximum(clutter_per_m2, _LEAST_CLUTTER_PER_M2) * sensors.cell_m2(sensor, place_m)
    z, log_clutter = sensors.measured(sensor, place_m), np.log(clutter)
    usable = np.isfinite(z[:, 0]) & np.isfinite(z[:, 1]) & np.isfinite(log_clutter)
    rows = np.arange(usable.size) if usable.all() else np.flatnonzero(usable)
    rows = rows[gates.strips(z if rows.size == usable.size else z[rows])]
    ordered = z[rows]
    return Look(ordered, ordered if z is place_m else place_m[rows], log_clutter[rows], rows, usable.size)
