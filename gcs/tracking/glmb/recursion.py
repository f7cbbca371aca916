"""Compiled: all that a scan does to a tracker, in one call.

Calling a compiled function takes a quarter of a microsecond for each array that goes in or comes out: in a
small scene, with a call for each step, that was longer than the steps themselves. So what a tracker believes
is one record, which comes out of a scan as it goes into the next, and the steps are these: move the tracks
on, put the detections in order, look at the tracks through the sensor, list their options, associate.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gcs.jit import Call, kernel, leaf
from gcs.tracking.clusters.factorisation import part, renumber
from gcs.tracking.clusters.merging import meet
from gcs.tracking.clusters.singleton import SingletonUpdate, alone
from gcs.tracking.glmb.association import Carried, associate
from gcs.tracking.glmb.gating import options
from gcs.tracking.glmb.hypotheses import Clusters, Limits, Options
from gcs.tracking.glmb.kalman import Chances, foresee
from gcs.tracking.glmb.marginals import probabilities
from gcs.tracking.glmb.measurements import Measurements, look_at
from gcs.tracking.glmb.merging import merge_alike
from gcs.tracking.glmb.params import BirthComponents, GlmbParams
from gcs.tracking.glmb.ranked_assignment import children
from gcs.tracking.models import coordinated_turn, measurement
from gcs.tracking.models.coordinated_turn import Turns

_SURELY_THERE, _SURELY_IN_VIEW = 0.95, 0.999
"""Objects that tell how probably a sensor detects what it looks at."""


class Posterior(NamedTuple):
    """What a tracker believes after a scan."""

    groups: Clusters
    track_label: Any
    """(n,) index into `labels` for each track; a label's tracks stand together."""
    labels: Any
    """(labels, 2) scan of birth and index there."""
    mean: Any
    """(n, 4)."""
    cov: Any
    """(n, 4, 4)."""
    turn: Any
    """(n, 6) turn rates (see `turning`); of no track where objects fly straight."""
    sure: Any
    """(labels,) whether each existed beyond doubt; empty where detections are not weighed."""

    @classmethod
    def nothing(cls) -> Posterior:
        """Return what is believed before the first scan."""
        none, ids = np.zeros(1, np.int64), np.empty(0, np.int64)
        return cls(
            Clusters(none, none, ids, np.empty(0)),
            ids,
            np.empty((0, 2), np.int64),
            np.empty((0, 4)),
            np.empty((0, 4, 4)),
            np.empty((0, 6)),
            np.empty(0, np.bool_),
        )


class Interval(NamedTuple):
    """What happened since the scan before."""

    dt_s: float
    Q: Any
    """(4, 4) process noise (see `motion`)."""
    chances: Chances
    scan: int
    """The number of this scan."""
    born: BirthComponents
    """Who may have been born by it."""


class DetectionSummary(NamedTuple):
    """What the tracks make of a scan's detections: for births, and to check a sensor's word."""

    explained: Any
    """(m,) probability that some track made each detection; 1 for one that is unusable."""
    detected: float
    """How many of the objects that were there beyond doubt, and surely in view, made a detection."""
    in_view: float
    """How many those were."""


class UpdateResult(NamedTuple):
    """A scan that was taken in."""

    believed: Posterior
    account: DetectionSummary
    """Where detections are weighed."""
    unusable: int
    """How many detections were."""
    parent: Any
    """(n,) which track each was before the scan, or which of those born behind them."""
    made: Any
    """(n,) which row of `place_m` it made, or DIED or MISSED."""
    logw: Any
    """(n,) log-weight of that."""
    place_m: Any
    """(m, 2) the usable detections."""


@leaf
def _weigh(
    sure: Any, track_label: Any, inside: Any, in_view: Any, made: SingletonUpdate, rows: Any, explained: Any
) -> Any:
    """Fill `explained`; return how many of the `sure` labels were in view, and how many of these detected."""
    in_view[:] = 1.0
    for t in range(track_label.size):
        # Whichever of its tracks is right.
        in_view[track_label[t]] = min(in_view[track_label[t]], inside[t])
    seen = detected = 0.0
    for label in range(sure.size):
        if sure[label] and in_view[label] > _SURELY_IN_VIEW:
            seen += 1.0
            detected += made.detected[label]
    explained[:] = 1.0
    for i in range(rows.size):
        explained[rows[i]] = min(made.explained[i], 1.0)
    return detected, seen


@leaf
def _gather(after: Carried, options: Options, labels: Any, there: Any, out: Any) -> None:
    """Fill which row each track made with which weight; which labels go on, and which of them surely."""
    made, logw, labels_out, sure = out
    for i in range(after.option.size):
        made[i], logw[i] = options.meas[after.option[i]], options.logw[after.option[i]]
    for i in range(after.kept.size):
        label = after.kept[i]
        labels_out[i, 0], labels_out[i, 1] = labels[label, 0], labels[label, 1]
    for i in range(sure.size):
        sure[i] = there[after.kept[i]] > _SURELY_THERE


@kernel
def take_in(
    before: Posterior,
    passed: Interval,
    seen: Measurements,
    optics: measurement.SensorModel,
    limits: Limits,
    turns: Turns,
    weigh: bool,
    rng: Any,
) -> UpdateResult:
    """Take in a scan; `rng` (1,) uint64 advances."""
    mean, cov, turn, dt_s, Q = before.mean, before.cov, before.turn, passed.dt_s, passed.Q
    turn_too = turns.rate_std_rad_s > 0.0
    if turn_too:
        if dt_s > 0.0:
            mean, cov, turn = coordinated_turn.predict(
                mean, cov, turn, Q, dt_s, turns.rate_std_rad_s, turns.time_s
            )
        turn = coordinated_turn.with_newborn(turn, passed.born.log_live.size, turns.rate_std_rad_s)
        dt_s, Q = 0.0, np.zeros((4, 4))
    now = foresee(
        before.groups, before.track_label, before.labels, mean, cov, dt_s, Q, passed.chances, passed.scan,
        passed.born,
    )  # fmt: skip
    look, view = look_at(seen), measurement.seen(optics, now.mean, now.cov)
    start, meas, logw = options(
        now.cov, now.log_live, now.log_die, look.z, view, look.log_clutter, limits.gate_chi2
    )
    open_, n_labels = Options(start, meas, logw), now.labels.shape[0]
    asked = (look.rows.size, n_labels, seen.z.shape[0]) if weigh else (0, 0, 0)
    made = SingletonUpdate(np.zeros(asked[0]), np.zeros(asked[1]), np.zeros(asked[1]))
    after = associate(
        now.groups, open_, now.track_label, n_labels, now.mean, now.cov, look.z, view, limits, rng, made
    )
    explained, detected, in_view = np.empty(asked[2]), 0.0, 0.0
    if weigh:
        detected, in_view = _weigh(
            before.sure, now.track_label, view.inside, np.empty(n_labels), made, look.rows, explained
        )
    n, kept = after.parent.size, after.kept.size
    told = np.empty(n, np.int64), np.empty(n), np.empty((kept, 2), np.int64), np.empty(kept * weigh, np.bool_)
    _gather(after, open_, now.labels, made.there, told)
    if turn_too:
        turn = coordinated_turn.update(now.cov, turn, after.parent, told[0], look.z, view)
    return UpdateResult(
        Posterior(after.groups, after.label, told[2], after.mean[:n], after.cov[:n], turn, told[3]),
        DetectionSummary(explained, detected, in_view),
        seen.z.shape[0] - look.rows.size,
        after.parent,
        told[0],
        told[1],
        look.place_m,
    )


def warm_up_calls() -> list[Call]:
    """One call of every kernel that is called for a scan, types as in a tracker."""
    born, nowhere = BirthComponents.of(()), np.zeros((1, 2))
    passed = Interval(1.0, np.eye(4), Chances(0.0, 0.0, 0.0, 0.0, 1.0), 0, born)
    seen = Measurements(nowhere, nowhere, np.zeros(1))
    optics = measurement.SensorModel(
        False, np.eye(2).reshape(1, 2, 2), np.zeros((2, 2)), np.zeros(2), 0.0, 0.9
    )
    rng, limits = np.zeros(1, np.uint64), GlmbParams(1.0).limits()
    return [(take_in, Posterior.nothing(), passed, seen, optics, limits, Turns(0.0, 1.0), False, rng)]


def warm_up_parts() -> list[Call]:
    """One call of every kernel that is a part of `take_in`, types as there.

    The longest to compile stand at the ends, beside those that share leaves with them: where two processes
    meet, both compile the same one, so that had better be short.
    """
    ones, zeros, z, limits = np.ones(1), np.zeros(1, np.int64), np.zeros((1, 2)), GlmbParams(1.0).limits()
    mean, cov, matrix = np.zeros((1, 4)), np.eye(4).reshape(1, 4, 4), np.eye(2).reshape(1, 2, 2)
    view = measurement.LinearisedMeasurement(z, matrix, matrix, ones, 0.9, wraps=False)
    groups, open_, made = (
        Clusters.example(),
        Options(np.arange(2), zeros, ones),
        SingletonUpdate(ones, ones, ones),
    )
    return [
        (children, groups, open_, 1, limits, np.zeros(1, np.uint64)),
        (meet, groups, open_, zeros, 1, limits),
        (renumber, groups, 1),
        (probabilities, groups, 1),
        (alone, groups, zeros, open_, mean, cov, zeros, z, view, limits, 0.1, 1, made),
        (merge_alike, groups, mean, cov, zeros, 0.1),
        (part, groups, zeros, 1, limits),
    ]
