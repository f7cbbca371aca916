"""Ellipse of a target: its last estimate, and the corners of the outline that has it with 95 % probability.

Targets are on the ground: that of the elevation model, or level ground at the height of the mission's origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.model import Label, Track, target_name
from gcs.report.export.mission_frame import MissionFrame, Place

CHI2_95: Final = -2.0 * math.log(0.05)
"""95 % quantile of chi-square with two degrees of freedom."""
_OUTLINE_POINTS: Final = 36


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """Last estimate of a target."""

    label: Label
    t_ns: int
    place: Place
    existence: float
    semi_axes_m: tuple[float, float]
    """Larger and smaller semi-axis of the ellipse that has the target with a probability of 95 %."""
    azimuth_deg: float
    """Direction of the larger semi-axis, clockwise from north, in [0, 180)."""
    outline: tuple[Place, ...]
    """Vertices of the ellipse, anticlockwise, the first one repeated."""

    @property
    def name(self) -> str:
        """Name for a display."""
        return f"target {target_name(self.label)}"

    @property
    def uncertainty(self) -> str:
        """Uncertainty in words."""
        larger_m, smaller_m = self.semi_axes_m
        return f"95 % ellipse {larger_m:.0f} m by {smaller_m:.0f} m towards {self.azimuth_deg:.0f} degrees"


def target_estimate(frame: MissionFrame, t_ns: int, track: Track) -> TargetEstimate:
    """Return a track of a target with its ellipse on the map of a mission."""
    centre_m = track.mean[:2]
    variances, axes = np.linalg.eigh(track.cov[:2, :2])
    semi_m = np.sqrt(CHI2_95 * np.maximum(variances, 0.0))
    east, north = axes[:, 1].tolist()
    turns = np.linspace(0.0, math.tau, _OUTLINE_POINTS + 1)
    handed = 1.0 if np.linalg.det(axes) < 0.0 else -1.0
    outline_m = (
        centre_m
        + np.outer(np.cos(turns), semi_m[1] * axes[:, 1])
        + np.outer(handed * np.sin(turns), semi_m[0] * axes[:, 0])
    )
    outline = [frame.place(*point) for point in outline_m[:-1].tolist()]
    return TargetEstimate(
        track.label,
        t_ns,
        frame.place(*centre_m.tolist()),
        track.existence,
        (float(semi_m[1]), float(semi_m[0])),
        math.degrees(math.atan2(east, north)) % 180.0,
        (*outline, outline[0]),
    )
