"""Gating: which detections each predicted track may have made, its association options.

An option has a log-weight (log eta, eq. (20) of Vo, Vo & Hoang 2017, relative to clutter):

    absent     log(1 - p_S)
    missed     log p_S + log(1 - p_D P(in the field of view))
    detected   log p_S + log p_D + log N(z; z_hat, A P A' + R) - log kappa(z)

A birth has its birth probability r_B in place of p_S. Options of a track are adjacent, the best one first.

Detections are sorted into strips, so that those in a gate are a few runs. A guide table of evenly spaced
values, then bisection, finds where a run begins. The cost is that of a grid where detections are spread
evenly, and is bounded wherever they are.

=============  =====================  =======  ===================================================
_Strips        shape                  dtype    meaning (s strips of `width` detections, m detections)
=============  =====================  =======  ===================================================
edge           (s,)                   float64  least first coordinate of each strip
second         (m,)                   float64  second coordinate of each detection
entry          (8 s + 1,)             int32    guide to `edge`
inner          (s (width + 1),)       int32    guides to `second` in each strip
per_unit       (s + 1,)               float64  guide entries per unit of the second coordinate in each
                                               strip; the last one, of the first coordinate
=============  =====================  =======  ===================================================
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, leaf
from gcs.tracking.glmb.hypotheses import ABSENT, MISSED, AssociationOptions
from gcs.tracking.models.measurement_model import LinearisedMeasurement, wrap_angle
from gcs.tracking.numerics.sorting import SortBuffers, allocate_sort, argsort_descending

if TYPE_CHECKING:
    from gcs.model import FloatArray, Int32Array, IntArray

MIN_P_IN_FOV = 1e-6
"""A track below this probability of being in the field of view cannot be detected."""
MAX_GATED_DETECTIONS = 32
"""Detections kept in a gate, the likeliest ones: bounds the work of a hostile scan."""
_MAX_LINEAR_SEARCH = 8
"""Longest run that is searched one by one."""
_GUIDE_ENTRIES_PER_STRIP = 8
"""With so many entries, most hold no more than one strip."""


@inlined
def _guide_entry(value: float, least: float, per_unit: float, n: int) -> int:
    """Return which of the n entries of a guide a value belongs to; rises with the value."""
    at = (value - least) * per_unit
    return 0 if not at > 0.0 else (n - 1 if at >= n else int(at))


class _StripSort(NamedTuple):
    """Scratch to sort m detections."""

    row: IntArray
    value: FloatArray
    order: SortBuffers


@leaf
def _sort_rows_ascending(
    z: FloatArray, axis: int, rows: IntArray, first: int, end: int, work: _StripSort
) -> None:
    """Sort `rows[first]` to `rows[end - 1]` by a coordinate, the least first."""
    for i in range(first, end):
        work.row[i - first] = rows[i]
        work.value[i - first] = -z[rows[i], axis]
    argsort_descending(work.value, ZERO, end - first, work.order)
    for i in range(first, end):
        rows[i] = work.row[work.order.index[i - first]]


@leaf
def _sort_strips(z: FloatArray, rows: IntArray, work: _StripSort) -> None:
    _sort_rows_ascending(z, ZERO, rows, ZERO, rows.size, work)
    width = max(1, int(math.sqrt(rows.size)))
    for low in range(0, rows.size, width):
        _sort_rows_ascending(z, ZERO + 1, rows, low, min(low + width, rows.size), work)


@inlined
def sort_into_strips(z: FloatArray, rows: IntArray) -> None:
    """Sort `rows` of detections `z` (m, 2) into the order that `association_options` needs.

    Strips of isqrt(m) detections are in the order of the first coordinate, detections of a strip in that of
    the second.
    """
    m = rows.size
    if m > 1:
        _sort_strips(z, rows, _StripSort(np.empty(m, np.int64), np.empty(m), allocate_sort(m)))


@inlined
def _guide(value: FloatArray, low: int, high: int, guide: Int32Array, at: int, n: int) -> float:
    """Fill `guide[at]` to `guide[at + n]` with where each entry of ascending values begins.

    Returns the number of entries per unit of value.
    """
    spread = value[high - 1] - value[low]
    per_unit = n / spread if spread > 0.0 else 0.0
    entry = 0
    for j in range(low, high):
        here = _guide_entry(value[j], value[low], per_unit, n)
        while entry <= here:
            guide[at + entry] = j
            entry += 1
    while entry <= n:
        guide[at + entry] = high
        entry += 1
    return per_unit


@inlined
def _bisect_left(value: FloatArray, low: int, high: int, least: float) -> int:
    """Return the index of the first ascending value from `low` to `high` - 1 not below `least`."""
    while low < high:
        mid = (low + high) // 2
        if value[mid] < least:
            low = mid + 1
        else:
            high = mid
    return low


@inlined
def _sort_options(meas: IntArray, logw: FloatArray, start: int, end: int) -> None:
    """Sort options by weight, the best first, stable (insertion: the lists are short)."""
    for i in range(start + 1, end):
        m = meas[i]
        w = logw[i]
        j = i
        while j > start and logw[j - 1] < w:
            meas[j] = meas[j - 1]
            logw[j] = logw[j - 1]
            j -= 1
        meas[j] = m
        logw[j] = w


@inlined
def _nth_best(logw: FloatArray, start: int, end: int, best: FloatArray) -> float:
    """Return the n-th greatest of more than n weights; `best` (n,) is scratch."""
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
def innovation_cov(
    cov: FloatArray, t: int, meas_model: LinearisedMeasurement, u: int
) -> tuple[float, float, float]:
    """Return the elements 00, 01 and 11 of A P A' + R of track t; u is the row of A and R."""
    p = meas_model.A[u, 0, 0]
    q = meas_model.A[u, 0, 1]
    r = meas_model.A[u, 1, 0]
    s = meas_model.A[u, 1, 1]
    x = cov[t, 0, 0]
    xy = cov[t, 0, 1]
    y = cov[t, 1, 1]
    return (
        p * p * x + 2.0 * p * q * xy + q * q * y + meas_model.noise[u, 0, 0],
        p * r * x + (p * s + q * r) * xy + q * s * y + meas_model.noise[u, 0, 1],
        r * r * x + 2.0 * r * s * xy + s * s * y + meas_model.noise[u, 1, 1],
    )


class _Strips(NamedTuple):
    """Detections in strips, with guides (see the table above)."""

    width: int
    edge: FloatArray
    second: FloatArray
    entry: Int32Array
    inner: Int32Array
    per_unit: FloatArray


@leaf
def _index_strips(z: FloatArray, to: _Strips) -> None:
    """Fill the strips."""
    m = z.shape[0]
    width = to.width
    count = to.edge.size
    for s in range(count):
        low = s * width
        high = min((s + 1) * width, m)
        to.edge[s] = np.inf
        for j in range(low, high):
            to.edge[s] = min(to.edge[s], z[j, 0])
            to.second[j] = z[j, 1]
        to.per_unit[s] = _guide(to.second, low, high, to.inner, s * (width + 1), width)
    if count > 0:
        to.per_unit[count] = _guide(to.edge, 0, count, to.entry, 0, _GUIDE_ENTRIES_PER_STRIP * count)


@inlined
def _first_strip(strip: _Strips, least: float) -> int:
    """Return the first strip that may have a detection with a first coordinate of `least` or more."""
    n = strip.edge.size
    e = _guide_entry(least, strip.edge[0], strip.per_unit[n], _GUIDE_ENTRIES_PER_STRIP * n)
    return max(0, _bisect_left(strip.edge, strip.entry[e], strip.entry[e + 1], least) - 1)


@inlined
def _first_in_strip(strip: _Strips, s: int, least: float) -> int:
    """Return a detection of strip s such that those before it have a second coordinate below `least`."""
    per_unit = strip.per_unit[s]
    e = s * (strip.width + 1) + _guide_entry(least, strip.second[s * strip.width], per_unit, strip.width)
    first = strip.inner[e]
    if strip.inner[e + 1] - first > _MAX_LINEAR_SEARCH:
        first = _bisect_left(strip.second, first, strip.inner[e + 1], least)
    return first


class _Tracks(NamedTuple):
    """Predicted tracks (see `kalman.Prediction`)."""

    cov: FloatArray
    log_survival: FloatArray
    log_death: FloatArray


class _Detections(NamedTuple):
    """Detections of the scan (see `association_options`)."""

    z: FloatArray
    log_clutter: FloatArray
    strip: _Strips


@inlined
def _list_detections(
    t: int, tracks: _Tracks, meas_model: LinearisedMeasurement, gate_chi2: float, detections: _Detections,
    log_detected: float, options: AssociationOptions, count: int,
) -> int:  # fmt: skip
    """Add the options of track t for the detections in its gate behind `count`; return the new count."""
    z = detections.z
    strip = detections.strip
    x = meas_model.z_hat[t, 0]
    y = meas_model.z_hat[t, 1]
    a, b, c = innovation_cov(tracks.cov, t, meas_model, 0 if meas_model.A.shape[0] == 1 else t)
    det = a * c - b * b
    log_scale = log_detected - 0.5 * math.log(det) + tracks.log_survival[t]
    half_width = math.sqrt(gate_chi2 * a)
    half_height = math.sqrt(gate_chi2 * c)
    s = _first_strip(strip, x - half_width)
    while s < strip.edge.size and strip.edge[s] <= x + half_width:
        j = s * strip.width
        if not meas_model.has_bearing:
            j = _first_in_strip(strip, s, y - half_height)
        while j < min((s + 1) * strip.width, z.shape[0]):
            dx = z[j, 0] - x
            dy = z[j, 1] - y
            if meas_model.has_bearing:
                dy = wrap_angle(dy)
            elif dy > half_height:
                break
            d2 = (c * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / det
            if d2 <= gate_chi2:
                options.meas[count] = j
                options.logw[count] = log_scale - 0.5 * d2 - detections.log_clutter[j]
                count += 1
            j += 1
        s += 1
    return count


@inlined
def _keep_likeliest(options: AssociationOptions, first: int, end: int, best: FloatArray) -> int:
    """Keep at most `MAX_GATED_DETECTIONS` of the options from `first` on; return the new end."""
    if end - first <= MAX_GATED_DETECTIONS:
        return end
    least = _nth_best(options.logw, first, end, best)
    count = first
    for i in range(first, end):
        if options.logw[i] >= least and count < first + MAX_GATED_DETECTIONS:
            options.meas[count] = options.meas[i]
            options.logw[count] = options.logw[i]
            count += 1
    return count


@leaf
def _fill_options(
    tracks: _Tracks,
    meas_model: LinearisedMeasurement,
    gate_chi2: float,
    detections: _Detections,
    best: FloatArray,
    options: AssociationOptions,
    t: int,
) -> int:
    """List the options of tracks from t on; return the first track without space, or the number of tracks."""
    start, meas, logw = options
    m = detections.z.shape[0]
    p_d = meas_model.p_d
    log_detected = math.log(p_d) - math.log(2.0 * math.pi)
    log_missed = math.log1p(-p_d)
    while t < tracks.log_death.size and logw.size - start[t] >= m + 2:
        count = start[t]
        p_in_fov = meas_model.p_in_fov[t]
        is_visible = p_d > 0.0 and p_in_fov > MIN_P_IN_FOV
        if is_visible and m > 0:
            count = _list_detections(
                t, tracks, meas_model, gate_chi2, detections, log_detected, options, count
            )
            count = _keep_likeliest(options, start[t], count, best)
        meas[count] = MISSED
        logw[count] = tracks.log_survival[t]
        if is_visible:
            logw[count] += log_missed if p_in_fov == 1.0 else math.log1p(-p_d * p_in_fov)
        count += 1
        if tracks.log_death[t] > -np.inf:
            meas[count] = ABSENT
            logw[count] = tracks.log_death[t]
            count += 1
        _sort_options(meas, logw, start[t], count)
        start[t + 1] = count
        t += 1
    return t


@leaf
def _copy(old: FloatArray | IntArray, n: int, to: FloatArray | IntArray) -> None:
    """Copy the first n elements."""
    for i in range(n):
        to[i] = old[i]


@inlined
def association_options(
    cov: FloatArray,
    log_survival: FloatArray,
    log_death: FloatArray,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
    log_clutter: FloatArray,
    gate_chi2: float,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the association options of each predicted track: start, meas, logw.

    `z` (m, 2) is in sensor coordinates and in the order of `sort_into_strips`. `log_clutter` (m,) is the
    log of the clutter intensity in the same units.
    """
    n = cov.shape[0]
    m = z.shape[0]
    width = max(1, int(math.sqrt(m)))
    count = (m + width - 1) // width
    strip = _Strips(
        width,
        np.empty(count),
        np.empty(m),
        np.empty(_GUIDE_ENTRIES_PER_STRIP * count + 1, np.int32),
        np.empty(count * (width + 1), np.int32),
        np.empty(count + 1),
    )
    _index_strips(z, strip)
    tracks = _Tracks(cov, log_survival, log_death)
    detections = _Detections(z, log_clutter, strip)
    # Enough for most scenes, and for the next track to gate all detections; doubled when it runs out.
    capacity = 5 * n + m + 2
    t = ZERO
    start = np.zeros(n + 1, np.int64)
    meas = np.empty(capacity, np.int64)
    logw = np.empty(capacity)
    best = np.empty(MAX_GATED_DETECTIONS)
    while t < n:
        options = AssociationOptions(start, meas, logw)
        t = _fill_options(tracks, meas_model, gate_chi2, detections, best, options, t)
        if t < n:
            capacity *= 2
            new_meas = np.empty(capacity, np.int64)
            new_logw = np.empty(capacity)
            _copy(meas, start[t], new_meas)
            _copy(logw, start[t], new_logw)
            meas = new_meas
            logw = new_logw
    return start, meas[: start[n]], logw[: start[n]]
