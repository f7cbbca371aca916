"""The GLMB tracker: scans of detections in, a picture of labelled tracks out.

The delta-generalised labelled multi-Bernoulli filter with joint prediction and update (B.-N. Vo, B.-T. Vo &
H. Hoang, "An efficient implementation of the generalized labeled multi-Bernoulli filter", IEEE TSP 65, 2017),
one Gaussian per track, kept as a product over groups of interacting labels (Beard, Vo & Vo, IEEE TSP 68,
2020). This module holds the state and the order of the steps; the numerics are compiled: `kernels` and
`gates` (one object), `meeting`, `claims` and `parting` (which labels interact), `alone` and `search`
(association), `association` (all of that for a scan), `merging` and `summing`.

Model: an object survives dt with probability p_S^dt and moves as in `motion`; a sensor detects it with p_D
while it is inside the field of view, at most once, with Gaussian noise (see `views`); all else in a
scan is Poisson clutter; new objects appear where the caller says that they may (a labelled multi-Bernoulli
birth for each scan).

The tracker is a pure value machine: time is an argument, randomness comes from a seed, and the same calls
give the same bytes. No input makes it raise once constructed: what it cannot use it counts (`late_scans`,
`bad_detections`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs import compiling
from gcs.model import NS_PER_S, FloatArray, Kind, Picture, Sensor, Track
from gcs.tracking import gates, intensity, kernels, motion, showing, summing, turning, views
from gcs.tracking.alone import Made, alone
from gcs.tracking.association import associate
from gcs.tracking.hypotheses import Groups, Limits, Options
from gcs.tracking.looks import Look, look_at
from gcs.tracking.meeting import meet
from gcs.tracking.merging import merge_alike
from gcs.tracking.params import SURE, Birth, GlmbParams, Newborn
from gcs.tracking.parting import part, renumber
from gcs.tracking.recovery import Histories
from gcs.tracking.search import children

__all__ = ["Account", "Birth", "Estimates", "Glmb", "GlmbParams", "warm_up", "warm_up_calls"]

_SURELY_THERE, _SURELY_IN_VIEW = 0.95, 0.999
"""Objects that tell how probably a sensor detects what it looks at."""
_NO_GROUPS = Groups(np.zeros(1, np.int64), np.zeros(1, np.int64), np.empty(0, np.int64), np.empty(0))
_NOTHING_MADE = Made(np.empty(0), np.empty(0), np.empty(0))


class Account(NamedTuple):
    """What the tracks make of a scan's detections: for births, and to check a sensor's word."""

    explained: FloatArray
    """(m,) probability that some track made each detection; 1 for one that is unusable."""
    detected: float
    """How many of the objects that were there beyond doubt, and surely in view, made a detection."""
    in_view: float
    """How many those were."""


class Estimates(NamedTuple):
    """A picture as arrays, a row for each of its labels, in their order."""

    label: npt.NDArray[np.int64]
    """(n, 2) scan of birth and index there."""
    mean: FloatArray
    """(n, 4)."""
    cov: FloatArray
    """(n, 4, 4)."""
    existence: FloatArray
    """(n,)."""
    estimated: npt.NDArray[np.bool_]
    """(n,) whether it is in the MAP-cardinality estimate."""
    cardinality: FloatArray
    """(k,) probability of each number of objects."""


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
        weigh_detections: bool = False,
    ) -> None:
        self.kind: Kind = kind
        self.params = params
        self._turns = None
        if params.turn_rate_std_rad_s > 0.0:
            self._turns = turning.Turns(params.turn_rate_std_rad_s, params.turn_time_s)
        self.histories = Histories(self._turns) if keep_histories else None
        self.account: Account | None = None
        self.scans = self.late_scans = self.bad_detections = 0
        self._weigh_detections = weigh_detections
        self._limits = params.limits()
        self._rng = np.array([seed % 2**64], dtype=np.uint64)
        self._t_ns: int | None = None
        self._labels = np.empty((0, 2), np.int64)
        """Scan of birth and index there."""
        self._sure = np.empty(0, np.bool_)
        """Whether each label existed beyond doubt after the last scan, where detections are weighed."""
        self._track_label = np.empty(0, np.int64)
        """Index into `_labels` for each track; a label's tracks stand together."""
        self._mean, self._cov = np.empty((0, 4)), np.empty((0, 4, 4))
        self._turn = None if self._turns is None else np.empty((0, 6))
        """Turn rates (see `turning`)."""
        self._births: tuple[Birth, ...] = ()
        self._newborn = Newborn.of(())
        self._groups = _NO_GROUPS

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
        """
        if self._t_ns is not None and measured_t_ns < self._t_ns:
            self.late_scans += 1
            return
        dt_s = 0.0 if self._t_ns is None else (measured_t_ns - self._t_ns) / NS_PER_S
        self._t_ns = measured_t_ns
        look = look_at(sensor, z_m, clutter_density_per_m2)
        self.bad_detections += look.taken - look.rows.size
        F = motion.transition(dt_s)
        Q = motion.process_noise(dt_s, self.params.accel_std_m_s2, self.params.acceleration)
        log_live, log_die = self._foresee(dt_s, Q, births)
        view = views.view(sensor, self._mean, self._cov)
        if self.histories is not None:
            self.histories.begin(measured_t_ns, dt_s, F, Q, sensor, births, self._survival(dt_s))
        start, meas, logw = gates.options(
            self._cov,
            log_live,
            log_die,
            look.z,
            view,
            look.log_clutter,
            float(self.params.gate_chi2),
        )
        options = Options(start, meas, logw)
        sure = self._surely_in_view(view) if self._weigh_detections else None
        n_labels = len(self._labels)
        made = _NOTHING_MADE
        if self._weigh_detections:
            made = Made(np.zeros(look.rows.size), np.zeros(n_labels), np.zeros(n_labels))
        if log_live.size:
            self._associate(options, look, view, made)
        if sure is not None:
            explained = np.ones(look.taken)
            explained[look.rows] = np.minimum(made.explained, 1.0)
            self.account = Account(explained, float(made.detected[sure].sum()), float(sure.sum()))
        if self.histories is not None:
            tracks = summing.map_tracks(self._groups)
            labels = self._labels[self._track_label[tracks]].tolist()
            self.histories.end({(k, i): t for (k, i), t in zip(labels, tracks.tolist(), strict=True)})
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
        existence, shown, estimate, cardinality, probability = summing.summary(
            self._groups, self._track_label, len(self._labels)
        )
        shown[self._track_label[estimate]] = estimate
        estimated = np.zeros(existence.size, np.bool_)
        estimated[self._track_label[estimate]] = True
        rows = np.flatnonzero((existence >= self.params.report_existence) | estimated)
        rows = rows[np.argsort(self._labels[rows] @ np.array([2**32, 1]))]
        mean, cov = showing.averaged(probability, self._track_label, shown[rows], self._mean, self._cov)
        columns = (self._labels[rows], mean, cov, existence[rows], estimated[rows])
        for column in (*columns, cardinality):
            column.flags.writeable = False
        return Estimates(*columns, cardinality)

    def estimate(self) -> tuple[Track, ...]:
        """Return who is there: the tracks of `picture` that are in the MAP-cardinality estimate."""
        return tuple(track for track in self.picture(0).tracks if track.estimated)

    def _surely_in_view(self, view: views.View) -> npt.NDArray[np.bool_]:
        """Return which labels existed beyond doubt and are in view whichever of their tracks is right."""
        in_view = np.ones(len(self._labels))
        np.minimum.at(in_view, self._track_label, view.inside)
        return np.asarray(self._sure & (in_view > _SURELY_IN_VIEW))

    def _survival(self, dt_s: float) -> float:
        return float(max(min(self.params.survival_probability_per_s, 1.0) ** dt_s, 1.0 - SURE))

    def _foresee(self, dt_s: float, Q: FloatArray, births: Sequence[Birth]) -> tuple[FloatArray, FloatArray]:
        """Move the tracks by `dt_s`, add births as groups of their own.

        Returns the logs of each track's probability to live, or to appear, and not to.
        """
        if births is not self._births:
            # Known places are one tuple, the same at each scan; what is not a tuple might change.
            self._births, self._newborn = tuple(births), Newborn.of(births)
        chances = _chances(self._survival(dt_s), float(self.params.lost_std_m))
        if self._turns is not None:
            if dt_s > 0.0:
                self._mean, self._cov, self._turn = turning.predict(
                    self._mean, self._cov, self._turn, Q, dt_s, *self._turns
                )
            newborn = turning.newborn(len(births), self._turns.rate_std_rad_s)
            self._turn = np.concatenate([self._turn, newborn])
            dt_s, Q = 0.0, np.zeros((4, 4))
        foreseen = kernels.foresee(
            self._groups,
            self._track_label,
            self._labels,
            self._mean,
            self._cov,
            dt_s,
            Q,
            chances,
            self.scans,
            self._newborn,
        )
        self._groups, self._track_label, self._labels, self._mean, self._cov, log_live, log_die = foreseen
        if self._weigh_detections:
            self._sure = np.concatenate([self._sure, np.zeros(len(births), np.bool_)])
        return log_live, log_die

    def _associate(self, options: Options, look: Look, view: views.View, made: Made) -> None:
        """Update the groups by the scan, and keep the tracks that some hypothesis still holds."""
        tracks = associate(
            self._groups,
            options,
            self._track_label,
            len(self._labels),
            self._mean,
            self._cov,
            look.z,
            view,
            self._limits,
            float(self.params.merge_chi2),
            self._rng,
            made,
        )
        parent = tracks.parent
        if self._turn is not None:
            self._turn = turning.update(
                self._cov, self._turn, parent, options.meas[tracks.option], look.z, view
            )
        if self.histories is not None:
            meas, logw = options.meas[tracks.option], options.logw[tracks.option]
            self.histories.extend(parent, meas, logw, look.place_m)
        self._groups = tracks.groups
        self._mean, self._cov = tracks.mean[: parent.size], tracks.cov[: parent.size]
        self._track_label, self._labels = tracks.label, self._labels[tracks.kept]
        if self._weigh_detections:
            self._sure = made.there[tracks.kept] > _SURELY_THERE


@lru_cache(maxsize=64)
def _chances(survival: float, lost_std_m: float) -> kernels.Chances:
    """Return what happens to tracks that survive so probably; those that are given up all but die."""
    live = np.array([survival, 1.0 - SURE])
    log_live = np.log(live)
    log_die = np.log1p(-live, out=np.full(2, -np.inf), where=live < 1.0)
    return kernels.Chances(log_live[0], log_die[0], log_live[1], log_die[1], lost_std_m * lost_std_m)


def warm_up_calls() -> list[compiling.Call]:
    """One call of every kernel that a tracker calls, types as there."""
    groups, options, mean, cov, view, limits = _small()
    ones, zeros = np.ones(1), np.zeros(1, np.int64)
    made, rng, z = Made(ones, ones, ones), np.zeros(1, np.uint64), np.zeros((1, 2))
    chances, ids, born = kernels.Chances(0.0, 0.0, 0.0, 0.0, 1.0), np.zeros((1, 2), np.int64), Newborn.of(())
    return [
        (summing.map_tracks, groups),
        (kernels.foresee, groups, zeros, ids, mean, cov, 1.0, np.eye(4), chances, 1, born),
        (gates.options, cov, ones, ones, z, view, ones, 9.0),
        (associate, groups, options, zeros, 1, mean, cov, z, view, limits, 0.1, rng, made),
        (summing.summary, groups, zeros, 1),
        *showing.warm_up_calls(),
        *views.warm_up_calls(),
        *intensity.warm_up_calls(),
        *turning.warm_up_calls(),
    ]


def warm_up_parts() -> list[compiling.Call]:
    """One call of every kernel that is a part of `associate`, types as there.

    The longest to compile stand at the ends, beside those that share leaves with them: where two processes
    meet, both compile the same one, so that had better be short.
    """
    groups, options, mean, cov, view, limits = _small()
    ones, zeros, z = np.ones(1), np.zeros(1, np.int64), np.zeros((1, 2))
    made = Made(ones, ones, ones)
    return [
        (children, groups, options, 1, limits, np.zeros(1, np.uint64)),
        (meet, groups, options, zeros, 1, limits),
        (renumber, groups, 1),
        (summing.probabilities, groups, 1),
        (kernels.update, mean, cov, zeros, zeros, z, view),
        (alone, groups, zeros, options, mean, cov, zeros, z, view, limits, 0.1, 1, made),
        (merge_alike, groups, mean, cov, zeros, 0.1),
        (part, groups, zeros, 1, limits),
    ]


def _small() -> tuple[Groups, Options, FloatArray, FloatArray, views.View, Limits]:
    """Return the least that kernels can be called with."""
    ones, zeros = np.ones(1), np.zeros(1, np.int64)
    mean, cov, z = np.zeros((1, 4)), np.eye(4).reshape(1, 4, 4), np.zeros((1, 2))
    matrix = np.eye(2).reshape(1, 2, 2)
    view = views.View(z, matrix, matrix, ones, 0.9, wraps=False)
    groups = Groups(np.arange(2), np.arange(2), zeros, np.zeros(1))
    options = Options(np.arange(2), zeros, ones)
    return groups, options, mean, cov, view, Limits(1, -1.0, 0.1, 0.1, 0.1, 1, 1)


def warm_up() -> None:
    """Compile every kernel, or load it from the cache: seconds, once; without it the first scans pay."""
    compiling.warm_up(__name__)
