"""Which track is which vehicle: gated assignment over time.

A sensor does not say whom it sees, a MAVLink report does. A vehicle is tied to the agent track that its
reports fall onto. A tie holds through silence; it breaks when the vehicle's reports stay outside its
track's gate for several moments, as they do after two tracks swapped their objects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.command.beliefs import Beliefs
from gcs.command.moments import InARow
from gcs.command.trackers import at_time, squared_distances
from gcs.model import NS_PER_S, FloatArray, Label, Track, VehicleState

_FORBIDDEN = 1e9


class Ties:
    """Vehicle to track label, kept over time.

    Parameters
    ----------
    gate_chi2 : float
        Squared Mahalanobis distance within which a report belongs to a track.
    noise_std_m : float
        Standard deviation of a report.
    max_age_s : float
        Older reports say nothing.
    break_after : int
        Moments in a row with the report outside the gate that break a tie.
    """

    def __init__(
        self,
        gate_chi2: float,
        noise_std_m: float,
        max_age_s: float,
        break_after: int = 3,
    ) -> None:
        self._gate_chi2 = gate_chi2
        self._noise: FloatArray = np.eye(2) * noise_std_m**2
        self._max_age_ns = int(max_age_s * NS_PER_S)
        self._break_after = break_after
        self._labels: dict[int, Label] = {}
        self._outside = InARow()
        self._last_look: set[int] = set()
        """Vehicles whose track was dead at the last update."""

    @property
    def labels(self) -> Mapping[int, Label]:
        """Label of the track of each tied vehicle."""
        return self._labels

    def update(self, beliefs: Beliefs, t_ns: int, states: Sequence[VehicleState]) -> None:
        """Check the ties against the believed tracks at `t_ns`, break those that fail, and tie the rest."""
        tracks = beliefs.tracks
        places = {
            state.system_id: at_time(state, t_ns)
            for state in states
            if abs(t_ns - state.t_ns) <= self._max_age_ns
        }
        held: list[tuple[int, Track]] = []
        for vehicle, label in list(self._labels.items()):
            if label not in tracks:
                # Of a dead track its agent dies, once: after that look, whoever reports is tied anew. Of one
                # that is not dead another label has the object by now.
                reports_on = vehicle in self._last_look and vehicle in places
                if reports_on or not beliefs.is_dead(label):
                    self.forget(vehicle)
                else:
                    self._last_look.add(vehicle)
            elif vehicle in places:
                held.append((vehicle, tracks[label]))
        self._check(t_ns, held, places)
        free = [vehicle for vehicle in sorted(places) if vehicle not in self._labels]
        taken = set(self._labels.values())
        candidates = [track for label, track in tracks.items() if label not in taken]
        if free and candidates:
            self._tie(free, candidates, places)

    def forget(self, vehicle: int) -> None:
        """Untie a vehicle."""
        self._labels.pop(vehicle, None)
        self._outside.forget(vehicle)
        self._last_look.discard(vehicle)

    def _check(
        self, t_ns: int, held: Sequence[tuple[int, Track]], places: Mapping[int, tuple[float, float]]
    ) -> None:
        """Count how long reports are outside the gates of their tracks; untie who was there for too long."""
        if not held:
            return
        means, S = self._seen([track for _, track in held])
        reported = np.array([places[vehicle] for vehicle, _ in held])
        is_outside = ~(squared_distances(reported, means, S).diagonal() <= self._gate_chi2)
        for (vehicle, _), holds in zip(held, is_outside.tolist(), strict=True):
            if self._outside.take(vehicle, t_ns, holds=holds) >= self._break_after:
                self.forget(vehicle)

    def _tie(
        self, free: list[int], candidates: list[Track], places: Mapping[int, tuple[float, float]]
    ) -> None:
        reported = np.array([places[vehicle] for vehicle in free])
        costs = squared_distances(reported, *self._seen(candidates))
        costs[~(costs <= self._gate_chi2)] = _FORBIDDEN
        for row, column in zip(*linear_sum_assignment(costs), strict=True):
            if costs[row, column] < _FORBIDDEN:
                self._labels[free[row]] = candidates[column].label

    def _seen(self, tracks: Sequence[Track]) -> tuple[FloatArray, FloatArray]:
        """Where reports of what has these tracks are expected: means (n, 2), covariances (n, 2, 2)."""
        means = np.array([track.mean[:2] for track in tracks])
        return means, np.array([track.cov[:2, :2] for track in tracks]) + self._noise
