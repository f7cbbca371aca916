"""What became of each agent: flying, arrived or dead, decided from the pictures alone.

Death has hysteresis, against the weakness that the paper names (a clutter point near a dead agent revives
it for a scan): an agent dies when the existence probability of its track falls below `dead_existence`, and
it lives again only when a track above `revive_existence` is tied to it and it reports over its link once
more. Arrival is latched: an agent that reached its target has done its work, whatever happens to it later.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs.model import NS_PER_S, Fate, Label, Picture, Track

REVIVE_EXISTENCE = 0.9
UNSEEN_S = 20.0
"""An agent with neither track nor report for this long is taken for dead, also when it never showed up."""


class Fates:
    """The agents' fates over time.

    Parameters
    ----------
    vehicles : list of int
        System ids of all agents of the mission.
    """

    def __init__(
        self, vehicles: list[int], confirm_existence: float, dead_existence: float, capture_radius_m: float
    ) -> None:
        self._confirm_existence = confirm_existence
        self._dead_existence = dead_existence
        self._capture_radius_m = capture_radius_m
        self._seen_t_ns: dict[int, int] = {}
        self._last_position_m: dict[int, tuple[float, float]] = {}
        self.by_vehicle: dict[int, Fate] = {vehicle: Fate(0, vehicle, "flying") for vehicle in vehicles}

    def flying(self) -> list[int]:
        """Vehicles that are neither dead nor arrived, in order."""
        return [vehicle for vehicle, fate in self.by_vehicle.items() if fate.fate == "flying"]

    def reached(self) -> set[Label]:
        """Targets at which an agent arrived."""
        return {
            fate.target
            for fate in self.by_vehicle.values()
            if fate.fate == "arrived" and fate.target is not None
        }

    def update(
        self,
        agents: Picture,
        targets: Picture,
        ties: Mapping[int, Label],
        assigned: Mapping[int, Label],
        reporting: set[int],
    ) -> list[Fate]:
        """Judge every agent after one scan; return the fates that changed.

        Parameters
        ----------
        ties
            Track label of each tied vehicle.
        assigned
            Target that each vehicle is tasked to.
        reporting
            Vehicles with a fresh position report.
        """
        by_label = {track.label: track for track in agents.tracks}
        target_tracks = {track.label: track for track in targets.tracks}
        changed = []
        for vehicle, before in self.by_vehicle.items():
            track = by_label.get(ties[vehicle]) if vehicle in ties else None
            if track is not None and track.existence >= self._confirm_existence:
                self._last_position_m[vehicle] = (float(track.mean[0]), float(track.mean[1]))
            if vehicle in ties or vehicle in reporting:
                self._seen_t_ns[vehicle] = agents.t_ns
            target = target_tracks.get(assigned[vehicle]) if vehicle in assigned else None
            after = self._judge(before, track, target, agents.t_ns, vehicle in ties, vehicle in reporting)
            if after is not None:
                self.by_vehicle[vehicle] = after
                changed.append(after)
        return changed

    def _judge(
        self, before: Fate, track: Track | None, target: Track | None, t_ns: int, tied: bool, reports: bool
    ) -> Fate | None:
        vehicle = before.vehicle
        position = self._last_position_m.get(vehicle)
        existence = track.existence if track is not None else 0.0
        if before.fate == "flying":
            if track is not None and target is not None and self._has_arrived(track, target):
                return Fate(t_ns, vehicle, "arrived", target.label, position)
            unseen = t_ns - self._seen_t_ns.setdefault(vehicle, t_ns) > UNSEEN_S * NS_PER_S
            if unseen or (tied and existence < self._dead_existence):
                return Fate(t_ns, vehicle, "dead", None, position)
        elif before.fate == "dead" and tied and reports and existence >= REVIVE_EXISTENCE:
            return Fate(t_ns, vehicle, "flying", None, position)
        return None

    def _has_arrived(self, track: Track, target: Track) -> bool:
        if min(track.existence, target.existence) < self._confirm_existence:
            return False
        distance_m = math.hypot(track.mean[0] - target.mean[0], track.mean[1] - target.mean[1])
        return distance_m <= self._capture_radius_m
