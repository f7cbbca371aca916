"""Estimation of a sensor's clutter rate and detection probability from its own scans.

The tracker uses the values that a sensor announces. A clutter rate announced too low lets clutter pass for
objects. A detection probability announced too high lets missed objects be dropped. Both show in the scans:

- clutter is what no track explains: the sum of 1 - P(explained) over a scan is Poisson with the announced
  mean;
- objects that certainly existed before the scan, and were in view, are detected with p_D. A missed object is
  not certain until it is detected again, so that a death counts once.

Means fade with a memory of 60 scans. A contradiction is reported if it is significant (five standard
deviations) and large. It ends when the difference is small; the hysteresis avoids repeated reports.

`corrected` returns the sensor with the estimates, in which the announced values count as some first scans.

A filter takes the misses of successive scans as independent. Those of one sensor are not, the less the
shorter the time between scans: what hides an object, or is wrong with the sensor, lasts. `bounded` limits
what they count: within a time dt <= 1 s an object in view is missed with a probability of at least
``MIN_MISSED_PER_S ** dt``. So no rate of scans, and no announced detection probability, tells more against
a track in a second (`docs/decisions/0057-misses-of-one-sensor-are-bounded.md`). Where another sensor looks,
too, it is the square root of that: what one sensor alone would tell needs the misses of two
(`docs/decisions/0063-two-sensors-decide.md`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.models.sensor_geometry import expected_clutter

_MEMORY_SCANS = 60.0
_CERTAIN_STD = 5.0
_MIN_SCANS = 10.0
_MIN_OBJECTS = 30.0
_CLUTTER_FACTOR = 2.0
_CLUTTER_AGREEMENT_FACTOR = 1.5
_DETECTION_DEVIATION = 0.1
_DETECTION_AGREEMENT = 0.05
_PRIOR_SCANS = 10.0
"""Scans that an announced clutter rate counts for in a correction."""
_PRIOR_OBJECTS = 20.0
"""Detected objects that an announced detection probability counts for in a correction."""
_MAX_CLUTTER_CORRECTION = 50.0
"""Largest factor of a correction of the clutter rate."""
MIN_MISSED_PER_S = 0.005
"""Least probability that one sensor misses an object in view in all its scans of a second."""
MIN_MISSED_SHARED_PER_S = math.sqrt(MIN_MISSED_PER_S)
"""The same while another sensor looks at a part of its field of view."""
_SHARED_NS = 5 * NS_PER_S
"""Time from a sensor's last scan for which it looks there."""
_MIN_DETECTION = 0.05
_MAX_DETECTION = 0.999


Quantity: TypeAlias = Literal["clutter", "detection"]


class Finding(NamedTuple):
    """A change in the agreement between a sensor's announced and estimated values."""

    quantity: Quantity
    """Clutter: false detections a scan. Detection: fraction of the objects in view that are detected."""
    is_contradiction: bool
    """False if a reported contradiction has ended."""
    estimated: float
    announced: float


@dataclass(slots=True)
class FadingMean:
    """A fading mean; `n` is its effective number of samples."""

    total: float = 0.0
    weight: float = 0.0
    squares: float = 0.0

    def add(self, total: float, samples: float = 1.0) -> None:
        """Add the total of some samples."""
        if samples <= 0.0:
            return
        fade = 1.0 - 1.0 / _MEMORY_SCANS
        self.total = fade * self.total + total
        self.weight = fade * self.weight + samples
        self.squares = fade * fade * self.squares + samples

    @property
    def value(self) -> float:
        """The mean; 0 without samples."""
        return self.total / self.weight if self.weight else 0.0

    @property
    def n(self) -> float:
        """Effective number of samples."""
        return self.weight**2 / self.squares if self.squares else 0.0


@dataclass(slots=True)
class SensorEstimation:
    """Estimates of one sensor."""

    clutter: FadingMean = field(default_factory=FadingMean)
    """False detections of a scan."""
    detected: FadingMean = field(default_factory=FadingMean)
    """Share of the objects in view that are detected."""
    contradicts: dict[str, bool] = field(default_factory=dict)
    """True for each value, "clutter" or "detection", with a reported contradiction."""
    scan_t_ns: int | None = None
    """Measurement time of the last scan."""
    field_m: tuple[float, float, float, float] | None = None
    """Its field of view: least east and north, greatest east and north."""

    def looks_there(self, sensor: Sensor, t_ns: int) -> bool:
        """Return True if this sensor's last scan is recent, and of a part of another one's field of view."""
        if self.scan_t_ns is None or self.field_m is None or t_ns - self.scan_t_ns > _SHARED_NS:
            return False
        west, south, east, north = self.field_m
        other_west, other_south, other_east, other_north = sensor.field_of_view_m
        return west < other_east and other_west < east and south < other_north and other_south < north

    def bounded(self, sensor: Sensor, t_ns: int, *, is_shared: bool = False) -> Sensor:
        """Return the sensor of the next scan, measured at `t_ns`, with a bounded detection probability.

        `is_shared` means that another sensor looks at a part of its field of view.
        """
        passed_s = 1.0 if self.scan_t_ns is None else (t_ns - self.scan_t_ns) / NS_PER_S
        self.scan_t_ns = t_ns
        self.field_m = sensor.field_of_view_m
        least = MIN_MISSED_SHARED_PER_S if is_shared else MIN_MISSED_PER_S
        most = 1.0 - least ** min(max(passed_s, 0.0), 1.0)
        if sensor.detection_probability <= most:
            return sensor
        return replace(sensor, detection_probability=most)

    def add_scan(self, unexplained: float, detected: float, in_view: float) -> None:
        """Add a scan: unexplained detections, and detected objects of those in view."""
        self.clutter.add(unexplained)
        self.detected.add(detected, in_view)

    def findings(self, sensor: Sensor) -> list[Finding]:
        """Return the changes in agreement with the sensor's announced values."""
        found = []
        clutter = self.clutter.value
        detection = self.detected.value
        announced = expected_clutter(sensor)
        if math.isfinite(announced) and self.clutter.n >= _MIN_SCANS:
            off = abs(clutter - announced) > _CERTAIN_STD * math.sqrt(max(announced, 1e-3) / self.clutter.n)
            ratio = max(clutter, 1e-3) / max(announced, 1e-3)
            contradicts = off and abs(math.log(ratio)) > math.log(_CLUTTER_FACTOR)
            agrees = not off or abs(math.log(ratio)) < math.log(_CLUTTER_AGREEMENT_FACTOR)
            if self._has_changed("clutter", contradicts, agrees):
                found.append(Finding("clutter", contradicts, clutter, announced))
        announced = min(sensor.detection_probability, _MAX_DETECTION)
        if self.detected.n >= _MIN_OBJECTS:
            off_by = abs(detection - announced)
            std = math.sqrt(max(announced * (1.0 - announced), 1e-3) / self.detected.n)
            contradicts = off_by > max(_DETECTION_DEVIATION, _CERTAIN_STD * std)
            if self._has_changed("detection", contradicts, off_by < _DETECTION_AGREEMENT):
                found.append(Finding("detection", contradicts, detection, announced))
        return found

    def corrected(self, sensor: Sensor) -> Sensor:
        """Return the sensor with the estimated clutter rate and detection probability."""
        announced = expected_clutter(sensor)
        clutter_factor = 1.0
        if math.isfinite(announced) and announced > 0.0:
            n = self.clutter.n
            seen = (_PRIOR_SCANS * announced + n * self.clutter.value) / (_PRIOR_SCANS + n)
            clutter_factor = float(
                np.clip(seen / announced, 1.0 / _MAX_CLUTTER_CORRECTION, _MAX_CLUTTER_CORRECTION)
            )
        n = self.detected.n
        p_d = (_PRIOR_OBJECTS * sensor.detection_probability + n * self.detected.value) / (_PRIOR_OBJECTS + n)
        polar = sensor.polar
        if polar is not None:
            polar = replace(polar, clutter_per_m_rad=polar.clutter_per_m_rad * clutter_factor)
        return replace(
            sensor,
            detection_probability=float(np.clip(p_d, _MIN_DETECTION, _MAX_DETECTION)),
            clutter_density_per_m2=sensor.clutter_density_per_m2 * clutter_factor,
            polar=polar,
        )

    def _has_changed(self, quantity: Quantity, contradicts: bool, agrees: bool) -> bool:
        """Note a contradiction that begins, or ends in agreement; return True for either."""
        has_changed = agrees if self.contradicts.get(quantity, False) else contradicts
        if has_changed:
            self.contradicts[quantity] = contradicts
        return has_changed
