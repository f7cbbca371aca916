"""The GLMB recursion with a user's models: predict, list association options, associate and update.

The recursion is that of `glmb.recursion`, and association, clusters and merging are its compiled kernels. Two
things differ. States and measurements have any dimension, with Kalman steps on stacks of matrices. An object
may switch between motion models: the mode of the last interval is part of the association history, so an
option of a track is a detection (or a miss) and a mode m,

    eta(j, m) = p_S P(m) p_D N(z_j; z_hat_m, S_m) / kappa(z_j)

P(m) is the probability of the mode by the Markov chain from the track's mode probabilities. A track keeps a
Gaussian and these probabilities, and similar tracks merge. So the density is a mixture over mode histories,
as in a generalised pseudo-Bayesian filter (Bar-Shalom, Li & Kirubarajan 2001, section 11.6; for the GLMB
filter of jump Markov systems: Punchihewa, Vo, Vo & Kim, IEEE Trans. Signal Processing 66, 2018).

===============  =============  =======  ======================================================
_Rows            shape          dtype    meaning (R rows: a predicted track in one mode)
===============  =============  =======  ======================================================
track            (R,)           int64    track, ascending; births are behind the tracks
mode             (R,)           int64    mode since the last scan
log_prior        (R,)           float64  log P(mode)
mean, cov        (R, d (d))     float64  predicted Gaussian
modes            (R, modes)     float64  mode probabilities after the scan, if it is this row
===============  =============  =======  ======================================================
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.model import BoolArray, FloatArray, IntArray, KeyArray
from gcs.tracking.clusters.cluster_product import merge_clusters
from gcs.tracking.clusters.factorisation import renumber, split_clusters
from gcs.tracking.glmb.gating import MAX_GATED_DETECTIONS, MIN_P_IN_FOV
from gcs.tracking.glmb.hypotheses import ABSENT, MISSED, AssociationOptions, Clusters
from gcs.tracking.glmb.joint_association import update_clusters
from gcs.tracking.glmb.params import BirthComponents, Limits
from gcs.tracking.glmb.recursion import Posterior
from gcs.tracking.models.survival import Survival
from gcs.tracking.state_space.linearisation import Linearised, linearise, wrap
from gcs.tracking.state_space.merging import find_similar_tracks
from gcs.tracking.state_space.models import SwitchingMotion
from gcs.tracking.state_space.sensors import Measured, ScanModel

_BLOCK = 1_000_000
"""Pairs of a row and a detection that are gated at once: bounds memory."""


class Births(NamedTuple):
    """Births of a scan, and its number."""

    components: BirthComponents
    scan: int


class StepResult(NamedTuple):
    """Result of a scan; n tracks."""

    posterior: Posterior
    """Its `turn` are the mode probabilities (n, modes)."""
    parent: IntArray
    """(n,) track before the scan; births are numbered behind these."""
    meas: IntArray
    """(n,) detection, or MISSED."""
    mode: IntArray
    """(n,) mode since the last scan."""
    logw: FloatArray
    """(n,) log eta."""
    explained: FloatArray
    """(m,) probability that a track made each detection."""


class _Rows(NamedTuple):
    """Predicted tracks in each mode (see the table above)."""

    track: IntArray
    mode: IntArray
    log_prior: FloatArray
    mean: FloatArray
    cov: FloatArray
    modes: FloatArray


class _Options(NamedTuple):
    """Association options with the row of each, -1 for absent."""

    options: AssociationOptions
    row: IntArray


def predict_states(
    motion: SwitchingMotion, mode: int, mean: FloatArray, cov: FloatArray, dt_s: float
) -> Linearised:
    """Return the prediction by one mode: means (n, d), A (n, d, d), and the covariances (n, d, d)."""
    model = motion.models[mode]
    jacobian = model.jacobian
    moved = linearise(
        lambda x: model.transition(x, dt_s),
        None if jacobian is None else lambda x: jacobian(x, dt_s),
        mean,
        cov,
    )
    Q = np.asarray(model.process_noise(dt_s), np.float64)
    d = mean.shape[1]
    if Q.shape != (d, d):
        raise ValueError(f"process_noise: expected to return the shape {(d, d)}, got {Q.shape}")
    return moved._replace(rest=moved.A @ cov @ moved.A.swapaxes(1, 2) + moved.rest + Q)


def update_states(
    mean: FloatArray, cov: FloatArray, measured: Linearised, innovation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return means (n, d) and covariances (n, d, d) updated by innovations (n, k), in Joseph form.

    `measured.rest` is the noise (n, k, k).
    """
    A = measured.A
    PA = cov @ A.swapaxes(1, 2)
    K = np.linalg.solve(A @ PA + measured.rest, PA.swapaxes(1, 2)).swapaxes(1, 2)
    left = np.eye(mean.shape[1]) - K @ A
    updated = left @ cov @ left.swapaxes(1, 2) + K @ measured.rest @ K.swapaxes(1, 2)
    return mean + (K @ innovation[:, :, None])[:, :, 0], 0.5 * (updated + updated.swapaxes(1, 2))


def update_step(
    prior: Posterior,
    motion: SwitchingMotion,
    dt_s: float,
    survival: Survival,
    births: Births,
    scan: ScanModel,
    limits: Limits,
    rng: KeyArray,
) -> StepResult:
    """Predict and update the posterior with one scan; `rng` (1,) uint64 advances."""
    born = births.components
    rows = _predict(prior, motion, dt_s, born)
    n = prior.track_label.size
    n_born = born.log_survival.size
    n_labels = prior.labels.shape[0]
    track_label = np.concatenate([prior.track_label, n_labels + np.arange(n_born)])
    labels = np.concatenate(
        [prior.labels, np.column_stack([np.full(n_born, births.scan), np.arange(n_born)])]
    ).astype(np.int64)
    lost = np.full(n + n_born, np.inf)
    position = rows.cov[:, motion.position, motion.position].max(axis=1, initial=0.0)
    np.minimum.at(lost, rows.track, position)
    is_lost = lost[:n] > survival.max_variance_m2
    log_survival = np.concatenate(
        [np.where(is_lost, survival.log_survival_lost, survival.log_survival), born.log_survival]
    )
    log_death = np.concatenate(
        [np.where(is_lost, survival.log_death_lost, survival.log_death), born.log_death]
    )
    measured = scan.expect(rows.mean, rows.cov)
    listed = _list_options(rows, measured, scan, log_survival, log_death, limits.gate_chi2)
    m = scan.z.shape[0]
    options = listed.options
    clusters = _append_births(prior.clusters, n, n_born)
    singletons, joint = merge_clusters(clusters, options, track_label, m, limits)
    joint, option = renumber(
        update_clusters(_concatenate(joint, clusters, singletons), options, m, limits, rng),
        options.meas.size,
    )
    row = listed.row[option]
    meas = options.meas[option]
    parent = rows.track[row]
    label = track_label[parent]
    mean, cov = _update(rows, measured.model, scan, row, meas)
    modes = rows.modes[row]
    joint, probability, representative = find_similar_tracks(joint, mean, cov, label, limits.merge_chi2)
    explained = np.bincount(meas[meas >= 0], probability[meas >= 0], minlength=m)
    mean, cov, modes = _match_moments(mean, cov, modes, probability, representative)
    joint, kept = renumber(split_clusters(joint, label, n_labels + n_born, limits), option.size)
    kept_labels, new_label = np.unique(label[kept], return_inverse=True)
    posterior = Posterior(
        joint,
        new_label.astype(np.int64).reshape(-1),
        np.ascontiguousarray(labels[kept_labels]),
        np.ascontiguousarray(mean[kept]),
        np.ascontiguousarray(cov[kept]),
        np.ascontiguousarray(modes[kept]),
        prior.is_certain,
    )
    logw = options.logw[option[kept]]
    return StepResult(
        posterior, parent[kept], meas[kept], rows.mode[row[kept]], logw, np.minimum(explained, 1.0)
    )


def _predict(prior: Posterior, motion: SwitchingMotion, dt_s: float, born: BirthComponents) -> _Rows:
    """Return the rows of all tracks in each mode, and of the births behind them."""
    n = prior.track_label.size
    n_modes = len(motion.models)
    before = prior.turn.reshape(n, n_modes)
    if dt_s > 0.0 and n > 0:
        moved = [predict_states(motion, mode, prior.mean, prior.cov, dt_s) for mode in range(n_modes)]
        track = np.repeat(np.arange(n), n_modes)
        mode = np.tile(np.arange(n_modes), n)
        weight = (before @ motion.mode_transition(dt_s)).reshape(-1)
        mean = np.stack([one.value for one in moved], axis=1).reshape(n * n_modes, -1)
        cov = np.stack([one.rest for one in moved], axis=1).reshape(n * n_modes, *prior.cov.shape[1:])
        modes = np.tile(np.eye(n_modes), (n, 1))
        with np.errstate(divide="ignore"):
            log_prior = np.log(weight)
        possible = weight > 0.0
        rows = _select(_Rows(track, mode, log_prior, mean, cov, modes), possible)
    else:
        zeros = np.zeros(n, np.int64)
        rows = _Rows(np.arange(n), zeros, np.zeros(n), prior.mean, prior.cov, before)
    n_born = born.log_survival.size
    at_birth = _Rows(
        n + np.arange(n_born),
        np.zeros(n_born, np.int64),
        np.zeros(n_born),
        born.mean,
        born.cov,
        np.tile(motion.stationary_modes(), (n_born, 1)),
    )
    return _Rows._make(np.concatenate(pair) for pair in zip(rows, at_birth, strict=True))


def _select(rows: _Rows, chosen: BoolArray) -> _Rows:
    return _Rows._make(part[chosen] for part in rows)


def _list_options(
    rows: _Rows,
    measured: Measured,
    scan: ScanModel,
    log_survival: FloatArray,
    log_death: FloatArray,
    gate_chi2: float,
) -> _Options:
    """List the association options of each track, the best first (see `glmb.gating`)."""
    alive = log_survival[rows.track] + rows.log_prior
    visible = (measured.p_in_view > MIN_P_IN_FOV) & (scan.p_d > 0.0)
    row, meas, logw = _gate(measured, scan, gate_chi2, visible)
    logw += alive[row]
    n = log_survival.size
    dying = np.flatnonzero(log_death > -np.inf)
    every = np.arange(rows.track.size)
    track = np.concatenate([rows.track[row], rows.track, dying])
    logw = np.concatenate(
        [logw, alive + np.log1p(-scan.p_d * measured.p_in_view * visible), log_death[dying]]
    )
    meas = np.concatenate([meas, np.full(every.size, MISSED), np.full(dying.size, ABSENT)])
    row = np.concatenate([row, every, np.full(dying.size, -1)])
    order = np.lexsort((-logw, track))
    start = np.concatenate([[0], np.cumsum(np.bincount(track, minlength=n))])
    return _Options(AssociationOptions(start, meas[order], logw[order]), row[order])


def _gate(
    measured: Measured, scan: ScanModel, gate_chi2: float, visible: BoolArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return row, detection and log-weight, without survival, of the detections in the gate of each row."""
    m, k = scan.z.shape
    model, S, _ = measured
    row = np.empty(0, np.int64)
    meas = np.empty(0, np.int64)
    logw = np.empty(0)
    if m == 0 or not visible.any():
        return row, meas, logw
    log_scale = math.log(scan.p_d) - 0.5 * (k * math.log(2.0 * math.pi) + np.linalg.slogdet(S)[1])
    inverse = np.linalg.inv(S)
    step = max(1, _BLOCK // m)
    for low in range(0, len(S), step):
        nu = wrap(scan.z - model.value[low : low + step, None], scan.angles)
        d2 = ((nu @ inverse[low : low + step]) * nu).sum(axis=2)
        r, j = np.nonzero((d2 <= gate_chi2) & visible[low : low + step, None])
        row = np.concatenate([row, r + low])
        meas = np.concatenate([meas, j])
        logw = np.concatenate([logw, log_scale[r + low] - 0.5 * d2[r, j] - scan.log_clutter[j]])
    count = np.bincount(row, minlength=len(S))
    if count.max(initial=0) > MAX_GATED_DETECTIONS:
        order = np.lexsort((-logw, row))
        rank = np.arange(row.size) - (np.cumsum(count) - count)[row[order]]
        order = order[rank < MAX_GATED_DETECTIONS]
        return row[order], meas[order], logw[order]
    return row, meas, logw


def _update(
    rows: _Rows, model: Linearised, scan: ScanModel, row: IntArray, meas: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the Gaussians of rows updated with detections, or MISSED."""
    mean = rows.mean[row]
    cov = rows.cov[row]
    detected = np.flatnonzero(meas >= 0)
    if detected.size:
        at = row[detected]
        innovation = wrap(scan.z[meas[detected]] - model.value[at], scan.angles)
        measured = Linearised(model.value[at], model.A[at], model.rest[at])
        mean[detected], cov[detected] = update_states(mean[detected], cov[detected], measured, innovation)
    return mean, cov


def _match_moments(
    mean: FloatArray,
    cov: FloatArray,
    modes: FloatArray,
    probability: FloatArray,
    representative: IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return means, covariances and mode probabilities with those of mixtures at the representatives."""
    merged = np.flatnonzero(np.bincount(representative, minlength=len(mean)) > 1)
    if merged.size == 0:
        return mean, cov, modes
    members = np.flatnonzero(np.isin(representative, merged))
    to = representative[members]
    weight = np.zeros(len(mean))
    np.add.at(weight, to, probability[members])
    share = probability[members] / weight[to]
    centre = np.zeros_like(mean)
    np.add.at(centre, to, share[:, None] * mean[members])
    off = mean[members] - centre[to]
    spread = np.zeros_like(cov)
    np.add.at(spread, to, share[:, None, None] * (cov[members] + off[:, :, None] * off[:, None, :]))
    mixed = np.zeros_like(modes)
    np.add.at(mixed, to, share[:, None] * modes[members])
    result = mean.copy(), cov.copy(), modes.copy()
    for values, new in zip(result, (centre, spread, mixed), strict=True):
        values[merged] = new[merged]
    return result


def _append_births(clusters: Clusters, n: int, n_born: int) -> Clusters:
    """Append a cluster with one hypothesis and one track for each birth; n tracks are before."""
    more = np.arange(1, n_born + 1)
    return Clusters(
        np.concatenate([clusters.first, clusters.first[-1] + more]),
        np.concatenate([clusters.start, clusters.start[-1] + more]),
        np.concatenate([clusters.items, n + more - 1]),
        np.concatenate([clusters.logw, np.zeros(n_born)]),
    )


def _concatenate(joint: Clusters, clusters: Clusters, chosen: IntArray) -> Clusters:
    """Return the clusters `joint`, and behind them those of `clusters` with the numbers `chosen`."""
    hyps = _ranges(clusters.first[chosen], clusters.first[chosen + 1])
    items = _ranges(clusters.start[hyps], clusters.start[hyps + 1])
    n_hyps = np.cumsum(clusters.first[chosen + 1] - clusters.first[chosen])
    sizes = np.cumsum(clusters.start[hyps + 1] - clusters.start[hyps])
    return Clusters(
        np.concatenate([joint.first, joint.first[-1] + n_hyps]),
        np.concatenate([joint.start, joint.start[-1] + sizes]),
        np.concatenate([joint.items, clusters.items[items]]),
        np.concatenate([joint.logw, clusters.logw[hyps]]),
    )


def _ranges(low: IntArray, high: IntArray) -> IntArray:
    """Return the numbers from each `low` to each `high` - 1, one range behind the other."""
    count = high - low
    shift = np.repeat(low - (np.cumsum(count) - count), count)
    return np.asarray(shift + np.arange(count.sum()), np.int64)
