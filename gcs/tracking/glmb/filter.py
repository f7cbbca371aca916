"""The GLMB tracker: scans of detections in, a picture of labelled tracks out.

A delta-generalised labelled multi-Bernoulli filter with joint prediction and update, one Gaussian per track,
as a product over clusters of interacting labels. Equations and sources: `gcs.tracking.glmb.recursion`.

Model: an object survives dt with probability p_S^dt and moves at constant velocity or in turns. A sensor
detects it with p_D in its field of view, at most once, with Gaussian noise. All other detections are Poisson
clutter. Objects appear by a labelled multi-Bernoulli birth at each scan.

The tracker is deterministic: time is an argument and randomness comes from a seed. Unusable detections and
late scans are counted, not raised. A wrong array shape raises ValueError.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from gcs import jit
from gcs.model import NS_PER_S, FloatArray, Kind, Picture, Sensor, Track
from gcs.terrain import line_of_sight
from gcs.tracking.glmb import extraction, recursion
from gcs.tracking.glmb.extraction import Estimates
from gcs.tracking.glmb.filter_state import GlmbState, check_state
from gcs.tracking.glmb.kalman import Interval
from gcs.tracking.glmb.params import Birth, BirthComponents, GlmbParams
from gcs.tracking.glmb.recursion import DetectionSummary
from gcs.tracking.glmb.scan_detections import scan_measurements
from gcs.tracking.models import clutter, coordinated_turn, measurement_model
from gcs.tracking.models.survival import survival_probability, survival_terms
from gcs.tracking.trajectories.fixed_lag import FixedLag, LagEstimates
from gcs.tracking.trajectories.recovery import Histories

__all__ = [
    "Birth",
    "DetectionSummary",
    "Estimates",
    "Glmb",
    "GlmbParams",
    "GlmbState",
    "warm_up",
    "warm_up_calls",
]


class Glmb:
    """A GLMB tracker of one kind of object.

    Parameters
    ----------
    kind : {"agents", "targets"}
        Kind of object, for its pictures.
    params : GlmbParams
        Model and limits.
    seed : int
        Seed of the Gibbs sampler, which large clusters alone use. Without effect if a state is given.
    keep_histories : bool
        True to keep association histories, for whole trajectories (see `trajectories.recovery`).
    summarise_detections : bool
        True to fill `detection_summary` at each update.
    lag : int
        Epochs by which `lag_estimates` are late; 0: there are none.
    state : GlmbState, optional
        State to continue from, of a filter with the same parameters. It is updated in place.

    Raises
    ------
    ValueError
        If the state is damaged.

    Attributes
    ----------
    state : GlmbState
        Everything that the filter carries from one scan to the next, but for association histories.
    histories : Histories or None
        Association histories.
    detection_summary : DetectionSummary or None
        What the tracks explain of the last scan.
    """

    def __init__(
        self,
        kind: Kind,
        params: GlmbParams,
        seed: int,
        *,
        keep_histories: bool = False,
        summarise_detections: bool = False,
        lag: int = 0,
        state: GlmbState | None = None,
    ) -> None:
        if state is not None:
            check_state(state, has_turns=params.turn_rate_std_rad_s > 0.0)
        self.state = GlmbState(rng=seed % 2**64) if state is None else state
        self.kind: Kind = kind
        self.params = params
        self._turns = coordinated_turn.TurnModel(float(params.turn_rate_std_rad_s), float(params.turn_time_s))
        turns = self._turns if params.turn_rate_std_rad_s > 0.0 else None
        self.histories = Histories(turns) if keep_histories else None
        self._fixed_lag = FixedLag(lag, turns) if lag > 0 else None
        self.detection_summary: DetectionSummary | None = None
        self._summarise_detections = summarise_detections
        self._limits = params.limits()
        self._births: tuple[Birth, ...] = ()
        self._birth_components = BirthComponents.from_births(())
        self._sensor: Sensor | None = None

    def update(
        self,
        measured_t_ns: int,
        z_m: FloatArray,
        sensor: Sensor,
        births: Sequence[Birth] = (),
        clutter_density_per_m2: FloatArray | None = None,
    ) -> None:
        """Process a scan.

        Parameters
        ----------
        measured_t_ns : int
            Time of measurement. It may equal that of the last scan (another sensor). An older scan is
            counted in `late_scans` and ignored.
        z_m : (m, 2) array
            Detections, east and north in metres for every kind of sensor. Rows that are not finite are
            counted in `bad_detections`.
        sensor : Sensor
            Model of the sensor.
        births : sequence of Birth
            Birth components of this scan. Birth i gets the label (scan number, i).
        clutter_density_per_m2 : (m,) array, optional
            Clutter intensity at each detection, in place of the sensor's. A detection whose intensity is not
            finite is counted in `bad_detections`.

        Raises
        ------
        ValueError
            If `z_m` has another shape.
        """
        state = self.state
        if state.t_ns is not None and measured_t_ns < state.t_ns:
            state.late_scans += 1
            return
        dt_s = 0.0 if state.t_ns is None else (measured_t_ns - state.t_ns) / NS_PER_S
        state.t_ns = measured_t_ns
        if births is not self._births:
            # Constant births are one tuple, the same object at each scan; other sequences might change.
            self._births = tuple(births)
            self._birth_components = BirthComponents.from_births(births)
        if sensor is not self._sensor:
            self._sensor = sensor
            self._sensor_model = measurement_model.sensor_model(sensor)
        interval = self._interval(dt_s)
        rng = np.array([state.rng], dtype=np.uint64)
        result = recursion.update_step(
            state.posterior,
            interval,
            scan_measurements(sensor, z_m, clutter_density_per_m2),
            self._sensor_model,
            self._limits,
            self._turns,
            self._summarise_detections,
            rng,
        )
        state.posterior = result.posterior
        state.rng = int(rng[0])
        state.bad_detections += result.n_unusable
        if self._summarise_detections:
            self.detection_summary = result.summary
        if self.histories is not None:
            self.histories.add_scan(
                measured_t_ns, sensor, self._births, self._survival_probability(dt_s), interval, result
            )
        if self._fixed_lag is not None:
            self._fixed_lag.add_scan(measured_t_ns, sensor, self._sensor_model, interval, result)
        state.scans += 1

    def lag_estimates(self) -> LagEstimates | None:
        """Return the estimates `lag` epochs before the last scan, from the scans up to the last one.

        They are None before there are enough scans since this object was made.
        """
        return None if self._fixed_lag is None else self._fixed_lag.estimates()

    def picture(self, t_ns: int) -> Picture:
        """Return all labels with an existence of at least `min_reported_existence`, as of the last scan.

        States are averages over the tracks that agree on the state of a label (see `extraction`). Labels of a
        cluster are represented by one joint hypothesis, so that two labels are not at one object.
        """
        found = self.estimates()
        columns = (found.mean, found.cov, found.existence.tolist(), found.estimated.tolist())
        tracks = tuple(
            Track((k, i), *row)
            for (k, i), row in zip(found.label.tolist(), zip(*columns, strict=True), strict=True)
        )
        scan_t_ns = t_ns if self.state.t_ns is None else self.state.t_ns
        return Picture(t_ns, scan_t_ns, self.kind, tracks, found.cardinality)

    def estimates(self) -> Estimates:
        """Return the content of `picture` as read-only arrays; faster for large scenes."""
        posterior = self.state.posterior
        min_existence = float(self.params.min_reported_existence)
        found: Estimates = extraction.extract_estimates(
            posterior.clusters,
            posterior.track_label,
            posterior.labels,
            posterior.mean,
            posterior.cov,
            min_existence,
        )
        for column in found:
            column.flags.writeable = False
        return found

    @property
    def scans(self) -> int:
        """Number of processed scans."""
        return self.state.scans

    @property
    def late_scans(self) -> int:
        """Number of scans refused as older than the last one."""
        return self.state.late_scans

    @property
    def bad_detections(self) -> int:
        """Number of detections refused as not finite."""
        return self.state.bad_detections

    def estimate(self) -> tuple[Track, ...]:
        """Return the tracks of `picture` that are in the MAP-cardinality estimate."""
        return tuple(track for track in self.picture(0).tracks if track.estimated)

    def _interval(self, dt_s: float) -> Interval:
        """Return motion, survival and births since the last scan."""
        params = self.params
        Q = _process_noise(dt_s, params.accel_psd_m2_s3, params.piecewise_accel_std_m_s2)
        survival = survival_terms(self._survival_probability(dt_s), float(params.lost_std_m))
        return Interval(dt_s, Q, survival, self.state.scans, self._birth_components)

    def _survival_probability(self, dt_s: float) -> float:
        return survival_probability(self.params.survival_probability_per_s, dt_s)


@lru_cache(maxsize=64)
def _process_noise(dt_s: float, accel_psd_m2_s3: float, piecewise_accel_std_m_s2: float) -> FloatArray:
    return GlmbParams(accel_psd_m2_s3, piecewise_accel_std_m_s2).process_noise(dt_s)


def warm_up_calls() -> list[jit.Call]:
    """Return one call of every kernel of a tracker; for histories see `recovery`."""
    return [
        *extraction.warm_up_calls(),
        *recursion.warm_up_calls(),
        *clutter.warm_up_calls(),
        *coordinated_turn.warm_up_calls(),
        *line_of_sight.warm_up_calls(),
    ]


def warm_up_parts() -> list[jit.Call]:
    """Return one call of every kernel that these call."""
    return recursion.warm_up_parts()


def warm_up() -> None:
    """Compile every kernel, or load it from the cache, before the first scan."""
    jit.warm_up(__name__)
