"""Compiled single-object numerics over flat arrays: predict, gate, update, sum up.

Everything here works per *track* (one label with one association history, one Gaussian), never per
hypothesis: hypotheses share tracks, so each prediction, gate and likelihood is computed once (Vo, Vo & Hoang
2017, section IV).

What a track may do at a scan is its list of *options*: to have died, to live undetected, or to live and have
made one of the detections in its gate. An option's log-weight is that of eq. (20) there, relative to clutter:

    died       log(1 - p_S)
    missed     log p_S + log(1 - p_D P(in the field of view))
    made z     log p_S + log p_D + log N(z; z_hat, A P A' + noise) - log kappa

with p_S replaced by the birth probability for a track that is being born. Options lie track after track in
flat arrays, the best one first.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gcs.compiling import inlined, kernel
from gcs.tracking.hypotheses import Groups
from gcs.tracking.ordering import head
from gcs.tracking.sensors import View, wrapped

if TYPE_CHECKING:
    from gcs.model import FloatArray

DIED = -2
MISSED = -1
_TAIL = 1e-15
LEAST_INSIDE = 1e-6
"""A track that is in the field of view with less than this probability is outside."""
MAX_GATED = 32
"""Detections kept per gate, the likeliest ones: bounds the work that a hostile scan can cause."""


@kernel
def predict(mean: FloatArray, cov: FloatArray, F: FloatArray, Q: FloatArray) -> Any:
    """Kalman prediction of every track: means (n, 4) and covariances (n, 4, 4)."""
    n = mean.shape[0]
    mean_out, cov_out = np.empty((n, 4)), np.empty((n, 4, 4))
    FP = np.empty((4, 4))
    for t in range(n):
        for i in range(4):
            moved = 0.0
            for j in range(4):
                moved += F[i, j] * mean[t, j]
                total = 0.0
                for k in range(4):
                    total += F[i, k] * cov[t, k, j]
                FP[i, j] = total
            mean_out[t, i] = moved
        for i in range(4):
            for j in range(i + 1):
                total = Q[i, j]
                for k in range(4):
                    total += FP[i, k] * F[j, k]
                cov_out[t, i, j] = cov_out[t, j, i] = total
    return mean_out, cov_out


@inlined
def _sort_options(meas: Any, logw: Any, start: int, end: int) -> None:
    """Best option first, stable: insertion, as the lists are short."""
    for i in range(start + 1, end):
        m, w, j = meas[i], logw[i], i
        while j > start and logw[j - 1] < w:
            meas[j], logw[j] = meas[j - 1], logw[j - 1]
            j -= 1
        meas[j], logw[j] = m, w


def strips(z: FloatArray) -> Any:
    """Order of the detections (m, 2) in which `options` finds those in a gate, as indices (m,).

    They are cut into strips of isqrt(m) by the first coordinate; each is in the order of the second.
    """
    order = np.argsort(z[:, 0])
    width = max(1, math.isqrt(order.size))
    count = -(-order.size // width)
    second = np.full(count * width, np.inf)
    second[: order.size] = z[order, 1]
    inside = np.argsort(second.reshape(count, width), axis=1) + width * np.arange(count)[:, None]
    return order[inside.ravel()[: order.size]]


@inlined
def _first_beyond(value: Any, low: int, high: int, least: float) -> int:
    """Index of the first of the ascending values `low` to `high` - 1 that is not below `least`: bisection."""
    while low < high:
        mid = (low + high) // 2
        if value[mid] < least:
            low = mid + 1
        else:
            high = mid
    return low


@inlined
def _nth_best(logw: Any, start: int, end: int, best: Any) -> Any:
    """The n-th greatest of more than n weights; `best` (n,) is scratch."""
    n = best.size
    for i in range(start, end):
        j = min(i - start, n - 1)
        if i - start >= n and logw[i] <= best[j]:
            continue
        while j > 0 and best[j - 1] < logw[i]:
            best[j] = best[j - 1]
            j -= 1
        best[j] = logw[i]
    return best[n - 1]


@inlined
def _innovation(cov: FloatArray, t: int, view: View, u: int) -> Any:
    """A P A' + noise of track t, seen by `view` at u: its three different elements."""
    p, q, r, s = view.A[u, 0, 0], view.A[u, 0, 1], view.A[u, 1, 0], view.A[u, 1, 1]
    x, xy, y = cov[t, 0, 0], cov[t, 0, 1], cov[t, 1, 1]
    return (
        p * p * x + 2.0 * p * q * xy + q * q * y + view.noise[u, 0, 0],
        p * r * x + (p * s + q * r) * xy + q * s * y + view.noise[u, 0, 1],
        r * r * x + 2.0 * r * s * xy + s * s * y + view.noise[u, 1, 1],
    )


@kernel
def options(
    cov: FloatArray,
    log_live: FloatArray,
    log_die: FloatArray,
    z: FloatArray,
    view: View,
    log_clutter: FloatArray,
    gate_chi2: float,
) -> Any:
    """What each predicted track may do: (start (n + 1,), detection or DIED or MISSED, log-weight).

    `z` (m, 2) is what the sensor measured, in the order of `strips`, so that a gate is a few runs of it;
    `log_clutter` (m,) is the log of the clutter intensity at each, in the same units. A track that is
    surely outside the field of view cannot be detected; one that may be outside is the less missed.
    """
    n, m = cov.shape[0], z.shape[0]
    start = np.zeros(n + 1, np.int64)
    room = n * (min(m, MAX_GATED) + 2) + m
    meas, logw = np.empty(room, np.int64), np.empty(room)
    best = np.empty(MAX_GATED)
    width = max(1, int(math.sqrt(m)))
    n_strips = (m + width - 1) // width
    edge, second = np.empty(n_strips), np.empty(m)
    for s in range(n_strips):
        edge[s] = np.inf
        for j in range(s * width, min((s + 1) * width, m)):
            edge[s], second[j] = min(edge[s], z[j, 0]), z[j, 1]
    step = 0 if view.A.shape[0] == 1 else 1
    for t in range(n):
        first = count = start[t]
        x, y, p_d = view.z_hat[t, 0], view.z_hat[t, 1], view.p_d
        seen = p_d > 0.0 and view.inside[t] > LEAST_INSIDE
        if seen:
            a, b, c = _innovation(cov, t, view, t * step)
            det = a * c - b * b
            scale = math.log(p_d) - math.log(2.0 * math.pi) - 0.5 * math.log(det) + log_live[t]
            reach, reach_1 = math.sqrt(gate_chi2 * a), math.sqrt(gate_chi2 * c)
            for s in range(max(0, _first_beyond(edge, 0, n_strips, x - reach) - 1), n_strips):
                if edge[s] > x + reach:
                    break
                low, high = s * width, min((s + 1) * width, m)
                for j in range(low if view.wraps else _first_beyond(second, low, high, y - reach_1), high):
                    dx, dy = z[j, 0] - x, z[j, 1] - y
                    if view.wraps:
                        dy = wrapped(dy)
                    elif dy > reach_1:
                        break
                    d2 = (c * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / det
                    if d2 <= gate_chi2:
                        meas[count], logw[count] = j, scale - 0.5 * d2 - log_clutter[j]
                        count += 1
            if count - first > MAX_GATED:
                least = _nth_best(logw, first, count, best)
                end, count = count, first
                for i in range(first, end):
                    if logw[i] >= least and count < first + MAX_GATED:
                        meas[count], logw[count] = meas[i], logw[i]
                        count += 1
        meas[count] = MISSED
        logw[count] = log_live[t] + (math.log1p(-p_d * view.inside[t]) if seen else 0.0)
        count += 1
        if log_die[t] > -np.inf:
            meas[count], logw[count] = DIED, log_die[t]
            count += 1
        _sort_options(meas, logw, first, count)
        start[t + 1] = count
    return start, head(meas, start[n]), head(logw, start[n])


class Scratch(NamedTuple):
    """Room for the matrices of an update."""

    A: Any
    AP: Any
    K: Any


@inlined
def scratch() -> Scratch:
    """Return such room."""
    return Scratch(np.empty((4, 4)), np.empty((4, 4)), np.empty((4, 2)))


@inlined
def updated(
    mean: FloatArray,
    cov: FloatArray,
    p: int,
    j: int,
    z: FloatArray,
    view: View,
    mean_out: FloatArray,
    cov_out: FloatArray,
    i: int,
    work: Scratch,
) -> None:
    """Put at i the Kalman update of track p with detection j (or MISSED), in Joseph form.

    With H = [A, 0]: P' = (I - K H) P (I - K H)' + K noise K' stays positive definite whatever the ratio of P
    to the noise.
    """
    A, AP, K = work.A, work.AP, work.K
    if j < 0:
        for r in range(4):
            mean_out[i, r] = mean[p, r]
            for s in range(4):
                cov_out[i, r, s] = cov[p, r, s]
    else:
        u = 0 if view.A.shape[0] == 1 else p
        H, R = view.A[u], view.noise[u]
        a, b, c = _innovation(cov, p, view, u)
        det = a * c - b * b
        dx, dy = z[j, 0] - view.z_hat[p, 0], z[j, 1] - view.z_hat[p, 1]
        if view.wraps:
            dy = wrapped(dy)
        for r in range(4):
            e = cov[p, r, 0] * H[0, 0] + cov[p, r, 1] * H[0, 1]
            n_ = cov[p, r, 0] * H[1, 0] + cov[p, r, 1] * H[1, 1]
            K[r, 0], K[r, 1] = (e * c - n_ * b) / det, (n_ * a - e * b) / det
            mean_out[i, r] = mean[p, r] + K[r, 0] * dx + K[r, 1] * dy
            for s in range(4):
                A[r, s] = 1.0 if r == s else 0.0
            for s in range(2):
                A[r, s] -= K[r, 0] * H[0, s] + K[r, 1] * H[1, s]
        for r in range(4):
            for s in range(4):
                total = 0.0
                for k in range(4):
                    total += A[r, k] * cov[p, k, s]
                AP[r, s] = total
        for r in range(4):
            for s in range(r + 1):
                total = 0.0
                for k in range(4):
                    total += AP[r, k] * A[s, k]
                for k in range(2):
                    for q in range(2):
                        total += K[r, k] * R[k, q] * K[s, q]
                cov_out[i, r, s] = cov_out[i, s, r] = total


@kernel
def update(
    mean: FloatArray, cov: FloatArray, parent: Any, meas: Any, z: FloatArray, view: View
) -> tuple[FloatArray, FloatArray]:
    """Kalman update of each track `parent[i]` with detection `meas[i]` (or MISSED)."""
    n = parent.size
    mean_out, cov_out, work = np.empty((n, 4)), np.empty((n, 4, 4)), scratch()
    for i in range(n):
        updated(mean, cov, parent[i], meas[i], z, view, mean_out, cov_out, i, work)
    return mean_out, cov_out


@inlined
def _reference(groups: Groups, g: int, track_label: Any, existence: FloatArray) -> Any:
    """Return the hypothesis of group g that shows its likely labels (existence above 1/2).

    The most probable one of those that hold the most of them. Each label's own best hypothesis would not do:
    when it is open which of two labels is where, both would be shown at one place.
    """
    first, start, items = groups.first, groups.start, groups.items
    chosen, most = first[g], -1
    for h in range(first[g], first[g + 1]):
        likely = 0
        for i in range(start[h], start[h + 1]):
            if existence[track_label[items[i]]] > 0.5:
                likely += 1
        if likely > most:
            chosen, most = h, likely
    return chosen


@kernel
def summary(groups: Groups, track_label: Any, n_labels: int) -> tuple[FloatArray, Any, FloatArray]:
    """Existence of each label, the track that shows it, and the distribution of the number of objects.

    Shapes (n_labels,), (n_labels,), (n_labels + 1,). A label's track is that of its group's reference
    hypothesis, or of the best that holds the label. Groups are independent, so their numbers' distributions
    convolve.
    """
    first, start, items = groups.first, groups.start, groups.items
    existence, shown = np.zeros(n_labels), np.empty(n_labels, np.int64)
    cardinality, convolved = np.zeros(n_labels + 1), np.zeros(n_labels + 1)
    shown[:] = -1
    # `least` to `most` objects are all that is probable so far; the tails left out are below 1e-12.
    cardinality[0], least, most = 1.0, 0, 0
    size_weight = np.zeros(n_labels + 1)
    for g in range(first.size - 1):
        low, high, widest = first[g], first[g + 1], 0
        for h in range(low, high):
            w, size = math.exp(groups.logw[h]), start[h + 1] - start[h]
            widest = max(widest, size)
            size_weight[size] += w
            for i in range(start[h], start[h + 1]):
                existence[track_label[items[i]]] += w
        for k in range(least, most + widest + 1):
            convolved[k] = 0.0
        for size in range(widest + 1):
            w, size_weight[size] = size_weight[size], 0.0
            if w > 0.0:
                for k in range(least, most + 1):
                    convolved[k + size] += w * cardinality[k]
        most += widest
        while least < most and convolved[least] < _TAIL:
            convolved[least] = 0.0
            least += 1
        while most > least and convolved[most] < _TAIL:
            convolved[most] = 0.0
            most -= 1
        cardinality, convolved = convolved, cardinality
        reference = _reference(groups, g, track_label, existence)
        for i in range(start[reference], start[reference + 1]):
            shown[track_label[items[i]]] = items[i]
        for i in range(start[low], start[high]):
            if shown[track_label[items[i]]] < 0:
                shown[track_label[items[i]]] = items[i]
    for i in range(n_labels):
        existence[i] = min(existence[i], 1.0)
    for k in range(n_labels + 1):
        if not least <= k <= most:
            cardinality[k] = 0.0
    return existence, shown, cardinality


@kernel
def probabilities(groups: Groups, n_tracks: int) -> Any:
    """Probability of each track: that of the hypotheses that hold it."""
    probability = np.zeros(n_tracks)
    for h in range(groups.logw.size):
        w = math.exp(groups.logw[h])
        for i in range(groups.start[h], groups.start[h + 1]):
            probability[groups.items[i]] += w
    return probability


@kernel
def map_tracks(groups: Groups) -> Any:
    """Tracks of the best hypothesis of each group's most probable number of objects."""
    first, start = groups.first, groups.start
    chosen = np.empty(groups.items.size, np.int64)
    n = 0
    for g in range(first.size - 1):
        widest = 0
        for h in range(first[g], first[g + 1]):
            widest = max(widest, start[h + 1] - start[h])
        weight, size = np.zeros(widest + 1), 0
        for h in range(first[g], first[g + 1]):
            weight[start[h + 1] - start[h]] += math.exp(groups.logw[h])
        for k in range(1, widest + 1):
            if weight[k] > weight[size]:
                size = k
        for h in range(first[g], first[g + 1]):
            if start[h + 1] - start[h] == size:
                for i in range(start[h], start[h + 1]):
                    chosen[n] = groups.items[i]
                    n += 1
                break
    return head(chosen, n)
