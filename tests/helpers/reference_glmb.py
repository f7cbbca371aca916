"""Reference implementation of the GLMB filter, exact, for tests with tiny scenes.

It enumerates every association of every hypothesis (B.-T. Vo & B.-N. Vo, IEEE TSP 61, 2013, with the joint
prediction and update of Vo, Vo & Hoang 2017). It has no gates, limits, pruning, merging or clusters. Three
objects and a few scans are its limit. Model and arguments are those of `gcs.tracking.Glmb`.

`ranked_assignments` yields the best associations of one larger scan in order.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from statistics import NormalDist

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.model import NS_PER_S, FloatArray, Label, Sensor
from gcs.tracking.glmb.filter import Birth, GlmbParams
from gcs.tracking.glmb.gating import MIN_P_IN_FOV
from gcs.tracking.models import constant_velocity

Track = tuple[Label, tuple[int, ...]]
"""A label and its detections so far, -1 for a miss."""
Hypothesis = frozenset[Track]

_H = np.eye(2, 4)


class ReferenceGlmb:
    """Exact delta-GLMB recursion; `weights` maps each hypothesis to its probability."""

    def __init__(self, params: GlmbParams) -> None:
        self.params = params
        self.weights: dict[Hypothesis, float] = {frozenset(): 1.0}
        self._states: dict[Track, tuple[FloatArray, FloatArray]] = {}
        self._t_ns: int | None = None
        self._scans = 0

    def update(self, t_ns: int, z_m: FloatArray, sensor: Sensor, births: Sequence[Birth] = ()) -> None:
        """Predict and update with a scan (see `Glmb.update`)."""
        dt_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) / NS_PER_S
        self._t_ns = t_ns
        F = constant_velocity.transition(dt_s)
        Q = self.params.process_noise(dt_s)
        live = self.params.survival_probability_per_s**dt_s
        predicted = {track: (F @ m, F @ P @ F.T + Q, live) for track, (m, P) in self._states.items()}
        self._states = {}
        born: list[Track] = []
        for i, birth in enumerate(births):
            born.append(((self._scans, i), ()))
            predicted[born[-1]] = (birth.mean, birth.cov, birth.probability)
        options = {
            track: self._options(track, m, P, p, z_m, sensor) for track, (m, P, p) in predicted.items()
        }
        weights: defaultdict[Hypothesis, float] = defaultdict(float)
        for parent, weight in self.weights.items():
            for choice in itertools.product(*(options[track] for track in [*parent, *born])):
                used_detections = [used for used, _, _ in choice if used >= 0]
                if len(used_detections) == len(set(used_detections)):
                    child = frozenset(track for _, _, track in choice if track is not None)
                    weights[child] += weight * math.prod(share for _, share, _ in choice)
        total = sum(weights.values())
        self.weights = {child: weight / total for child, weight in weights.items() if weight > 0.0}
        self._scans += 1

    def _options(
        self, track: Track, mean: FloatArray, cov: FloatArray, live: float, z_m: FloatArray, sensor: Sensor
    ) -> list[tuple[int, float, Track | None]]:
        """Return all association options of a track: detection or -1, weight, resulting track or None."""
        label, history = track
        east_min, north_min, east_max, north_max = sensor.field_of_view_m
        in_view = math.prod(
            NormalDist(mean[i], math.sqrt(cov[i, i])).cdf(high)
            - NormalDist(mean[i], math.sqrt(cov[i, i])).cdf(low)
            for i, (low, high) in enumerate([(east_min, east_max), (north_min, north_max)])
        )
        p_d = sensor.detection_probability
        missed = (label, (*history, -1))
        self._states[missed] = (mean, cov)
        options: list[tuple[int, float, Track | None]] = [
            (-1, 1.0 - live, None),
            (-1, live * (1.0 - p_d * in_view), missed),
        ]
        S = _H @ cov @ _H.T + sensor.noise_cov_m2
        gain = cov @ _H.T @ np.linalg.inv(S)
        for j, z in enumerate(z_m if in_view > MIN_P_IN_FOV else ()):
            hit = (label, (*history, j))
            step = z - _H @ mean
            density = math.exp(-0.5 * step @ np.linalg.solve(S, step)) / math.sqrt(
                np.linalg.det(2.0 * math.pi * S)
            )
            self._states[hit] = (mean + gain @ step, cov - gain @ S @ gain.T)
            options.append((j, live * p_d * density / sensor.clutter_density_per_m2, hit))
        return options

    def label_sets(self) -> dict[frozenset[Label], float]:
        """Return the probability that exactly these labels exist."""
        sets: defaultdict[frozenset[Label], float] = defaultdict(float)
        for hypothesis, weight in self.weights.items():
            sets[frozenset(label for label, _ in hypothesis)] += weight
        return dict(sets)

    def existence(self, label: Label) -> float:
        """Return the probability that a label exists."""
        return sum(w for labels, w in self.label_sets().items() if label in labels)

    def mean(self, label: Label) -> FloatArray:
        """Return the expected state of a label, given that it exists."""
        held = [
            (w, self._states[t][0])
            for hypothesis, w in self.weights.items()
            for t in hypothesis
            if t[0] == label
        ]
        return np.asarray(sum(w * m for w, m in held) / sum(w for w, _ in held))


def ranked_assignments(cost: FloatArray) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Yield the assignments of a column to each row of `cost` (n, m), the cheapest first (Murty 1968).

    Yields the total cost and the column of each row. A cost of `inf` forbids a pair.
    """
    count = itertools.count()
    waiting: list[tuple[float, int, tuple[int, ...], int, FloatArray]] = []

    def add_candidate(cost: FloatArray, agreed: int) -> None:
        try:
            _, columns = linear_sum_assignment(cost)
        except ValueError:  # nothing in this part is allowed
            return
        total = float(cost[np.arange(len(cost)), columns].sum())
        heapq.heappush(waiting, (total, next(count), tuple(columns.tolist()), agreed, cost))

    add_candidate(np.array(cost, dtype=np.float64), 0)
    while waiting:
        total, _, columns, agreed, cost = heapq.heappop(waiting)
        yield total, columns
        for row in range(agreed, len(cost)):
            other = cost.copy()
            other[row, columns[row]] = np.inf
            add_candidate(other, row)
            keep = cost[row, columns[row]]
            cost[row] = np.inf
            cost[row, columns[row]] = keep
