"""Joint association of clusters with several labels, by branch and bound or Gibbs sampling.

In a posterior component each track of a hypothesis takes one of its association options, and no two tracks
take the same detection. The weight of a component is that of its hypothesis times those of the options (see
`recursion`, equation *recursion*).

A hypothesis with few joint options is enumerated by branch and bound. That finds exactly the components above
the floor. A larger hypothesis is Gibbs-sampled (`recursion`, equation *Gibbs*): each track in turn draws one
of the options that the other tracks leave free. Every distinct state is a component with its exact weight.

===============  ==================  =======  ======================================================
array            shape               dtype    meaning (H hypotheses, C clusters, n tracks, m detections)
===============  ==================  =======  ======================================================
_Bounds.n_joint  (H,)                float64  number of joint options
.best_logw       (H,)                float64  upper bound of the log-weight of a component
.capacity        (C,)                int64    bound on the components of a cluster
.max_size        (C,)                int64    most tracks of a component
is_assigned      (m,)                bool     True if a track has the detection
assignment       (n,)                int64    option of each track: gamma
partial_logw     (n + 1,)            float64  log-weight of the first tracks' options
best_remaining   (n + 1,)            float64  log-weight of the best options of the tracks behind
loss_histogram   (_LOSS_BINS,)       float64  joint options by loss against the best
visited          (power of two,)     uint64   hash table of the Gibbs states
===============  ==================  =======  ======================================================
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf, spliced
from gcs.model import BoolArray, FloatArray, IntArray, KeyArray
from gcs.tracking.glmb.hypotheses import (
    AssociationOptions,
    Clusters,
    allocate_clusters,
    item_key,
    mix64,
    trim_clusters,
)
from gcs.tracking.glmb.hypothesis_pool import HypothesisPool, add_candidate, allocate_pool
from gcs.tracking.glmb.params import Limits
from gcs.tracking.numerics.sorting import SortBuffers, allocate_sort, argsort_descending, power_of_two

_FEW_JOINT_OPTIONS = 1000
_LOSS_BINS = 16


class _Bounds(NamedTuple):
    """Bounds of the search (see the table above)."""

    n_joint: FloatArray
    best_logw: FloatArray
    capacity: IntArray
    max_size: IntArray


class _Scratch(NamedTuple):
    """Scratch of the search in one hypothesis (see the table above)."""

    is_assigned: BoolArray
    assignment: IntArray
    partial_logw: FloatArray
    best_remaining: FloatArray
    loss_histogram: FloatArray
    visited: KeyArray
    order: SortBuffers


class _Search(NamedTuple):
    """Search in one cluster."""

    pool: HypothesisPool
    capacity: int
    slots: int
    options: AssociationOptions
    limits: Limits
    scratch: _Scratch


@inlined
def _random_uniform(rng: KeyArray) -> float:
    """Return a uniform number in [0, 1); `rng` (1,) is the state of a SplitMix64 generator."""
    rng[0] = rng[0] + np.uint64(0x9E3779B97F4A7C15)
    return float(mix64(rng[0]) >> np.uint64(11)) * 2.0**-53


@inlined
def _branch_and_bound(
    search: _Search, count: int, floor: float, parent_logw: float, tracks: IntArray
) -> tuple[int, float]:
    """Add every component of a hypothesis above the floor: depth first, best options first.

    The bound gives the remaining tracks their best options as if no other track competed for them.
    """
    pool, capacity, slots, options, limits, scratch = search
    start, meas, logw = options
    is_assigned = scratch.is_assigned
    assignment = scratch.assignment
    total = scratch.partial_logw
    best_remaining = scratch.best_remaining
    n = tracks.size
    best_remaining[n] = 0.0
    total[0] = parent_logw
    for d in range(n - 1, -1, -1):
        assignment[d] = start[tracks[d]] - 1
        best_remaining[d] = best_remaining[d + 1] + logw[start[tracks[d]]]
    d = 0
    while d >= 0:
        if d == n:
            floor = max(floor, total[n] + limits.log_prune)
            count, floor = add_candidate(
                pool, capacity, slots, count, floor, total[n], assignment, n, options, limits
            )
            d -= 1
            continue
        first = start[tracks[d]]
        end = start[tracks[d] + 1]
        o = assignment[d]
        if o >= first and meas[o] >= 0:
            is_assigned[meas[o]] = False
        o += 1
        while o < end and meas[o] >= 0 and is_assigned[meas[o]]:
            o += 1
        if o == end or total[d] + logw[o] + best_remaining[d + 1] < floor:
            assignment[d] = first - 1
            d -= 1
            continue
        assignment[d] = o
        if meas[o] >= 0:
            is_assigned[meas[o]] = True
        total[d + 1] = total[d] + logw[o]
        d += 1
    return count, floor


@inlined
def _assign_greedily(
    tracks: IntArray, options: AssociationOptions, is_assigned: BoolArray, assignment: IntArray
) -> float:
    """Give each track in turn its best free option; return their log-weight."""
    start, meas, logw = options
    total = 0.0
    for i in range(tracks.size):
        o = start[tracks[i]]
        while meas[o] >= 0 and is_assigned[meas[o]]:
            o += 1
        assignment[i] = o
        if meas[o] >= 0:
            is_assigned[meas[o]] = True
        total += logw[o]
    return total


@inlined
def _release_detections(
    tracks: IntArray, options: AssociationOptions, is_assigned: BoolArray, assignment: IntArray
) -> None:
    """Mark the detections of an assignment as free."""
    for i in range(tracks.size):
        if options.meas[assignment[i]] >= 0:
            is_assigned[options.meas[assignment[i]]] = False


@inlined
def _count_assignments(
    tracks: IntArray, options: AssociationOptions, slack: float, count: FloatArray
) -> float:
    """Estimate how many joint options lose less than `slack` against the best of each track.

    Conflicts are ignored, and losses are counted in the bins of `count`, rounded down: the result is an upper
    bound.
    """
    start, _, logw = options
    count[:] = 0.0
    count[0] = 1.0
    per_step = count.size / slack
    for i in range(tracks.size):
        first = start[tracks[i]]
        end = start[tracks[i] + 1]
        for b in range(count.size - 1, -1, -1):
            total = 0.0
            for o in range(first, end):
                loss = (logw[first] - logw[o]) * per_step
                if loss >= b + 1:
                    break
                total += count[b - int(loss)]
            count[b] = total
    number = 0.0
    for b in range(count.size):
        number += count[b]
    return number


@inlined
def _gibbs_draw(
    first: int, end: int, options: AssociationOptions, is_assigned: BoolArray, rng: KeyArray
) -> int:
    """Draw one of the free options of a track in proportion to its weight."""
    _, meas, logw = options
    while meas[first] >= 0 and is_assigned[meas[first]]:
        first += 1
    total = 0.0
    for o in range(first, end):
        if meas[o] < 0 or not is_assigned[meas[o]]:
            total += math.exp(logw[o] - logw[first])
    remaining = _random_uniform(rng) * total
    choice = first
    for o in range(first, end):
        if meas[o] < 0 or not is_assigned[meas[o]]:
            choice = o
            remaining -= math.exp(logw[o] - logw[first])
            if remaining < 0.0:
                break
    return choice


@inlined
def _gibbs_sample(
    search: _Search,
    count: int,
    floor: float,
    parent_logw: float,
    tracks: IntArray,
    gibbs_sweeps: int,
    rng: KeyArray,
) -> tuple[int, float]:
    """Add the distinct components that the Gibbs sampler visits, from the greedy one on."""
    pool, capacity, slots, options, limits, scratch = search
    is_assigned = scratch.is_assigned
    assignment = scratch.assignment
    visited = scratch.visited
    start = options.start
    meas = options.meas
    n = tracks.size
    _assign_greedily(tracks, options, is_assigned, assignment)
    size = power_of_two(2 * gibbs_sweeps + 2)
    for i in range(size):
        visited[i] = 0
    mask = np.uint64(size - 1)
    for _ in range(gibbs_sweeps):
        logw = parent_logw
        key = np.uint64(1)
        for i in range(n):
            logw += options.logw[assignment[i]]
            key += item_key(assignment[i])
        at = key & mask
        while visited[at] != 0 and visited[at] != key:
            at = (at + np.uint64(1)) & mask
        if visited[at] == 0:
            visited[at] = key
            floor = max(floor, logw + limits.log_prune)
            if logw >= floor:
                count, floor = add_candidate(
                    pool, capacity, slots, count, floor, logw, assignment, n, options, limits
                )
        for i in range(n):
            if meas[assignment[i]] >= 0:
                is_assigned[meas[assignment[i]]] = False
            assignment[i] = _gibbs_draw(start[tracks[i]], start[tracks[i] + 1], options, is_assigned, rng)
            if meas[assignment[i]] >= 0:
                is_assigned[meas[assignment[i]]] = True
    _release_detections(tracks, options, is_assigned, assignment)
    return count, floor


@leaf
def _compute_bounds(
    clusters: Clusters, options: AssociationOptions, max_hypotheses: int, bounds: _Bounds
) -> tuple[int, int, int, int, int]:
    """Fill the bounds.

    Returns the most tracks of a cluster, its largest capacity, the bounds on hypotheses and items of the
    result, and the most hypotheses of a cluster.
    """
    first, start, items, logw = clusters
    max_cluster_size = 0
    max_capacity = 0
    n_out_hypotheses = 0
    n_out_items = 0
    max_cluster_hypotheses = 0
    for g in range(first.size - 1):
        total = 0.0
        size = 1
        for h in range(first[g], first[g + 1]):
            n_joint = 1.0
            best_logw = logw[h]
            size = max(size, start[h + 1] - start[h])
            for i in range(start[h], start[h + 1]):
                o = options.start[items[i]]
                n_joint *= options.start[items[i] + 1] - o
                best_logw += options.logw[o]
            bounds.n_joint[h] = n_joint
            bounds.best_logw[h] = best_logw
            total += n_joint
        bounds.capacity[g] = int(min(total, 4.0 * max_hypotheses)) + 1
        bounds.max_size[g] = size
        n_out_hypotheses += min(bounds.capacity[g], max_hypotheses)
        n_out_items += min(bounds.capacity[g], max_hypotheses) * size
        max_cluster_size = max(max_cluster_size, size)
        max_capacity = max(max_capacity, bounds.capacity[g])
        max_cluster_hypotheses = max(max_cluster_hypotheses, first[g + 1] - first[g])
    return max_cluster_size, max_capacity, n_out_hypotheses, n_out_items, max_cluster_hypotheses


@spliced
def _fill_pool(
    clusters: Clusters,
    g: int,
    options: AssociationOptions,
    limits: Limits,
    bound: _Bounds,
    pool: HypothesisPool,
    scratch: _Scratch,
    rng: KeyArray,
) -> int:
    """Put the posterior components of cluster g into the pool; return their number."""
    capacity = bound.capacity[g]
    slots = power_of_two(2 * bound.capacity[g])
    for i in range(slots):
        pool.slot[i] = -1
    search = _Search(pool, capacity, slots, options, limits, scratch)
    count = ZERO
    floor = -np.inf
    argsort_descending(bound.best_logw, clusters.first[g], clusters.first[g + 1], scratch.order)
    for k in range(clusters.first[g + 1] - clusters.first[g]):
        h = scratch.order.index[k]
        if bound.best_logw[h] < floor:
            break
        parent_logw = clusters.logw[h]
        tracks = clusters.items[clusters.start[h] : clusters.start[h + 1]]
        n_assignments = bound.n_joint[h]
        if n_assignments > _FEW_JOINT_OPTIONS:
            greedy = parent_logw + _assign_greedily(tracks, options, scratch.is_assigned, scratch.assignment)
            _release_detections(tracks, options, scratch.is_assigned, scratch.assignment)
            slack = bound.best_logw[h] - max(floor, greedy + limits.log_prune)
            n_assignments = min(
                n_assignments, _count_assignments(tracks, options, slack, scratch.loss_histogram)
            )
        if n_assignments <= limits.max_enumerated:
            count, floor = _branch_and_bound(search, count, floor, parent_logw, tracks)
        else:
            gibbs_sweeps = math.ceil(limits.gibbs_sweeps * math.exp(parent_logw)) + 8
            count, floor = _gibbs_sample(search, count, floor, parent_logw, tracks, gibbs_sweeps, rng)
    return count


@leaf
def _update_clusters(
    clusters: Clusters,
    options: AssociationOptions,
    limits: Limits,
    bound: _Bounds,
    pool: HypothesisPool,
    scratch: _Scratch,
    rng: KeyArray,
    out: Clusters,
) -> int:
    """Fill `out` with the posterior components of all clusters; return their number."""
    n = 0
    logw = out.logw
    out.first[0] = out.start[0] = 0
    for g in range(clusters.first.size - 1):
        count = _fill_pool(clusters, g, options, limits, bound, pool, scratch, rng)
        argsort_descending(pool.logw, ZERO, count, pool.order)
        best_logw = pool.logw[pool.order.index[0]]
        low = n
        total = 0.0
        for k in range(count):
            i = pool.order.index[k]
            if n == low + limits.max_hypotheses or pool.logw[i] < best_logw + limits.log_prune:
                break
            logw[n] = pool.logw[i] - best_logw
            out.start[n + 1] = out.start[n] + pool.size[i]
            for j in range(pool.size[i]):
                out.items[out.start[n] + j] = pool.items[i, j]
            total += math.exp(logw[n])
            n += 1
        log_total = math.log(total)
        for h in range(low, n):
            logw[h] -= log_total
        out.first[g + 1] = n
    return n


@kernel
def update_clusters(
    clusters: Clusters, options: AssociationOptions, n_detections: int, limits: Limits, rng: KeyArray
) -> Clusters:
    """Return the posterior components of clusters with several labels; their items are options.

    `rng` (1,) uint64 advances.
    """
    n_clusters = clusters.first.size - 1
    n_hyps = clusters.logw.size
    bound = _Bounds(
        np.empty(n_hyps), np.empty(n_hyps), np.empty(n_clusters, np.int64), np.empty(n_clusters, np.int64)
    )
    max_cluster_size, max_capacity, n_out_hypotheses, n_out_items, max_cluster_hypotheses = _compute_bounds(
        clusters, options, limits.max_hypotheses, bound
    )
    scratch = _Scratch(
        np.zeros(n_detections, np.bool_),
        np.empty(max_cluster_size, np.int64),
        np.empty(max_cluster_size + 1),
        np.empty(max_cluster_size + 1),
        np.empty(_LOSS_BINS),
        np.empty(power_of_two(2 * (limits.gibbs_sweeps + 9) + 2), np.uint64),
        allocate_sort(max_cluster_hypotheses),
    )
    out = allocate_clusters(n_clusters, n_out_hypotheses, n_out_items)
    n = _update_clusters(
        clusters, options, limits, bound, allocate_pool(max_capacity, max_cluster_size), scratch, rng, out
    )
    return trim_clusters(out, n_clusters, n)
