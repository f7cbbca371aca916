"""The GLMB tracker: scans of detections in, a picture of labelled tracks out.

The delta-generalised labelled multi-Bernoulli filter with joint prediction and update (B.-N. Vo, B.-T. Vo &
H. Hoang, "An efficient implementation of the generalized labeled multi-Bernoulli filter", IEEE TSP 65, 2017),
one Gaussian per track, kept as a product over groups of interacting labels (Beard, Vo & Vo, IEEE TSP 68,
2020). This module holds what is believed between scans. What a scan does to it is compiled, one call
(`scanning`): `kernels`, `views` and `gates` (one object), `meeting`, `claims` and `parting` (which labels
interact), `alone` and `search` (association), `association` (all of that for a scan), `merging`. What is
shown is another (`showing`, `summing`).

Model: an object survives dt with probability p_S^dt and moves as in `motion`; a sensor detects it with p_D
while it is inside the field of view, at most once, with Gaussian noise (see `views`); all else in a
scan is Poisson clutter; new objects appear where the caller says that they may (a labelled multi-Bernoulli
birth for each scan).

The tracker is a pure value machine: time is an argument, randomness comes from a seed, and the same calls
give the same bytes. No values make it raise once constructed: what it cannot use it counts (`late_scans`,
`bad_detections`). Arrays of another shape than (m, 2) do.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from gcs import jit
from gcs.model import NS_PER_S, FloatArray, Kind, Picture, Sensor, Track
from gcs.tracking.glmb import extraction, kalman, recursion
from gcs.tracking.glmb.extraction import Estimates
from gcs.tracking.glmb.measurements import scan_measurements
from gcs.tracking.glmb.params import SURE, Birth, BirthComponents, GlmbParams
from gcs.tracking.glmb.recursion import DetectionSummary, Interval, Posterior
from gcs.tracking.models import clutter, constant_velocity, coordinated_turn, measurement
from gcs.tracking.trajectories.recovery import Histories

__all__ = ["Birth", "DetectionSummary", "Estimates", "Glmb", "GlmbParams", "warm_up", "warm_up_calls"]


class Glmb:
    """One tracker of one kind of object.

    Parameters
    ----------
    kind : {"agents", "targets"}
        Written on its pictures.
    params : GlmbParams
        Model and limits.
    seed : int
        Of the Gibbs sampler, which works only where many objects interact.
    keep_histories : bool
        Whether tracks remember their detections, so that whole paths can be recovered (see `recovery`).
    weigh_detections : bool
        Whether each update says in `account` what the tracks make of the scan's detections.

    Attributes
    ----------
    histories : Histories or None
        Where they remember them.
    account : Account or None
        Of the last scan, when detections are weighed.
    scans, late_scans, bad_detections : int
        Scans taken in; scans refused as measured before the last one; detections refused as not finite.
    """

    def __init__(
        self,
        kind: Kind,
        params: GlmbParams,
        seed: int,
        *,
        keep_histories: bool = False,
        summarise_detections: bool = False,
    ) -> None:
        self.kind: Kind = kind
        self.params = params
        self._turns = coordinated_turn.TurnModel(float(params.turn_rate_std_rad_s), float(params.turn_time_s))
        turns = self._turns if params.turn_rate_std_rad_s > 0.0 else None
        self.histories = Histories(turns) if keep_histories else None
        self.detection_summary: DetectionSummary | None = None
        self.scans = self.late_scans = self.bad_detections = 0
        self._summarise_detections = summarise_detections
        self._limits = params.limits()
        self._rng = np.array([seed % 2**64], dtype=np.uint64)
        self._t_ns: int | None = None
        self._posterior = Posterior.empty()
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
        """Take in a scan.

        Parameters
        ----------
        measured_t_ns : int
            When it was measured. The same time as the last scan's is fine (another sensor); earlier than it,
            the scan is counted in `late_scans` and otherwise ignored.
        z_m : (m, 2) array
            Detections east/north, in any order, whatever the sensor measures. Rows that are not finite are
            counted in `bad_detections`.
        sensor : Sensor
            What the scan's sensor says of itself.
        births : sequence of Birth
            Where objects may have appeared by this scan. Birth i gets the label (scan count, i).
        clutter_density_per_m2 : (m,) array, optional
            Clutter intensity at each detection, where it is known better than by the sensor's uniform
            density: near objects that this tracker does not track. A detection whose intensity is not finite
            is unusable and counted in `bad_detections`.

        Raises
        ------
        ValueError
            When `z_m` has another shape: two rows in place of two columns would be other places.
        """
        if self._t_ns is not None and measured_t_ns < self._t_ns:
            self.late_scans += 1
            return
        dt_s = 0.0 if self._t_ns is None else (measured_t_ns - self._t_ns) / NS_PER_S
        self._t_ns = measured_t_ns
        if births is not self._births:
            # Known places are one tuple, the same at each scan; what is not a tuple might change.
            self._births, self._birth_components = tuple(births), BirthComponents.from_births(births)
        if sensor is not self._sensor:
            self._sensor, self._sensor_model = sensor, measurement.sensor_model(sensor)
        interval = self._interval(dt_s)
        result = recursion.update_step(
            self._posterior,
            interval,
            scan_measurements(sensor, z_m, clutter_density_per_m2),
            self._sensor_model,
            self._limits,
            self._turns,
            self._summarise_detections,
            self._rng,
        )
        self._posterior = result.posterior
        self.bad_detections += result.n_unusable
        if self._summarise_detections:
            self.detection_summary = result.summary
        if self.histories is not None:
            self.histories.add_scan(
                measured_t_ns, sensor, self._births, self._survival_probability(dt_s), interval, result
            )
        self.scans += 1

    def picture(self, t_ns: int) -> Picture:
        """All labels with an existence of at least `report_existence`, as of the last scan.

        Means and covariances are averages over a label's association histories that mean the same place, not
        over all: a mean between two places would be a place where nobody is (see `showing`). Labels that
        interact are shown as in the most probable joint hypothesis that holds all the likely ones, so that
        two labels are not shown at one object.
        """
        found = self.estimates()
        columns = (found.mean, found.cov, found.existence.tolist(), found.estimated.tolist())
        tracks = tuple(
            Track((k, i), *row)
            for (k, i), row in zip(found.label.tolist(), zip(*columns, strict=True), strict=True)
        )
        scan_t_ns = t_ns if self._t_ns is None else self._t_ns
        return Picture(t_ns, scan_t_ns, self.kind, tracks, found.cardinality)

    def estimates(self) -> Estimates:
        """Return what `picture` shows as read-only arrays; for large scenes, where records take time."""
        posterior = self._posterior
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

    def estimate(self) -> tuple[Track, ...]:
        """Return who is there: the tracks of `picture` that are in the MAP-cardinality estimate."""
        return tuple(track for track in self.picture(0).tracks if track.estimated)

    def _interval(self, dt_s: float) -> Interval:
        """Return what happened since the scan before."""
        params = self.params
        Q = _process_noise(dt_s, params.accel_std_m_s2, params.acceleration)
        survival = _survival_terms(self._survival_probability(dt_s), float(params.lost_std_m))
        return Interval(dt_s, Q, survival, self.scans, self._birth_components)

    def _survival_probability(self, dt_s: float) -> float:
        return float(max(min(self.params.survival_probability_per_s, 1.0) ** dt_s, 1.0 - SURE))


@lru_cache(maxsize=64)
def _survival_terms(survival: float, lost_std_m: float) -> kalman.Survival:
    """Return what happens to tracks that survive so probably; those that are given up all but die."""
    survive = np.array([survival, 1.0 - SURE])
    log_survival = np.log(survive)
    log_death = np.log1p(-survive, out=np.full(2, -np.inf), where=survive < 1.0)
    return kalman.Survival(
        log_survival[0], log_death[0], log_survival[1], log_death[1], lost_std_m * lost_std_m
    )


@lru_cache(maxsize=64)
def _process_noise(
    dt_s: float, accel_std_m_s2: float, acceleration: constant_velocity.Acceleration
) -> FloatArray:
    return constant_velocity.process_noise(dt_s, accel_std_m_s2, acceleration)


def warm_up_calls() -> list[jit.Call]:
    """One call of every kernel that a tracker calls, types as there; for histories see `recovery`."""
    return [
        *extraction.warm_up_calls(),
        *recursion.warm_up_calls(),
        *clutter.warm_up_calls(),
        *coordinated_turn.warm_up_calls(),
    ]


def warm_up_parts() -> list[jit.Call]:
    """One call of every kernel that is a part of these, types as there."""
    return recursion.warm_up_parts()


def warm_up() -> None:
    """Compile every kernel, or load it from the cache: seconds, once; without it the first scans pay."""
    jit.warm_up(__name__)
