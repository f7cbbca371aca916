"""The GLMB tracker: scans of detections in, a picture of labelled tracks out.

The delta-generalised labelled multi-Bernoulli filter with joint prediction and update (B.-N. Vo, B.-T. Vo &
H. Hoang, "An efficient implementation of the generalized labeled multi-Bernoulli filter", IEEE TSP 65, 2017),
one Gaussian per track, kept as a product over groups of interacting labels (Beard, Vo & Vo, IEEE TSP 68,
2020). This module holds the state and the order of the steps; the numerics are compiled, in `kernels` (one
object), `hypotheses` (joint association) and `partition` (which labels interact).

Model: an object survives dt with probability p_S^dt and moves as in `motion`; a sensor detects it with p_D
while it is inside the field of view, at most once, with Gaussian noise (see `sensors`); all else in a
scan is Poisson clutter; new objects appear where the caller says that they may (a labelled multi-Bernoulli
birth for each scan).

The tracker is a pure value machine: time is an argument, randomness comes from a seed, and the same calls
give the same bytes. No input makes it raise once constructed: what it cannot use it counts (`late_scans`,
`bad_detections`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs import compiling
from gcs.model import NS_PER_S, FloatArray, Kind, Picture, Sensor, Track
from gcs.tracking import gates, intensity, kernels, motion, sensors, showing, summing, turning
from gcs.tracking.alone import Tracks, alone
from gcs.tracking.hypotheses import Groups, Limits, Options, children, option_keys
from gcs.tracking.merging import merge_alike
from gcs.tracking.partition import meet, part, renumber
from gcs.tracking.recovery import Histories

_SURE = 1.0 - 1e-9
"""Probabilities are held below it: a model that is certain cannot be corrected."""
_LEAST_CLUTTER_PER_M2 = 1e-15
_SURELY_THERE, _SURELY_IN_VIEW = 0.95, 0.999
"""Objects that tell how probably a sensor detects what it looks at."""


@dataclass(frozen=True, slots=True)
class Birth:
    """Where an object may appear at a scan: a Gaussian at the time of the scan, and how probable it is."""

    mean: FloatArray
    """(4,) east_m, north_m, v_east_m_s, v_north_m_s."""
    cov: FloatArray
    """(4, 4)."""
    probability: float


@dataclass(frozen=True, slots=True)
class GlmbParams:
    """Model and limits of a tracker. The limits' defaults bound the error; they are not there to be tuned."""

    accel_std_m_s2: float
    """Velocity gained in a second, standard deviation (see `motion`)."""
    acceleration: motion.Acceleration = "white"
    """Which of the two models of `motion`."""
    turn_rate_std_rad_s: float = 0.0
    """Standard deviation of the rate at which objects turn (see `turning`); 0: they fly straight."""
    turn_time_s: float = 5.0
    """How long a turn lasts."""
    survival_probability_per_s: float = 0.99
    lost_std_m: float = math.inf
    """A track whose position is known worse than this, along its worst axis, is given up."""
    max_hypotheses: int = 300
    """Of one group of interacting labels."""
    gate_chi2: float = 32.2
    """Squared Mahalanobis distance of the gate: 2 degrees of freedom, 1e-7 of the detections outside."""
    prune_weight: float = 1e-4
    """Hypotheses below this share of their group's best are dropped."""
    forget_existence: float = 1e-5
    """Labels below it are forgotten."""
    report_existence: float = 1e-3
    """Labels below it are not in the picture."""
    conflict: float = 1e-3
    """Labels that would take the same detection less probably than this are associated apart."""
    dependence: float = 0.01
    """Labels closer to independence than this total variation are tracked apart."""
    merge_chi2: float = 1.0
    """Tracks of one label closer than this squared Mahalanobis distance become one; 0: never."""
    enumerable: int = 100_000
    """Most joint options of a hypothesis, of those that are not hopeless, whose children are enumerated;
    beyond, they are sampled."""
    gibbs_sweeps: int = 1000
    """Per group and scan, shared by its sampled hypotheses."""


class Account(NamedTuple):
    """What the tracks make of a scan's detections: for births, and to check a sensor's word."""

    explained: FloatArray
    """(m,) probability that some track made each detection; 1 for one that is unusable."""
    detected: float
    """How many of the objects that were there beyond doubt, and surely in view, made a detection."""
    in_view: float
    """How many those were."""


class _Born(NamedTuple):
    """Births as arrays, made once of known places: one tuple, the same at each scan."""

    births: tuple[Birth, ...]
    mean: FloatArray
    """(n, 4)."""
    cov: FloatArray
    """(n, 4, 4)."""
    probability: FloatArray
    """(n,) within (0, 1)."""

    @classmethod
    def of(cls, births: Sequence[Birth]) -> _Born:
        """Convert; what is not a tuple might change, and is kept as a tuple of its own."""
        probability = np.array([birth.probability for birth in births])
        return cls(
            tuple(births),
            np.array([birth.mean for birth in births], dtype=np.float64).reshape(-1, 4),
            np.array([birth.cov for birth in births], dtype=np.float64).reshape(-1, 4, 4),
            np.clip(probability, 1.0 - _SURE, _SURE),
        )


class _Look(NamedTuple):
    """The usable detections of a scan, in the order of `gates.strips`."""

    z: FloatArray
    """(m, 2) as the sensor measured them."""
    place_m: FloatArray
    """(m, 2) east/north."""
    log_clutter: FloatArray
    """(m,) of the clutter intensity there, per unit of `z`."""
    rows: npt.NDArray[np.int64]
    """(m,) which detection of the scan each is."""


class _Made(NamedTuple):
    """Probabilities that add up over the groups of a scan."""

    explained: FloatArray
    """(m,) that some track made each usable detection."""
    detected: FloatArray
    """(labels,) that each label, before the scan, was detected."""
    there: FloatArray
    """(labels,) that it is there."""


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
        self._limits = Limits(
            int(params.max_hypotheses),
            math.log(params.prune_weight),
            float(params.forget_existence),
            float(params.conflict),
            float(params.dependence),
            int(params.enumerable),
            int(params.gibbs_sweeps),
        )
        self._rng = np.array([seed % 2**64], dtype=np.uint64)
        self._keys = option_keys(256)
        self._t_ns: int | None = None
        self._labels = np.empty((0, 2), np.int64)
        """Scan of birth and index there."""
        self._sure = np.empty(0, np.bool_)
        """Whether each label existed beyond doubt after the last scan."""
        self._track_label = np.empty(0, np.int64)
        """Index into `_labels` for each track; a label's tracks stand together."""
        self._mean, self._cov = np.empty((0, 4)), np.empty((0, 4, 4))
        self._turn = None if self._turns is None else np.empty((0, 6))
        """Turn rates (see `turning`)."""
        self._born = _Born.of(())
        self._groups = Groups(
            np.zeros(1, np.int64), np.zeros(1, np.int64), np.empty(0, np.int64), np.empty(0)
        )

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
        clutter = sensors.clutter_per_m2(sensor, np.reshape(z_m, (-1, 2)))
        look = self._usable(
            z_m, clutter if clutter_density_per_m2 is None else clutter_density_per_m2, sensor
        )
        F = motion.transition(dt_s)
        Q = motion.process_noise(dt_s, self.params.accel_std_m_s2, self.params.acceleration)
        live = self._predict(dt_s, Q, births)
        view = sensors.view(sensor, self._mean, self._cov)
        if self.histories is not None:
            self.histories.begin(measured_t_ns, dt_s, F, Q, sensor, births, self._survival(dt_s))
        start, meas, logw = gates.options(
            self._cov,
            np.log(live),
            np.log1p(-live, out=np.full(live.size, -np.inf), where=live < 1.0),
            look.z,
            view,
            look.log_clutter,
            float(self.params.gate_chi2),
        )
        if meas.size > self._keys.size:
            self._keys = option_keys(2 * meas.size)
        options = Options(start, meas, logw, self._keys)
        sure = self._surely_in_view(view) if self._weigh_detections else None
        made = _Made(np.zeros(look.rows.size), np.zeros(len(self._labels)), np.zeros(len(self._labels)))
        if live.size:
            self._associate(options, look, view, made)
        if sure is not None:
            explained = np.ones(len(clutter))
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
        existence, shown, cardinality = summing.summary(self._groups, self._track_label, len(self._labels))
        estimate = summing.map_tracks(self._groups)
        estimated = self._track_label[estimate]
        shown[estimated] = estimate
        is_estimated = np.zeros(existence.size, np.bool_)
        is_estimated[estimated] = True
        rows = np.flatnonzero((existence >= self.params.report_existence) | is_estimated)
        rows = rows[np.lexsort(self._labels[rows].T[::-1])]
        probability = summing.probabilities(self._groups, self._track_label.size)
        mean, cov = showing.averaged(probability, self._track_label, shown[rows], self._mean, self._cov)
        columns = (self._labels[rows], mean, cov, existence[rows], is_estimated[rows])
        for column in (*columns, cardinality):
            column.flags.writeable = False
        return Estimates(*columns, cardinality)

    def estimate(self) -> tuple[Track, ...]:
        """Return who is there: the tracks of `picture` that are in the MAP-cardinality estimate."""
        return tuple(track for track in self.picture(0).tracks if track.estimated)

    def _usable(self, z_m: FloatArray, clutter_per_m2: FloatArray, sensor: Sensor) -> _Look:
        """Take the detections that are finite, in the order that the gates need."""
        place_m = np.array(z_m, dtype=np.float64).reshape(-1, 2)
        clutter = np.maximum(clutter_per_m2, _LEAST_CLUTTER_PER_M2) * sensors.cell_m2(sensor, place_m)
        z, log_clutter = sensors.measured(sensor, place_m), np.log(clutter)
        rows = np.flatnonzero(np.isfinite(z).all(axis=1) & np.isfinite(log_clutter))
        self.bad_detections += len(place_m) - rows.size
        rows = rows[gates.strips(z[rows])]
        return _Look(z[rows], place_m[rows], log_clutter[rows], rows)

    def _surely_in_view(self, view: sensors.View) -> npt.NDArray[np.bool_]:
        """Return which labels existed beyond doubt and are in view whichever of their tracks is right."""
        in_view = np.ones(len(self._labels))
        np.minimum.at(in_view, self._track_label, view.inside)
        return np.asarray(self._sure & (in_view > _SURELY_IN_VIEW))

    def _survival(self, dt_s: float) -> float:
        return float(max(min(self.params.survival_probability_per_s, 1.0) ** dt_s, 1.0 - _SURE))

    def _predict(self, dt_s: float, Q: FloatArray, births: Sequence[Birth]) -> FloatArray:
        """Move the tracks by `dt_s`, add births as groups of their own; return each track's survival."""
        if dt_s > 0.0 and self._turns is not None:
            self._mean, self._cov, self._turn = turning.predict(
                self._mean, self._cov, self._turn, Q, dt_s, *self._turns
            )
        elif dt_s > 0.0:
            self._mean, self._cov = kernels.predict(self._mean, self._cov, dt_s, Q)
        live = np.full(self._track_label.size, self._survival(dt_s))
        if math.isfinite(self.params.lost_std_m):
            variance = np.maximum(self._cov[:, 0, 0], self._cov[:, 1, 1])
            live[variance > self.params.lost_std_m**2] = 1.0 - _SURE
        if not births:
            return live
        n, new = live.size, np.arange(len(births))
        groups = self._groups
        self._groups = Groups(
            np.concatenate([groups.first, groups.first[-1] + 1 + new]),
            np.concatenate([groups.start, groups.start[-1] + 1 + new]),
            np.concatenate([groups.items, n + new]),
            np.concatenate([groups.logw, np.zeros(len(births))]),
        )
        born = self._born = self._born if births is self._born.births else _Born.of(births)
        self._mean = np.concatenate([self._mean, born.mean])
        self._cov = np.concatenate([self._cov, born.cov])
        if self._turns is not None:
            newborn = turning.newborn(len(births), self._turns.rate_std_rad_s)
            self._turn = np.concatenate([self._turn, newborn])
        self._track_label = np.concatenate([self._track_label, len(self._labels) + new])
        self._labels = np.concatenate([self._labels, np.column_stack([np.full(new.size, self.scans), new])])
        self._sure = np.concatenate([self._sure, np.zeros(new.size, np.bool_)])
        return np.concatenate([live, born.probability])

    def _associate(self, options: Options, look: _Look, view: sensors.View, made: _Made) -> None:
        """Update the groups by the scan, and keep the tracks that some hypothesis still holds."""
        lone, groups = meet(self._groups, options, self._track_label, look.rows.size, self._limits)
        tracks = alone(
            self._groups,
            lone,
            options,
            self._mean,
            self._cov,
            self._track_label,
            look.z,
            view,
            self._limits,
            float(self.params.merge_chi2),
            *made,
        )
        if groups.logw.size:
            tracks = tracks.and_of(self._jointly(groups, options, look, view, made))
        parent, meas = tracks.parent, options.meas[tracks.option]
        if self._turn is not None:
            self._turn = turning.update(self._cov, self._turn, parent, meas, look.z, view)
        if self.histories is not None:
            self.histories.extend(parent, meas, options.logw[tracks.option], look.place_m)
        self._groups, self._mean, self._cov = tracks.groups, tracks.mean, tracks.cov
        track_label = self._track_label[parent]
        is_next = np.diff(track_label, prepend=-1) != 0
        self._track_label = np.cumsum(is_next) - 1
        kept = track_label[is_next]
        self._labels, self._sure = self._labels[kept], made.there[kept] > _SURELY_THERE

    def _jointly(
        self, groups: Groups, options: Options, look: _Look, view: sensors.View, made: _Made
    ) -> Tracks:
        """Update groups of labels that compete."""
        groups = children(groups, options, look.rows.size, self._limits, self._rng)
        groups, option = renumber(groups, options.meas.size)
        parent, meas = np.searchsorted(options.start, option, side="right") - 1, options.meas[option]
        mean, cov = kernels.update(self._mean, self._cov, parent, meas, look.z, view)
        track_label = self._track_label[parent]
        if self._weigh_detections:
            probability, seen = summing.probabilities(groups, meas.size), meas >= 0
            np.add.at(made.explained, meas[seen], probability[seen])
            np.add.at(made.detected, track_label[seen], probability[seen])
            np.add.at(made.there, track_label, probability)
        groups = merge_alike(groups, mean, cov, track_label, self._keys, self.params.merge_chi2)
        groups = part(groups, track_label, len(self._labels), self._keys, self._limits)
        groups, used = renumber(groups, parent.size)
        return Tracks(groups, parent[used], option[used], mean[used], cov[used])


def warm_up_calls() -> list[compiling.Call]:
    """One call of every kernel, types as in a tracker; the longest to compile stand at the ends."""
    ones, zeros = np.ones(1), np.zeros(1, np.int64)
    mean, cov, z = np.zeros((1, 4)), np.eye(4).reshape(1, 4, 4), np.zeros((1, 2))
    matrix = np.eye(2).reshape(1, 2, 2)
    view = sensors.View(z, matrix, matrix, ones, 0.9, wraps=False)
    limits = Limits(1, -1.0, 0.1, 0.1, 0.1, 1, 1)
    groups = Groups(np.arange(2), np.arange(2), zeros, np.zeros(1))
    options = Options(np.arange(2), zeros, ones, np.zeros(1, np.uint64))
    return [
        (option_keys, 1),
        (children, groups, options, 1, limits, np.zeros(1, np.uint64)),
        (meet, groups, options, zeros, 1, limits),
        (alone, groups, zeros, options, mean, cov, zeros, z, view, limits, 0.1, ones, ones, ones),
        (merge_alike, groups, mean, cov, zeros, options.key, 0.1),
        (gates.options, cov, ones, ones, z, view, ones, 9.0),
        (kernels.update, mean, cov, zeros, zeros, z, view),
        (summing.summary, groups, zeros, 1),
        (summing.map_tracks, groups),
        (summing.probabilities, groups, 1),
        (kernels.predict, mean, cov, 1.0, np.eye(4)),
        (renumber, groups, 1),
        *sensors.warm_up_calls(),
        *intensity.warm_up_calls(),
        *turning.warm_up_calls(),
        *showing.warm_up_calls(),
        (part, groups, zeros, 1, options.key, limits),
    ]


def warm_up() -> None:
    """Compile every kernel, or load it from the cache: seconds, once; without it the first scans pay."""
    compiling.warm_up(__name__)
