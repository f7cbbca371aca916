"""The GLMB tracker with a user's models: scans of detections in, estimates out.

It is `glmb.filter.Glmb` for states and measurements of any dimension, for data sets (`gcs.tracking.batch`). A
scan takes some milliseconds, since Kalman steps and the user's functions run in numpy. So for positions, or
range and bearing, in the plane and one motion model the other filter is used.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs.jit import Call
from gcs.model import NS_PER_S, FloatArray, Sensor
from gcs.tracking.glmb.extraction import Estimates
from gcs.tracking.glmb.hypotheses import Clusters
from gcs.tracking.glmb.kalman import Interval
from gcs.tracking.glmb.params import Birth, BirthComponents, GlmbParams
from gcs.tracking.glmb.recursion import Posterior
from gcs.tracking.models.survival import survival_probability, survival_terms
from gcs.tracking.state_space.estimates import extract_estimates, label_marginals
from gcs.tracking.state_space.histories import StateSpaceHistories
from gcs.tracking.state_space.merging import find_similar_tracks
from gcs.tracking.state_space.models import MeasurementModel, MotionModel, SwitchingMotion, switching
from gcs.tracking.state_space.recursion import Births, update_step
from gcs.tracking.state_space.sensors import scan_model


class StateSpaceGlmb:
    """A GLMB tracker with models of any dimension.

    Parameters
    ----------
    motion : MotionModel or SwitchingMotion
    params : GlmbParams
        Survival and limits.
    seed : int
        Seed of the Gibbs sampler, which large clusters alone use.
    keep_histories : bool
        True to keep association histories, for whole trajectories.

    Attributes
    ----------
    posterior : Posterior
        State after the last scan; its `turn` has the mode probabilities of each track.
    histories : StateSpaceHistories or None
        Association histories.
    explained : ndarray, shape (m,)
        Probability that a track made each detection of the last scan; 1 for one that is not usable.
    scans, late_scans, bad_detections : int
        Number of scans processed and refused, and of detections that were not finite.
    """

    def __init__(
        self,
        motion: MotionModel | SwitchingMotion,
        params: GlmbParams,
        seed: int,
        *,
        keep_histories: bool = False,
    ) -> None:
        self.motion = motion = switching(motion)
        self.params = params
        self.histories = StateSpaceHistories(motion) if keep_histories else None
        self.explained: FloatArray = np.empty(0)
        self.scans = 0
        self.late_scans = 0
        self.bad_detections = 0
        self._t_ns: int | None = None
        self._limits = params.limits()
        self._rng = np.array([seed % 2**64], np.uint64)
        self.posterior = _empty(len(motion.names), len(motion.models))

    def update(
        self,
        t_ns: int,
        z: FloatArray,
        sensor: Sensor | MeasurementModel,
        births: Sequence[Birth] = (),
        log_ratio: FloatArray | None = None,
    ) -> None:
        """Process a scan; one that is older than the last is only counted.

        Parameters
        ----------
        t_ns : int
            Time of measurement. It may equal that of the last scan (another sensor).
        z : (m, k) array
            Detections in the coordinates of the sensor's model; of a `Sensor` (m, 2), east and north in
            metres.
        sensor : Sensor or MeasurementModel
        births : sequence of Birth
            Birth components of this scan, of d states. Birth i gets the label (scan number, i).
        log_ratio : (m,) array, optional
            Log-likelihood ratio of what else was measured of each detection, object against clutter.

        Raises
        ------
        ValueError
            If `z` has another shape, or a function of a model returns another one.
        """
        if self._t_ns is not None and t_ns < self._t_ns:
            self.late_scans += 1
            return
        dt_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) / NS_PER_S
        self._t_ns = t_ns
        scan = scan_model(sensor, self.motion.names, z, log_ratio)
        survival = survival_probability(self.params.survival_probability_per_s, dt_s)
        terms = survival_terms(survival, float(self.params.lost_std_m))
        components = BirthComponents.from_births(births, len(self.motion.names))
        result = update_step(
            self.posterior,
            self.motion,
            dt_s,
            terms,
            Births(components, self.scans),
            scan,
            self._limits,
            self._rng,
        )
        self.posterior = result.posterior
        self.explained = np.ones(scan.usable.size)
        self.explained[scan.usable] = result.explained
        self.bad_detections += int(np.count_nonzero(~scan.usable))
        if self.histories is not None:
            interval = Interval(dt_s, np.empty((0, 0)), terms, self.scans, components)
            self.histories.add(t_ns, sensor, tuple(births), survival, interval, scan, result)
        self.scans += 1

    def estimates(self) -> Estimates:
        """Return the estimates as of the last scan; means are (n, d), covariances (n, d, d)."""
        return extract_estimates(self.posterior, float(self.params.min_reported_existence))


def warm_up_calls() -> list[Call]:
    """Return one call of every kernel that only this filter uses, with the types of a tracker."""
    clusters = Clusters.example()
    zeros = np.zeros(1, np.int64)
    mean = np.zeros((1, 4))
    return [
        (label_marginals, clusters, zeros, 1),
        (find_similar_tracks, clusters, mean, np.eye(4).reshape(1, 4, 4), zeros, 1.0),
    ]


def _empty(d: int, modes: int) -> Posterior:
    return Posterior.empty()._replace(
        mean=np.empty((0, d)), cov=np.empty((0, d, d)), turn=np.empty((0, modes))
    )
