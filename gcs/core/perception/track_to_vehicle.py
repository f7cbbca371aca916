"""Track-to-vehicle association: gated assignment over time.

A vehicle is associated with the agent track that its position reports match. The association holds while the
vehicle is silent. It ends when reports stay outside the track's gate for several epochs, as after two tracks
swapped their objects.

Vehicles that take off from one place have tracks on top of each other for minutes, with interchangeable
labels. So every reporting vehicle needs a track, not a particular one:

* A vehicle whose reports leave the gate may exchange tracks with another such vehicle.
* A reporting vehicle whose track is lost gets a free track, or that of a silent vehicle, which gets the lost
  one.
* A reporting vehicle near any existing track is not lost; it is planned for with that track
  (`near`). After some epochs it gets the track of a silent vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.core.perception.mahalanobis import paired_squared_distances, squared_distances
from gcs.core.perception.perception_state import Association, ConsecutiveEpochs
from gcs.core.perception.report_sensor import at_time
from gcs.core.perception.track_lifecycle import TrackConfirmation
from gcs.core.state import Agent
from gcs.model import NS_PER_S, FloatArray, Label, Track, VehicleState

Positions: TypeAlias = Mapping[int, tuple[float, float]]
"""Reported east and north, by vehicle."""

_FORBIDDEN = 1e9
_KEEP_COST = -1.0
"""Cost of the present track; less than any distance."""
_BREAK_AFTER = 3
"""Consecutive epochs with the report outside the gate that end an association."""
LIKELY_EXISTENCE = 0.5
"""Minimum existence probability of a track near an unassociated vehicle."""


class TrackVehicleAssociation:
    """Labels of the vehicles' tracks.

    Parameters
    ----------
    gate_chi2 : float
        Gate on the squared Mahalanobis distance of a report from a track.
    noise_std_m : float
        Standard deviation of a report.
    max_age_s : float
        Maximum age of a report.
    """

    def __init__(
        self, agents: Mapping[int, Agent], gate_chi2: float, noise_std_m: float, max_age_s: float
    ) -> None:
        self._agents = agents
        self._gate_chi2 = gate_chi2
        self._noise_std_m = noise_std_m
        self._max_age_ns = int(max_age_s * NS_PER_S)

    @property
    def labels(self) -> dict[int, Label]:
        """Track label of each associated vehicle."""
        labels = {vehicle: self._of(vehicle).label for vehicle in self._agents}
        return {vehicle: label for vehicle, label in labels.items() if label is not None}

    def update(self, confirmation: TrackConfirmation, t_ns: int, states: Sequence[VehicleState]) -> None:
        """Check all associations at `t_ns`, end those that fail, and associate the other vehicles."""
        tracks = confirmation.tracks
        positions = {
            state.system_id: at_time(state, t_ns)
            for state in states
            if abs(t_ns - state.t_ns) <= self._max_age_ns
        }
        tracked: list[tuple[int, Track]] = []
        losing: list[int] = []
        for vehicle, label in self.labels.items():
            if label not in tracks:
                # An agent is lost with its track, once; from the next update on, a reporting vehicle is
                # associated again. If the track still exists, another label has the object by now.
                reports_on = self._of(vehicle).was_lost and vehicle in positions
                if reports_on or not confirmation.is_lost(label):
                    self.forget(vehicle)
                elif vehicle in positions:
                    losing.append(vehicle)
            elif vehicle in positions:
                tracked.append((vehicle, tracks[label]))
        outside = self._check(t_ns, tracked, positions)
        self._assign(tracks, positions, outside, losing)
        self._find_unassociated(confirmation, positions, losing)
        self._replace_silent(tracks, t_ns, positions)
        for vehicle, label in self.labels.items():
            self._of(vehicle).was_lost |= label not in tracks

    def forget(self, vehicle: int) -> None:
        """End the association of a vehicle."""
        association = self._of(vehicle)
        association.label = None
        association.was_lost = False
        association.outside = ConsecutiveEpochs()

    def _of(self, vehicle: int) -> Association:
        return self._agents[vehicle].perception.association

    def _check(self, t_ns: int, tracked: Sequence[tuple[int, Track]], positions: Positions) -> set[int]:
        """End associations with reports outside the gate for too long; return the others outside."""
        if not tracked:
            return set()
        vehicles = [vehicle for vehicle, _ in tracked]
        reported = np.array([positions[vehicle] for vehicle in vehicles])
        means = np.array([track.mean[:2] for _, track in tracked])
        covs = np.array([track.cov[:2, :2] for _, track in tracked])
        stds_m = np.array([self._std_m(vehicle) for vehicle in vehicles])
        S = covs + np.eye(2) * (stds_m**2)[:, None, None]
        is_outside = ~(paired_squared_distances(reported, means, S) <= self._gate_chi2)
        outside = set()
        for vehicle, holds in zip(vehicles, is_outside.tolist(), strict=True):
            if self._of(vehicle).outside.count(t_ns, holds=holds) >= _BREAK_AFTER:
                self.forget(vehicle)
            elif holds:
                outside.add(vehicle)
        return outside

    def _assign(
        self, tracks: Mapping[Label, Track], positions: Positions, outside: set[int], losing: Sequence[int]
    ) -> None:
        """Assign free tracks, those of `outside`, and those of silent vehicles to reporting vehicles."""
        labels = self.labels
        vehicles = sorted({*(v for v in positions if v not in labels), *losing})
        if vehicles:
            present = {labels[vehicle]: vehicle for vehicle in outside}
            occupied = set(labels.values()) - present.keys()
            candidates = [track for label, track in tracks.items() if label not in occupied]
            assigned = self._nearest([*vehicles, *sorted(outside)], candidates, positions, present)
            for vehicle, label in assigned.items():
                self.forget(vehicle)
                self._of(vehicle).label = label
        silent = self._silent(tracks, positions)
        losing = [vehicle for vehicle in losing if self._of(vehicle).label not in tracks]
        for vehicle, label in self._nearest(losing, [tracks[label] for label in silent], positions).items():
            one = self._of(vehicle)
            other = self._of(silent[label])
            other.label = one.label
            one.label = label

    def _silent(self, tracks: Mapping[Label, Track], positions: Positions) -> dict[Label, int]:
        """Return the silent vehicles, by their confirmed tracks."""
        return {label: v for v, label in self.labels.items() if v not in positions and label in tracks}

    def _replace_silent(self, tracks: Mapping[Label, Track], t_ns: int, positions: Positions) -> None:
        """Give tracks of silent vehicles to vehicles that have reported near them for some epochs."""
        silent = self._silent(tracks, positions)
        waiting = [
            vehicle
            for vehicle in positions
            if self._of(vehicle).waiting.count(t_ns, holds=self._of(vehicle).near is not None) >= _BREAK_AFTER
        ]
        for vehicle, label in self._nearest(waiting, [tracks[label] for label in silent], positions).items():
            self.forget(silent[label])
            self._of(vehicle).label = label
            self._of(vehicle).near = None

    def _find_unassociated(
        self, confirmation: TrackConfirmation, positions: Positions, losing: Sequence[int]
    ) -> None:
        """Find the existing tracks near vehicles without a confirmed track; end their associations."""
        lost = [vehicle for vehicle in losing if self._of(vehicle).label not in confirmation.tracks]
        vehicles = [vehicle for vehicle in positions if self._of(vehicle).label is None] + lost
        tracks = [track for track in confirmation.existing.values() if track.existence >= LIKELY_EXISTENCE]
        for agent in self._agents.values():
            agent.perception.association.near = None
        if not vehicles or not tracks:
            return
        for vehicle, row in zip(vehicles, self._costs(vehicles, tracks, positions), strict=True):
            nearest = int(row.argmin())
            if row[nearest] < _FORBIDDEN:
                self.forget(vehicle)
                self._of(vehicle).near = tracks[nearest].label

    def _nearest(
        self,
        vehicles: Sequence[int],
        tracks: Sequence[Track],
        positions: Positions,
        present: Mapping[Label, int] | None = None,
    ) -> dict[int, Label]:
        """Return the assignment of tracks to vehicles with the least total distance, within the gates.

        Vehicles in `present` prefer the track that they have; they are returned only with another one.
        """
        if not vehicles or not tracks:
            return {}
        present = present or {}
        costs = self._costs(vehicles, tracks, positions)
        columns = {track.label: column for column, track in enumerate(tracks)}
        for label, vehicle in present.items():
            costs[vehicles.index(vehicle), columns[label]] = _KEEP_COST
        unassigned = np.full((len(vehicles), len(vehicles)), _FORBIDDEN)
        found: dict[int, Label] = {}
        for row, column in zip(*linear_sum_assignment(np.hstack((costs, unassigned))), strict=True):
            if column < len(tracks) and costs[row, column] < _FORBIDDEN:
                found[vehicles[row]] = tracks[column].label
        return {vehicle: label for vehicle, label in found.items() if present.get(label) != vehicle}

    def _costs(self, vehicles: Sequence[int], tracks: Sequence[Track], positions: Positions) -> FloatArray:
        """Return gated squared distances, (vehicles, tracks)."""
        costs = self._squared_distances(vehicles, tracks, positions)
        costs[~(costs <= self._gate_chi2)] = _FORBIDDEN
        return costs

    def _std_m(self, vehicle: int) -> float:
        """Return the standard deviation of a vehicle's reports."""
        slow = self._agents[vehicle].link.high_latency
        return self._noise_std_m if slow is None else slow.std_m

    def _squared_distances(
        self, vehicles: Sequence[int], tracks: Sequence[Track], positions: Positions
    ) -> FloatArray:
        """Return squared Mahalanobis distances of reports from tracks, (vehicles, tracks)."""
        reported = np.array([positions[vehicle] for vehicle in vehicles])
        means = np.array([track.mean[:2] for track in tracks])
        covs = np.array([track.cov[:2, :2] for track in tracks])
        distances = squared_distances(reported, means, covs + np.eye(2) * self._noise_std_m**2)
        for row, vehicle in enumerate(vehicles):
            slow = self._agents[vehicle].link.high_latency
            if slow is not None:
                S = covs + np.eye(2) * slow.std_m**2
                distances[row] = squared_distances(reported[row : row + 1], means, S)[0]
        return distances
