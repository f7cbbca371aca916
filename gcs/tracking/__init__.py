"""GLMB multi-object tracking: pure numerics, no I/O.

Reading order:

- `glmb.filter` (`Glmb`), `glmb.params` (`GlmbParams`, `Birth`): the tracker and its parameters.
- `glmb.recursion`: the equations of the filter, and the steps of a scan.
- `glmb.kalman`, `glmb.gating`, `glmb.joint_association`, `glmb.scan_update`: prediction, association, update.
- `clusters`: labels that compete for detections are merged into clusters, associated and split again.
- `glmb.marginals`, `glmb.extraction`: existence, cardinality and state estimates.
- `trajectories`: whole paths from association histories, filtered and smoothed.
- `models`: motion, survival, sensor geometry, measurement models, clutter, adaptive birth, sensor estimation.
- `metrics`: OSPA, OSPA(2), GOSPA and others.
- `numerics`: sorting, exponentials and logarithms for kernels.

The names below are the public interface. They are imported at first use: `Glmb` imports numba.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gcs.model import Sensor
    from gcs.tracking.glmb.filter import Glmb
    from gcs.tracking.glmb.params import Birth, GlmbParams
    from gcs.tracking.metrics import gospa, ospa

__all__ = ["Birth", "Glmb", "GlmbParams", "Sensor", "gospa", "ospa"]

_MODULES = {
    "Birth": "gcs.tracking.glmb.params",
    "Glmb": "gcs.tracking.glmb.filter",
    "GlmbParams": "gcs.tracking.glmb.params",
    "Sensor": "gcs.model",
    "gospa": "gcs.tracking.metrics",
    "ospa": "gcs.tracking.metrics",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)
