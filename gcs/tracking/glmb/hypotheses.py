"""What hypotheses are made of, as flat arrays, and the bounds on them.

A delta-GLMB density over labels is a list of weighted hypotheses, each a set of tracks (Vo, Vo & Phung 2014).
Weights are logarithms throughout; hypotheses of a group are sorted, best first, and their weights sum to 1.
Lists of lists are flat: list i is `items[start[i]:start[i + 1]]`. Before a scan's update a hypothesis's items
are tracks. A child's are option indices, which name (track, detection) pairs and so become the next scan's
tracks. Why the kernels of this room look as they do, and which file's cache to clear after an edit: see
`gcs.jit`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gcs.jit import inlined
from gcs.tracking.numerics.sorting import head

DIED = -2


class Clusters(NamedTuple):
    """Independent groups of hypotheses: group g has hypotheses `first[g]` to `first[g + 1]`."""

    first: Any
    start: Any
    """Hypothesis h has items `start[h]` to `start[h + 1]`."""
    items: Any
    logw: Any

    @classmethod
    def example(cls) -> Clusters:
        """Return the least that kernels can be called with."""
        return cls(np.arange(2), np.arange(2), np.zeros(1, np.int64), np.zeros(1))


class AssociationOptions(NamedTuple):
    """What each track may do (see `gates.options`)."""

    start: Any
    meas: Any
    logw: Any


class Limits(NamedTuple):
    """What bounds the work and the approximation."""

    max_hypotheses: int
    """Most hypotheses of one group."""
    log_prune: float
    """Log of the least weight kept, relative to the group's best."""
    tail_share: float
    """Of a label that competes with nobody, least probable histories that hold less than this share of its
    probability together are dropped."""
    min_existence: float
    """Labels below it are forgotten."""
    max_conflict: float
    """Labels that would take the same detection less probably than this are associated apart."""
    max_dependence: float
    """Labels whose joint differs by less (total variation) from the product of marginals part."""
    max_enumerated: int
    """Most joint options within `log_prune` of the best of a hypothesis that is enumerated; beyond, it is
    sampled."""
    gibbs_sweeps: int
    """Gibbs sweeps that a group's sampled hypotheses share by weight."""
    gate_chi2: float
    """Squared Mahalanobis distance of the gate."""
    merge_chi2: float
    """Tracks of one label closer than this (squared, Mahalanobis) become one."""


@inlined
def mix64(x: Any) -> Any:
    """Bijective scrambling of 64 bits (the finaliser of SplitMix64, Steele et al. 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@inlined
def item_key(item: Any) -> Any:
    """Random-looking 64 bits for an item; a set of them is known by their sum.

    Worked out at every use: a table of all is soon slower, since it is read here and there.
    """
    return mix64(np.uint64(item + 1) * np.uint64(0x9E3779B97F4A7C15))


@inlined
def allocate_clusters(n_clusters: int, n_hyps: int, n_items: int) -> Clusters:
    """Return room for so many groups, hypotheses and items."""
    return Clusters(
        np.empty(n_clusters + 1, np.int64),
        np.empty(n_hyps + 1, np.int64),
        np.empty(n_items, np.int64),
        np.empty(n_hyps),
    )


@inlined
def trim_clusters(clusters: Clusters, count: int, n: int) -> Clusters:
    """What of the room is filled: `count` groups with n hypotheses."""
    return Clusters(
        head(clusters.first, count + 1),
        head(clusters.start, n + 1),
        head(clusters.items, clusters.start[n]),
        head(clusters.logw, n),
    )
