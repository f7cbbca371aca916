"""Which track is which vehicle: gated assignment over time.

A sensor does not say whom it sees, a MAVLink report does. A vehicle is tied to the agent track that its
reports fall onto. A tie holds through silence; it breaks when the vehicle's reports stay outside its
track's gate for several moments, as they do after two tracks swapped their objects.

Vehicles that take off from one place have tracks that lie on one another for minutes, and the labels come
apart in any order. So what counts is that there is a track for every vehicle that reports, not which one:

* A vehicle whose tie breaks may take the track of another whose reports are outside that track as well, if
  there is one for that vehicle, too.
* A vehicle that reports while its own track dies takes a track that is free; or that of a vehicle that is
  silent, which gets the dead one instead: of two that cannot be told apart the silent one is gone.
* A vehicle that reports beside any track is not called dead, and is seen there until it is tied. After some
  moments it takes the track of a silent vehicle, which is unseen from then on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.core.perception.confirmation import TrackConfirmation
from gcs.core.perception.epochs import ConsecutiveEpochs
from gcs.core.perception.fusion import at_time, squared_distances
from gcs.model import NS_PER_S, FloatArray, Label, Track, VehicleState

_FORBIDDEN = 1e9
_STAYS = -1.0
"""Less than any distance: nobody is robbed for nothing."""
LIKELY_EXISTENCE = 0.5
"""A track of less says little about a vehicle that reports beside it."""


class TrackVehicleAssociation:
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
        self._outside, self._waiting = ConsecutiveEpochs(), ConsecutiveEpochs()
        self._last_look: set[int] = set()
        """Vehicles whose track was dead at the last update."""
        self.beside: dict[int, Track] = {}
        """Vehicles that are not tied and report beside a track that exists, whoever is tied to it."""

    @property
    def labels(self) -> Mapping[int, Label]:
        """Label of the track of each tied vehicle."""
        return self._labels

    def update(self, confirmation: TrackConfirmation, t_ns: int, states: Sequence[VehicleState]) -> None:
        """Check the ties against the believed tracks at `t_ns`, break those that fail, and tie the rest."""
        tracks = confirmation.tracks
        places = {
            state.system_id: at_time(state, t_ns)
            for state in states
            if abs(t_ns - state.t_ns) <= self._max_age_ns
        }
        held: list[tuple[int, Track]] = []
        dying: list[int] = []
        for vehicle, label in list(self._labels.items()):
            if label not in tracks:
                # Of a dead track its agent dies, once: after that look, whoever reports is tied anew. Of one
                # that is not dead another label has the object by now.
                reports_on = vehicle in self._last_look and vehicle in places
                if reports_on or not confirmation.is_lost(label):
                    self.forget(vehicle)
                elif vehicle in places:
                    dying.append(vehicle)
            elif vehicle in places:
                held.append((vehicle, tracks[label]))
        outside = self._check(t_ns, held, places)
        self._assign(tracks, places, outside, dying)
        self._find_beside(confirmation, places, dying)
        self._replace_silent(tracks, t_ns, places)
        self._last_look |= {v for v, label in self._labels.items() if label not in tracks}

    def forget(self, vehicle: int) -> None:
        """Untie a vehicle."""
        self._labels.pop(vehicle, None)
        self._outside.forget(vehicle)
        self._last_look.discard(vehicle)

    def _check(
        self, t_ns: int, held: Sequence[tuple[int, Track]], places: Mapping[int, tuple[float, float]]
    ) -> set[int]:
        """Untie vehicles whose reports were outside their tracks' gates for too long.

        Returns those whose reports are outside now, and that are still tied.
        """
        if not held:
            return set()
        means, S = self._seen([track for _, track in held])
        reported = np.array([places[vehicle] for vehicle, _ in held])
        is_outside = ~(squared_distances(reported, means, S).diagonal() <= self._gate_chi2)
        outside = set()
        for (vehicle, _), holds in zip(held, is_outside.tolist(), strict=True):
            if self._outside.take(vehicle, t_ns, holds=holds) >= self._break_after:
                self.forget(vehicle)
            elif holds:
                outside.add(vehicle)
        return outside

    def _assign(
        self,
        tracks: Mapping[Label, Track],
        places: Mapping[int, tuple[float, float]],
        outside: set[int],
        dying: Sequence[int],
    ) -> None:
        """Tie vehicles that report to free tracks, or to those of vehicles that find another."""
        free = [vehicle for vehicle in places if vehicle not in self._labels]
        loose = sorted({*free, *dying})
        if loose:
            own = {self._labels[vehicle]: vehicle for vehicle in outside}
            taken = set(self._labels.values()) - own.keys()
            candidates = [track for label, track in tracks.items() if label not in taken]
            tied = self._nearest([*loose, *sorted(outside)], candidates, places, stay=own)
            for vehicle in tied:
                self.forget(vehicle)
            self._labels |= tied
        self._swap(tracks, places, [vehicle for vehicle in dying if self._labels[vehicle] not in tracks])

    def _swap(
        self,
        tracks: Mapping[Label, Track],
        places: Mapping[int, tuple[float, float]],
        dying: Sequence[int],
    ) -> None:
        """Give vehicles that report the tracks of silent ones, and those the dead tracks."""
        silent = self._silent(tracks, places)
        for vehicle, label in self._nearest(dying, [tracks[label] for label in silent], places).items():
            self._labels[silent[label]], self._labels[vehicle] = self._labels[vehicle], label

    def _silent(
        self, tracks: Mapping[Label, Track], places: Mapping[int, tuple[float, float]]
    ) -> dict[Label, int]:
        """Vehicles that do not report, by the believed tracks that they are tied to."""
        return {label: v for v, label in self._labels.items() if v not in places and label in tracks}

    def _replace_silent(
        self, tracks: Mapping[Label, Track], t_ns: int, places: Mapping[int, tuple[float, float]]
    ) -> None:
        """Give the tracks of silent vehicles to those that have reported beside them for some moments."""
        silent = self._silent(tracks, places)
        patient = [
            vehicle
            for vehicle in places
            if self._waiting.take(vehicle, t_ns, holds=vehicle in self.beside) >= self._break_after
        ]
        for vehicle, label in self._nearest(patient, [tracks[label] for label in silent], places).items():
            self.forget(silent[label])
            self._labels[vehicle] = label
            del self.beside[vehicle]

    def _find_beside(
        self, confirmation: TrackConfirmation, places: Mapping[int, tuple[float, float]], dying: Sequence[int]
    ) -> None:
        """Find the tracks that untied vehicles report beside; one whose own track died is untied by it."""
        lost = [vehicle for vehicle in dying if self._labels[vehicle] not in confirmation.tracks]
        untied = [vehicle for vehicle in places if vehicle not in self._labels] + lost
        tracks = [track for track in confirmation.alive if track.existence >= LIKELY_EXISTENCE]
        self.beside = {}
        if not untied or not tracks:
            return
        costs = squared_distances(np.array([places[v] for v in untied]), *self._seen(tracks))
        costs[~(costs <= self._gate_chi2)] = _FORBIDDEN
        for vehicle, row in zip(untied, costs, strict=True):
            nearest = int(row.argmin())
            if row[nearest] < _FORBIDDEN:
                self.forget(vehicle)
                self.beside[vehicle] = tracks[nearest]

    def _nearest(
        self,
        vehicles: Sequence[int],
        tracks: Sequence[Track],
        places: Mapping[int, tuple[float, float]],
        stay: Mapping[Label, int] | None = None,
    ) -> dict[int, Label]:
        """Tracks for vehicles, so that the whole lies nearest, within the gates; no two get one track.

        Those in `stay` keep the track that they have, and are not returned, unless they get another.
        """
        if not vehicles or not tracks:
            return {}
        reported = np.array([places[vehicle] for vehicle in vehicles])
        costs = squared_distances(reported, *self._seen(tracks))
        costs[~(costs <= self._gate_chi2)] = _FORBIDDEN
        keeps = {(vehicle, label) for label, vehicle in (stay or {}).items()}
        numbers = {track.label: column for column, track in enumerate(tracks)}
        for label, vehicle in (stay or {}).items():
            costs[vehicles.index(vehicle), numbers[label]] = _STAYS
        without = np.full((len(vehicles), len(vehicles)), _FORBIDDEN)
        found: dict[int, Label] = {}
        for row, column in zip(*linear_sum_assignment(np.hstack((costs, without))), strict=True):
            if column < len(tracks) and costs[row, column] < _FORBIDDEN:
                found[vehicles[row]] = tracks[column].label
        return {vehicle: label for vehicle, label in found.items() if (vehicle, label) not in keeps}

    def _seen(self, tracks: Sequence[Track]) -> tuple[FloatArray, FloatArray]:
        """Where reports of what has these tracks are expected: means (n, 2), covariances (n, 2, 2)."""
        means = np.array([track.mean[:2] for track in tracks])
        return means, np.array([track.cov[:2, :2] for track in tracks]) + self._noise
