"""The detections of a scan: validated, in sensor coordinates, and sorted for gating.

===================  =============  =======  ===================================================
array                shape          dtype    meaning (m detections)
===================  =============  =======  ===================================================
z                    (m, 2)         float64  sensor coordinates: east/north or range/bearing
position_m           (m, 2)         float64  east, north
log_clutter          (m,) or (1,)   float64  log of the clutter intensity per unit of `z`
rows (ordered)       (m,)           int64    row of each usable detection in the scan
===================  =============  =======  ===================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined
from gcs.tracking.glmb.gating import sort_into_strips
from gcs.tracking.models import sensor_geometry
from gcs.tracking.numerics.sorting import head

if TYPE_CHECKING:
    from gcs.model import FloatArray, IntArray, Sensor

_MIN_CLUTTER_PER_M2 = 1e-15


class Measurements(NamedTuple):
    """All detections of a scan."""

    z: FloatArray
    position_m: FloatArray
    log_clutter: FloatArray


class OrderedMeasurements(NamedTuple):
    """The usable detections of a scan, in the order of `gating.sort_into_strips`."""

    z: FloatArray
    position_m: FloatArray
    log_clutter: FloatArray
    rows: IntArray


def scan_measurements(sensor: Sensor, z_m: FloatArray, clutter_per_m2: FloatArray | None) -> Measurements:
    """Return detections (m, 2) with a clutter intensity (m,), or with that of the sensor.

    Raises
    ------
    ValueError
        If the shape is not (m, 2).
    """
    position_m = np.array(z_m, dtype=np.float64, order="C")
    if position_m.size and (position_m.ndim != 2 or position_m.shape[1] != 2):
        raise ValueError(f"expected detections (m, 2), east and north; got the shape {position_m.shape}")
    position_m = position_m.reshape(-1, 2)
    z = sensor_geometry.sensor_coordinates(sensor, position_m)
    if clutter_per_m2 is None and sensor.polar is None:
        clutter = np.array([sensor.clutter_density_per_m2], dtype=np.float64)
    elif clutter_per_m2 is None:
        clutter = sensor_geometry.clutter_per_m2(sensor, position_m)
    else:
        clutter = np.array(clutter_per_m2, dtype=np.float64)
    clutter = np.maximum(clutter, _MIN_CLUTTER_PER_M2)
    if sensor.polar is not None:
        clutter = clutter * sensor_geometry.cell_area_m2(sensor, position_m)
    return Measurements(z, position_m, np.log(clutter))


@inlined
def order_measurements(scan: Measurements) -> OrderedMeasurements:
    """Select the detections with finite coordinates and clutter intensity, and sort them."""
    step = 0 if scan.log_clutter.size == 1 else 1
    rows = np.empty(scan.z.shape[0], np.int64)
    n = ZERO
    for j in range(scan.z.shape[0]):
        x = scan.z[j, 0]
        y = scan.z[j, 1]
        clutter = scan.log_clutter[j * step]
        if np.isfinite(x) and np.isfinite(y) and np.isfinite(clutter):
            rows[n] = j
            n += 1
    rows = head(rows, n)
    sort_into_strips(scan.z, rows)
    z = np.empty((n, 2))
    position_m = np.empty((n, 2))
    log_clutter = np.empty(n)
    for i in range(n):
        j = rows[i]
        log_clutter[i] = scan.log_clutter[j * step]
        for axis in range(2):
            z[i, axis] = scan.z[j, axis]
            position_m[i, axis] = scan.position_m[j, axis]
    return OrderedMeasurements(z, position_m, log_clutter, rows)
