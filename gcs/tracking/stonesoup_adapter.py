"""Adapter to Stone Soup (https://stonesoup.readthedocs.io): detections, tracks, ground truth and a tracker.

Needs the extra `stonesoup`. Stone Soup's states are x, vx, y, vy at naive datetimes; ours are
x, y, vx, vy at nanoseconds since 1970. Its sets have no order: detections are sorted by position, so that a
run repeats exactly.

- `StoneSoupTracker`: our tracker as theirs, ``for time, tracks in tracker``.
- `to_arrays`: their detections as arrays for `track`.
- `to_scans`: their detections, each at its own time, as scans for `track_scans`.
- `positions_m`: their tracks or ground truth for our metrics.
- `to_tracks`, `to_ground_truth`, `to_detections`: ours for their metrics and trackers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

try:
    from stonesoup.base import Property
    from stonesoup.models.measurement import MeasurementModel
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.tracker.base import Tracker
    from stonesoup.types.detection import Detection
    from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "Stone Soup is not installed: pip install 'swarm-gcs[stonesoup]'", name=error.name
    ) from error

from gcs.model import FloatArray, Label, Sensor
from gcs.tracking.batch import AnySensor, BatchTracker, SensorScan, TrackSet

_EPOCH: Final = datetime(1970, 1, 1)  # noqa: DTZ001  Stone Soup's times are naive
_ORDER: Final = [0, 2, 1, 3]
"""Our order of their state, and theirs of ours."""


class StoneSoupTracker(Tracker):  # type: ignore[misc]
    """GLMB tracker as a Stone Soup `Tracker`: filtered estimates, scan by scan.

    The result is a set of tracks at each time. A track's `id` is its label: scan of its birth, and number of
    its birth component. Stone Soup's metrics need tracks without gaps: an object that is not estimated for a
    scan goes on as another track of the same id.
    """

    detector: Any = Property(doc="Iterable of (datetime, set of Detection).")
    sensor: Any = Property(
        doc="gcs.tracking.Sensor, or a MeasurementModel of x and y, of all detections; metres."
    )
    model: Any = Property(doc="gcs.tracking.TrackingModel.")

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._tracker = BatchTracker(self.model)
        self._now: dict[Label, Any] = {}
        self._detections: Iterator[tuple[datetime, set[Any]]] | None = None

    @property
    def tracks(self) -> set[Any]:
        """Tracks that exist at the last time."""
        return set(self._now.values())

    def __iter__(self) -> StoneSoupTracker:
        """Begin with the detector's first detections."""
        self._detections = iter(self.detector)
        return self

    def __next__(self) -> tuple[datetime, set[Any]]:
        """Process the detections of the next time."""
        if self._detections is None:
            self._detections = iter(self.detector)
        time, detections = next(self._detections)
        states = None
        for scan in _scans_at(time, detections, self.sensor):
            states = self._tracker.update(scan)
        if states is not None:
            self._now = {label: self._now.get(label) or Track(id=_name(label)) for label in states}
            for label, (mean, cov) in states.items():
                self._now[label].append(_state(mean, cov, time))
        return time, self.tracks


def to_scans(detector: Iterable[tuple[datetime, set[Any]]], sensor: AnySensor) -> list[SensorScan]:
    """Return scans for `track_scans`.

    Detections of one set may have times of their own, such as reports that were collected for a minute. Then
    there is a scan for each of these times, and one without detections at the time of the set. An object is
    detected in one of them, so each has a part of the sensor's clutter and detection probability.
    """
    return [scan for time, detections in detector for scan in _scans_at(time, detections, sensor)]


def to_arrays(detector: Iterable[tuple[datetime, set[Any]]]) -> tuple[list[FloatArray], FloatArray]:
    """Return scans, (m, 2) arrays of positions, and their times (K,) in seconds since 1970, for `track`.

    A detection is a position, or has a measurement model that can be inverted, such as range and bearing. It
    counts at the time of its set; with times of their own use `to_scans`.
    """
    pairs = [(_positions(detections), t_ns_of(time)) for time, detections in detector]
    return [z_m for z_m, _ in pairs], np.array([t_ns / 1e9 for _, t_ns in pairs], np.float64)


def positions_m(
    paths: Iterable[Any], times: Sequence[datetime], mapping: tuple[int, int] = (0, 2)
) -> list[dict[str, FloatArray]]:
    """Return the position (2,) by id at each time, of tracks or ground-truth paths, for our metrics.

    Parameters
    ----------
    mapping : (int, int)
        Numbers of x and y in the state vector.
    """
    found: list[dict[str, FloatArray]] = [{} for _ in times]
    number = {time: k for k, time in enumerate(times)}
    for path in paths:
        for state in path:
            if state.timestamp in number:
                vector = np.asarray(state.state_vector, np.float64).ravel()
                found[number[state.timestamp]][str(path.id)] = vector[list(mapping)]
    return found


def to_tracks(tracks: TrackSet) -> set[Any]:
    """Return trajectories as Stone Soup tracks of Gaussian states, one for each part without a gap."""
    found = set()
    for one in tracks.trajectories:
        states = [
            _state(m, c, time_of(t)) for t, m, c in zip(one.t_ns.tolist(), one.mean, one.cov, strict=True)
        ]
        gaps = np.flatnonzero(np.diff(np.searchsorted(tracks.t_ns, one.t_ns)) > 1) + 1
        edges = [0, *gaps.tolist(), len(states)]
        found |= {Track(states[a:b], id=_name(one.label)) for a, b in pairwise(edges)}
    return found


def to_ground_truth(
    truth_m: Sequence[Mapping[Any, ArrayLike]], times_s: Sequence[float] | FloatArray
) -> set[Any]:
    """Return ground-truth paths of states [x, y] from true positions (2,) by id at each time."""
    paths: dict[Any, Any] = {}
    for t_s, objects in zip(times_s, truth_m, strict=True):
        time = time_of(round(float(t_s) * 1e9))
        for name, place in objects.items():
            path = paths.setdefault(name, GroundTruthPath(id=str(name)))
            path.append(GroundTruthState(np.reshape(place, (2, 1)), timestamp=time))
    return set(paths.values())


def to_detections(
    scans: Sequence[ArrayLike],
    times_s: Sequence[float] | FloatArray,
    measurement_model: MeasurementModel | None = None,
) -> list[tuple[datetime, set[Any]]]:
    """Return scans, (m, 2) arrays of positions, as a Stone Soup detector: a list of (time, detections)."""
    found = []
    for t_s, z_m in zip(times_s, scans, strict=True):
        time = time_of(round(float(t_s) * 1e9))
        rows = np.reshape(np.asarray(z_m, np.float64), (-1, 2))
        detections = {
            Detection(row[:, None], timestamp=time, measurement_model=measurement_model) for row in rows
        }
        found.append((time, detections))
    return found


def t_ns_of(time: datetime) -> int:
    """Return nanoseconds since 1970 of a naive datetime."""
    return (time - _EPOCH) // timedelta(microseconds=1) * 1000


def time_of(t_ns: int) -> datetime:
    """Return the naive datetime, to the microsecond, of nanoseconds since 1970."""
    return _EPOCH + timedelta(microseconds=round(t_ns / 1000))


def _scans_at(time: datetime, detections: set[Any], sensor: AnySensor) -> Iterator[SensorScan]:
    """Yield the scans of one set of detections (see `to_scans`)."""
    t_ns = t_ns_of(time)
    groups: dict[int, list[Any]] = {}
    for one in detections:
        groups.setdefault(t_ns_of(one.timestamp), []).append(one)
    if groups.keys() <= {t_ns}:
        yield SensorScan(t_ns, sensor, _positions(detections))
        return
    undetected = 1.0
    for at_ns, group in sorted(groups.items()):
        share = len(group) / len(detections)
        probability = sensor.detection_probability * share
        part = replace(_with_clutter(sensor, share), detection_probability=probability / undetected)
        undetected -= probability
        yield SensorScan(at_ns, part, _positions(group))
    if at_ns < t_ns:
        yield SensorScan(t_ns, replace(sensor, detection_probability=0.0), np.empty((0, 2)))


def _with_clutter(sensor: AnySensor, share: float) -> AnySensor:
    """Return a sensor with a share of its clutter."""
    if isinstance(sensor, Sensor):
        return replace(sensor, clutter_density_per_m2=sensor.clutter_density_per_m2 * share)
    density = sensor.clutter_density
    if callable(density):
        return replace(sensor, clutter_density=lambda z: share * density(z))
    return replace(sensor, clutter_density=share * density)


def _positions(detections: Iterable[Any]) -> FloatArray:
    rows = np.array([_position(one) for one in detections], np.float64).reshape(-1, 2)
    return rows[np.lexsort(rows.T[::-1])]


def _position(detection: Any) -> FloatArray:
    model = detection.measurement_model
    vector = detection.state_vector
    if isinstance(model, NonLinearGaussianMeasurement):
        vector = model.inverse_function(detection)[list(model.mapping)]
    place = np.asarray(vector, np.float64).ravel()
    if place.shape != (2,):
        raise ValueError(f"detection: expected a position of shape (2, 1), x and y; got {vector.shape}")
    return place


def _state(mean: FloatArray, cov: FloatArray, time: datetime) -> Any:
    return GaussianState(mean[_ORDER][:, None], cov[np.ix_(_ORDER, _ORDER)], timestamp=time)


def _name(label: Label) -> str:
    return f"{label[0]}.{label[1]}"
