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
    z, n = sensors.measured(sensor, place_m), place_m.shape[0]
    usable = np.isfinite(z).all(axis=1)
    if clutter_per_m2 is None and sensor.polar is None:
        log_clutter = np.full(n, np.log(max(sensor.clutter_density_per_m2, _LEAST_CLUTTER_PER_M2)))
    else:
        if clutter_per_m2 is None:
            clutter_per_m2 = sensors.clutter_per_m2(sensor, place_m)
        log_clutter = np.log(
            np.maximum(clutter_per_m2, _LEAST_CLUTTER_PER_M2) * sensors.cell_m2(sensor, place_m)
        )
        usable &= np.isfinite(log_clutter)
    if usable.all():
        rows = gates.strips(z)
    else:
        rows = np.flatnonzero(usable)
        rows = rows[gates.strips(z[rows])]
    ordered = z.take(rows, axis=0)
    places = ordered if z is place_m else place_m.take(rows, axis=0)
    return Look(ordered, places, log_clutter.take(rows), rows, n)
