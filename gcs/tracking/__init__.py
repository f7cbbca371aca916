"""GLMB multi-object tracking: pure numerics, no I/O.

Reading order:

- `batch` (`track`): a whole data set, in arrays.
- `glmb.filter` (`Glmb`), `glmb.params` (`GlmbParams`, `Birth`): the tracker and its parameters.
- `glmb.recursion`: the equations of the filter, and the steps of a scan.
- `glmb.kalman`, `glmb.gating`, `glmb.joint_association`, `glmb.scan_update`: prediction, association, update.
- `clusters`: labels that compete for detections are merged into clusters, associated and split again.
- `glmb.marginals`, `glmb.extraction`: existence, cardinality and state estimates.
- `trajectories`: whole paths from association histories, filtered and smoothed.
- `state_space`: the same filter with motion and measurement models of the user, in states of any dimension.
- `models`: motion, survival, sensor geometry, measurement models, clutter, adaptive birth, sensor estimation.
- `metrics`: OSPA, OSPA(2), GOSPA and others.
- `numerics`: sorting, exponentials and logarithms for kernels.

The names in `__all__` are the public interface (`docs/library.md`). They are imported at first use: `Glmb`
imports numba.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

if TYPE_CHECKING:
    from gcs.model import Polar, Sensor
    from gcs.tracking.batch import SensorScan, TrackingModel, TrackSet, Trajectory, track, track_scans
    from gcs.tracking.glmb.extraction import Estimates
    from gcs.tracking.glmb.filter import Glmb
    from gcs.tracking.glmb.params import Birth, GlmbParams
    from gcs.tracking.metrics import cardinality_error, gospa, identity_switches, ospa, ospa2
    from gcs.tracking.models.sensor_geometry import map_coordinates, polar_sensor, sector
    from gcs.tracking.state_space.filter import StateSpaceGlmb
    from gcs.tracking.state_space.models import (
        MeasurementModel,
        MotionModel,
        SwitchingMotion,
        constant_velocity,
        linear_measurement,
        linear_motion,
    )

Estimator: TypeAlias = Literal["filtered", "recovered", "smoothed"]
"""Estimates at each scan; whole paths afterwards; or smoothed paths (see `batch`)."""

__all__ = [
    "Birth",
    "Estimates",
    "Estimator",
    "Glmb",
    "GlmbParams",
    "MeasurementModel",
    "MotionModel",
    "Polar",
    "Sensor",
    "SensorScan",
    "StateSpaceGlmb",
    "SwitchingMotion",
    "TrackSet",
    "TrackingModel",
    "Trajectory",
    "cardinality_error",
    "constant_velocity",
    "gospa",
    "identity_switches",
    "linear_measurement",
    "linear_motion",
    "map_coordinates",
    "ospa",
    "ospa2",
    "polar_sensor",
    "sector",
    "track",
    "track_scans",
]

_PARTS: Final = {
    "gcs.model": ("Polar", "Sensor"),
    "gcs.tracking.batch": (
        "SensorScan", "TrackSet", "TrackingModel", "Trajectory", "track", "track_scans",
    ),
    "gcs.tracking.glmb.extraction": ("Estimates",),
    "gcs.tracking.glmb.filter": ("Glmb",),
    "gcs.tracking.glmb.params": ("Birth", "GlmbParams"),
    "gcs.tracking.metrics": ("cardinality_error", "gospa", "identity_switches", "ospa", "ospa2"),
    "gcs.tracking.models.sensor_geometry": ("map_coordinates", "polar_sensor", "sector"),
    "gcs.tracking.state_space.filter": ("StateSpaceGlmb",),
    "gcs.tracking.state_space.models": (
        "MeasurementModel", "MotionModel", "SwitchingMotion", "constant_velocity", "linear_measurement",
        "linear_motion",
    ),
}  # fmt: skip
_MODULES: Final = {name: module for module, names in _PARTS.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name at first use (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)
