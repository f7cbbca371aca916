"""Batch tracking (`gcs.tracking.track`): whole data sets in, labelled trajectories out.

`track` takes arrays. `track_scans` takes the scans of several sensors, at their own times; `gcs track` calls
it. Three estimators use the same filter:

- "filtered": the estimate at each scan, from the detections up to it.
- "recovered": whole paths from the association histories, each state from the detections up to it. Which
  detections belong to a path, and where it begins and ends, follows from all scans.
- "smoothed": the same paths, each state from all detections (see `trajectories.recovery`); or causal, with a
  fixed lag.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from gcs.model import NS_PER_S, FloatArray, IntArray, Label, Sensor, read_only
from gcs.tracking import Estimator
from gcs.tracking.glmb.filter import Glmb
from gcs.tracking.glmb.params import Birth, GlmbParams
from gcs.tracking.models.adaptive_birth import AdaptiveBirth
from gcs.tracking.models.sensor_geometry import clutter_per_m2
from gcs.tracking.state_space.births import StateSpaceBirth
from gcs.tracking.state_space.filter import StateSpaceGlmb
from gcs.tracking.state_space.models import (
    POSITION_NAMES,
    MeasurementModel,
    MotionModel,
    SwitchingMotion,
)
from gcs.tracking.trajectories.recovery import Path

_MAX_TIME_S: Final = 9e9
"""The year 2255: nanoseconds since 1970 fit an int64."""
_SEED: Final = 1
_PLANAR_NAMES: Final = ("x", "y", "vx", "vy")


@dataclass(frozen=True, slots=True)
class TrackingModel:
    """Motion and births of the objects.

    Objects are born at known places (`births`), anywhere (`births_per_s`), or both. By default their states
    are x, y, vx, vy and `params` has their motion.

    Raises
    ------
    ValueError
        Nothing can be born, or an array has another shape: names it and what was expected.
    """

    params: GlmbParams
    births: tuple[Birth, ...] = ()
    """Birth components of each scan."""
    births_per_s: float = 0.0
    """Objects expected to appear in a second, at detections that no track explains (`adaptive_birth`)."""
    birth_speed_std_m_s: float = 10.0
    """Standard deviation of their velocity, along each axis."""
    max_birth_probability: float = 0.1
    """Largest probability of one such birth."""
    birth_again_probability: float | None = None
    """Probability of a birth component after its first birth; None: as before."""
    motion: MotionModel | SwitchingMotion | None = None
    """Motion in place of that of `params`, which then has survival and limits only: of other states, or one
    that switches between models. Measurements may then be those of a `MeasurementModel`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "births", tuple(self.births))
        params = self.params
        if self.motion is not None and (
            params.accel_psd_m2_s3 or params.piecewise_accel_std_m_s2 or params.turn_rate_std_rad_s
        ):
            raise ValueError("params: expected accel_psd_m2_s3=0 and no turns: the motion has its own noise")
        if not self.births and not self.births_per_s > 0.0:
            raise ValueError("births: expected birth components, or births_per_s above 0: nothing is born")
        for i, birth in enumerate(self.births):
            _check_shape(f"births[{i}].mean", birth.mean, (len(self.names),), ", ".join(self.names))
            shape = (len(self.names), len(self.names))
            _check_shape(f"births[{i}].cov", birth.cov, shape, f"covariance of {', '.join(self.names)}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return _PLANAR_NAMES if self.motion is None else self.motion.names


@dataclass(frozen=True, slots=True)
class SensorScan:
    """Scan of one sensor."""

    t_ns: int
    """Time of measurement."""
    sensor: Sensor | MeasurementModel
    z_m: FloatArray
    """(m, 2) detections, east and north; (m, k) for a `MeasurementModel`, in its coordinates."""
    origin: FloatArray | None = None
    """(m,) number of the true object of each detection, 0 for clutter; None if unknown."""
    log_ratio: FloatArray | None = None
    """(m,) log-likelihood ratio of what else was measured of each detection (see `track`)."""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Estimated trajectory of one object; n states, in the order of time, of dimension d."""

    label: Label
    """Scan of its birth, and number of its birth component in that scan."""
    t_ns: IntArray
    """(n,) times of measurement."""
    mean: FloatArray
    """(n, d) states: x, y, vx, vy in metres and metres a second, x is east, y is north; or those of
    `TrackingModel.motion`."""
    cov: FloatArray
    """(n, d, d)."""
    existence: FloatArray
    """(n,) existence probability by the filter, from the detections up to each time."""

    @property
    def t_s(self) -> FloatArray:
        """(n,) times of measurement in seconds."""
        return self.t_ns / NS_PER_S


@dataclass(frozen=True, slots=True)
class TrackSet:
    """Trajectories of a data set."""

    t_ns: IntArray
    """(K,) times of all scans, each once."""
    trajectories: tuple[Trajectory, ...]
    """Ordered by label."""
    late_scans: int = 0
    """Scans that were not used: older than the one before."""
    bad_detections: int = 0
    """Detections that were not used: not finite."""
    names: tuple[str, ...] = _PLANAR_NAMES
    """Names of the states."""

    def __len__(self) -> int:
        return len(self.trajectories)

    def positions_m(self) -> list[dict[Label, FloatArray]]:
        """Return the position by label at each of the K times, as the metrics take them.

        Positions are (2,), or (3,) with a state z.
        """
        at = [self.names.index(name) for name in POSITION_NAMES if name in self.names]
        found: list[dict[Label, FloatArray]] = [{} for _ in self.t_ns]
        for one in self.trajectories:
            for k, mean in zip(np.searchsorted(self.t_ns, one.t_ns).tolist(), one.mean, strict=True):
                found[k][one.label] = mean[at]
        return found

    def columns(self) -> dict[str, IntArray | FloatArray]:
        """Return a table as its columns: a row for each state, ordered by time and label.

        k (number of the time, from 0), t_s, label (from 1, in the order of births), the states (x, y, vx,
        vy), existence.
        """
        parts = [(np.full(one.t_ns.size, n), one) for n, one in enumerate(self.trajectories, 1)]
        label = np.concatenate([np.empty(0, np.int64), *(number for number, _ in parts)])
        t_ns = np.concatenate([np.empty(0, np.int64), *(one.t_ns for _, one in parts)])
        mean = np.concatenate([np.empty((0, len(self.names))), *(one.mean for _, one in parts)])
        existence = np.concatenate([np.empty(0), *(one.existence for _, one in parts)])
        order = np.lexsort((label, t_ns))
        columns: dict[str, IntArray | FloatArray] = {
            "k": np.searchsorted(self.t_ns, t_ns[order]),
            "t_s": t_ns[order] / NS_PER_S,
            "label": label[order],
        }
        columns |= {name: mean[order, i] for i, name in enumerate(self.names)}
        return columns | {"existence": existence[order]}

    def to_pandas(self) -> Any:
        """Return `columns` as a `pandas.DataFrame`; needs the extra `tables`."""
        return _frame("pandas", self.columns())

    def to_polars(self) -> Any:
        """Return `columns` as a `polars.DataFrame`; needs the extra `tables`."""
        return _frame("polars", self.columns())


AnySensor: TypeAlias = Sensor | MeasurementModel
"""A sensor of positions, or range and bearing, in the plane; or the model of another one."""


def track(
    scans: Sequence[ArrayLike],
    times_s: ArrayLike,
    sensor: AnySensor | Sequence[AnySensor],
    model: TrackingModel,
    estimator: Estimator = "smoothed",
    lag_scans: int | None = None,
    log_ratios: Sequence[ArrayLike] | None = None,
) -> TrackSet:
    """Track the objects of a data set.

    Parameters
    ----------
    scans : sequence of (m, 2) arrays
        Detections of each scan, east and north in metres; m may be 0 and may differ. Detections with a NaN
        are counted in `TrackSet.bad_detections`. Those of a `MeasurementModel` are (m, k), as it measures.
    times_s : (K,) array
        Time of each scan in seconds, in order. Scans of several sensors may have the same time.
    sensor : Sensor or MeasurementModel, or a sequence of K of them
        The sensor, or that of each scan. A `MeasurementModel` needs a model with `motion`.
    estimator : "filtered", "recovered" or "smoothed"
    lag_scans : int, optional
        Fixed lag L of smoothed estimates: what scan k says of scan k - L, from the detections up to scan k
        only, as a tracker that runs would know it. The last L scans are as of the last one. By default each
        state uses all detections.
    log_ratios : sequence of K arrays (m,), optional
        What else was measured of each detection, such as its amplitude a, as log-likelihood ratio
        log p(a | object) - log p(a | clutter), both given that it was detected.

    Raises
    ------
    ValueError
        An argument has another shape: names it, the expected and the found shape.
    """
    times = np.asarray(times_s, np.float64)
    _check_shape("times_s", times, (len(scans),), "one time in seconds for each of the scans")
    if not (np.isfinite(times).all() and (np.abs(times) < _MAX_TIME_S).all() and (np.diff(times) >= 0).all()):
        raise ValueError("times_s: expected finite times in seconds that do not decrease")
    if isinstance(sensor, Sensor | MeasurementModel):
        sensor = [sensor] * len(scans)
    sensors: list[AnySensor] = list(sensor)
    if len(sensors) != len(scans):
        raise ValueError(f"sensor: expected one, or one for each of {len(scans)} scans, got {len(sensors)}")
    for one in {id(one): one for one in sensors}.values():
        _check_sensor(one, model)
    if estimator not in get_args(Estimator):
        raise ValueError(f"estimator: expected one of {', '.join(get_args(Estimator))}, got {estimator!r}")
    if lag_scans is not None and (lag_scans < 0 or estimator != "smoothed"):
        raise ValueError("lag_scans: expected at least 0, and the estimator smoothed with it")
    ratios: list[ArrayLike | None] = [None] * len(scans) if log_ratios is None else list(log_ratios)
    if len(ratios) != len(scans):
        raise ValueError(f"log_ratios: expected one array for each of {len(scans)} scans, got {len(ratios)}")
    return track_scans(
        map(_scan, range(len(scans)), times.tolist(), sensors, scans, ratios),
        model,
        estimator,
        lag_scans,
    )


def track_scans(
    scans: Iterable[SensorScan],
    model: TrackingModel,
    estimator: Estimator = "smoothed",
    lag_scans: int | None = None,
    on_scan: Callable[[], object] = lambda: None,
) -> TrackSet:
    """Track the objects of scans, which are taken one by one; older ones than the last are not used.

    Parameters
    ----------
    lag_scans
        As for `track`.
    on_scan
        Called after each scan.
    """
    tracker = BatchTracker(model, keep_histories=estimator != "filtered")
    histories = tracker.glmb.histories
    collected = _Collected(model.names)
    times: list[int] = []
    for scan in scans:
        states = tracker.update(scan)
        if states is not None:
            times.append(scan.t_ns)
            collected.existence[scan.t_ns] = tracker.existence
            collected.states[scan.t_ns] = states if histories is None else {}
            if histories is not None and lag_scans is not None and len(times) > lag_scans:
                first = len(times) - 1 - lag_scans
                collected.add_paths(histories.paths(smooth=True, since_scan=first), first, first)
        on_scan()
    if histories is not None:
        first = 0 if lag_scans is None else max(0, len(times) - lag_scans)
        collected.add_paths(histories.paths(smooth=estimator == "smoothed"), first, len(times) - 1)
    return collected.track_set(tracker.glmb.late_scans, tracker.glmb.bad_detections)


States: TypeAlias = dict[Label, tuple[FloatArray, FloatArray]]
"""Mean (d,) and covariance (d, d) by label."""


class _AdaptiveBirth(Protocol):
    """`AdaptiveBirth`, or `StateSpaceBirth`."""

    def births(self, t_ns: int) -> Sequence[Birth]: ...

    def add_scan(
        self, t_ns: int, z: FloatArray, sensor: Any, explained: FloatArray, log_ratio: FloatArray | None, /
    ) -> None: ...


class BatchTracker:
    """A filter with the births of its model, fed scan by scan.

    Attributes
    ----------
    glmb : Glmb or StateSpaceGlmb
    existence : dict of label to float
        Existence probability of each label at the last scan.
    """

    def __init__(self, model: TrackingModel, *, keep_histories: bool = False) -> None:
        self._model = model
        self._is_adaptive = model.births_per_s > 0.0
        self.existence: dict[Label, float] = {}
        self.glmb: Glmb | StateSpaceGlmb
        self._unknown: _AdaptiveBirth
        births = (model.births_per_s, model.birth_speed_std_m_s, model.max_birth_probability)
        if model.motion is None:
            self.glmb = Glmb(
                "targets",
                model.params,
                _SEED,
                keep_histories=keep_histories,
                summarise_detections=self._is_adaptive,
            )
            self._unknown = AdaptiveBirth(*births, model.params.process_noise)
        else:
            self.glmb = StateSpaceGlmb(model.motion, model.params, _SEED, keep_histories=keep_histories)
            self._unknown = StateSpaceBirth(self.glmb.motion, *births)
        self._places = model.births
        self._t_ns: int | None = None

    def update(self, scan: SensorScan) -> States | None:
        """Process a scan; return the filtered estimates, None if it is older than the last one."""
        is_late = self._t_ns is not None and scan.t_ns < self._t_ns
        explained = self._update_filter(scan, () if is_late else self._births(scan))
        if is_late:
            return None
        if explained is not None:
            self._unknown.add_scan(scan.t_ns, scan.z_m, scan.sensor, explained, scan.log_ratio)
        found = self.glmb.estimates()
        self._t_ns = scan.t_ns
        labels = [(born, place) for born, place in found.label.tolist()]
        self.existence = dict(zip(labels, found.existence.tolist(), strict=True))
        states = {labels[i]: (found.mean[i], found.cov[i]) for i in np.flatnonzero(found.estimated).tolist()}
        if self._model.birth_again_probability is not None:
            self._places = _renew_births(self._places, states, self._model.birth_again_probability)
        return states

    def _update_filter(self, scan: SensorScan, births: tuple[Birth, ...]) -> FloatArray | None:
        """Update the filter; return the probability that tracks explain each detection, if births need it."""
        if isinstance(self.glmb, StateSpaceGlmb):
            self.glmb.update(scan.t_ns, scan.z_m, scan.sensor, births, scan.log_ratio)
            return self.glmb.explained if self._is_adaptive else None
        assert isinstance(scan.sensor, Sensor)
        clutter = None
        if scan.log_ratio is not None:
            clutter = clutter_per_m2(scan.sensor, scan.z_m) * np.exp(-scan.log_ratio)
        self.glmb.update(scan.t_ns, scan.z_m, scan.sensor, births, clutter)
        summary = self.glmb.detection_summary
        return None if summary is None else summary.explained

    def _births(self, scan: SensorScan) -> tuple[Birth, ...]:
        places = self._places
        if scan.t_ns == self._t_ns:
            # Components keep their numbers: a second scan at one epoch has no births.
            places = tuple(replace(place, probability=0.0) for place in places)
        return (*places, *self._unknown.births(scan.t_ns)) if self._is_adaptive else places


class _Collected:
    """Estimates by time in nanoseconds: the last scan of an epoch counts."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self.states: dict[int, States] = {}
        self.existence: dict[int, dict[Label, float]] = {}

    def add_paths(self, paths: Iterable[Path], first: int, last: int) -> None:
        """Replace the states at scans `first` to `last` by those of paths."""
        for path in paths:
            begin = max(first - int(path.scan[0]), 0)
            end = max(last + 1 - int(path.scan[0]), 0)
            rows = zip(path.t_ns[begin:end].tolist(), path.mean[begin:], path.cov[begin:], strict=False)
            for t_ns, mean, cov in rows:
                self.states[t_ns][path.label] = mean, cov

    def track_set(self, late_scans: int, bad_detections: int) -> TrackSet:
        times: dict[Label, list[int]] = {}
        for t_ns, states in self.states.items():
            for label in states:
                times.setdefault(label, []).append(t_ns)
        trajectories = tuple(self._trajectory(label, at) for label, at in sorted(times.items()))
        return TrackSet(_times(self.states), trajectories, late_scans, bad_detections, self._names)

    def _trajectory(self, label: Label, times: Sequence[int]) -> Trajectory:
        return Trajectory(
            label,
            _times(times),
            read_only(np.stack([self.states[t][label][0] for t in times])),
            read_only(np.stack([self.states[t][label][1] for t in times])),
            read_only([self.existence[t].get(label, 0.0) for t in times]),
        )


def _times(times: Iterable[int]) -> IntArray:
    array = np.array(list(times), np.int64)
    array.flags.writeable = False
    return array


def _renew_births(places: tuple[Birth, ...], states: States, probability: float) -> tuple[Birth, ...]:
    """Set the probability of components that had a birth; return the same tuple if nothing changes."""
    used = {place for _, place in states if place < len(places) and places[place].probability != probability}
    if not used:
        return places
    return tuple(replace(p, probability=probability) if i in used else p for i, p in enumerate(places))


def _scan(
    k: int, t_s: float, sensor: AnySensor, detections: ArrayLike, log_ratio: ArrayLike | None
) -> SensorScan:
    z = np.asarray(detections, np.float64)
    width = 2 if isinstance(sensor, Sensor) else sensor.size
    if z.size == 0:
        z = np.empty((0, width))
    if z.ndim != 2 or z.shape[1] != width:
        is_planar = isinstance(sensor, Sensor)
        what = "detections as east and north in metres" if is_planar else "as its model measures"
        raise ValueError(f"scans[{k}]: expected shape (m, {width}), {what}; got {z.shape}")
    ratio = None if log_ratio is None else np.asarray(log_ratio, np.float64)
    if ratio is not None:
        _check_shape(f"log_ratios[{k}]", ratio, (len(z),), "one for each detection of the scan")
    return SensorScan(round(t_s * NS_PER_S), sensor, z, log_ratio=ratio)


def _check_sensor(sensor: AnySensor, model: TrackingModel) -> None:
    if isinstance(sensor, MeasurementModel):
        if model.motion is None:
            raise ValueError(
                f"model: expected TrackingModel.motion, of the states that {sensor.name} measures"
            )
        return
    if not isinstance(sensor, Sensor):
        raise ValueError(f"sensor: expected Sensor or MeasurementModel, got {sensor!r}")
    of = f"of sensor {sensor.name}"
    _check_shape(f"noise_cov_m2 {of}", sensor.noise_cov_m2, (2, 2), "covariance of x, y")
    _check_shape(f"field_of_view_m {of}", sensor.field_of_view_m, (4,), "x_min, y_min, x_max, y_max")
    x_min, y_min, x_max, y_max = sensor.field_of_view_m
    if not (x_min < x_max and y_min < y_max):
        raise ValueError(
            f"field_of_view_m {of}: expected x_min, y_min, x_max, y_max, got {sensor.field_of_view_m}"
        )
    if not np.all(np.linalg.eigvalsh(sensor.noise_cov_m2) > 0.0):
        raise ValueError(f"noise_cov_m2 {of}: expected a positive definite matrix, in m2")
    if not 0.0 <= sensor.detection_probability <= 1.0:
        raise ValueError(f"detection_probability {of}: expected 0 to 1, got {sensor.detection_probability!r}")
    if not sensor.clutter_density_per_m2 >= 0.0:
        raise ValueError(
            f"clutter_density_per_m2 {of}: expected at least 0, got {sensor.clutter_density_per_m2!r}"
        )


def _check_shape(name: str, array: ArrayLike, shape: tuple[int, ...], meaning: str) -> None:
    found = np.shape(array)
    if found != shape:
        raise ValueError(f"{name}: expected shape {shape}, {meaning}; got {found}")


def _frame(library: str, columns: dict[str, IntArray | FloatArray]) -> Any:
    """Return columns as a data frame of pandas or polars."""
    import importlib

    try:
        module = importlib.import_module(library)
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            f"{library} is not installed: pip install 'swarm-gcs[tables]'", name=library
        ) from None
    return module.DataFrame(columns)
