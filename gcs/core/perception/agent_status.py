"""Agent status: active, arrived or lost, from tracks and position reports.

An agent is lost when the existence probability of its track falls below `lost_existence`. It is active again
only when it reports and is associated with a track above `REVIVE_EXISTENCE`: clutter near a lost agent does
not revive it.

An agent has arrived after two consecutive epochs within the capture radius with a confirmed track. Arrival is
final.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from gcs.core.perception.confirmation import ConsecutiveEpochs, TrackConfirmation
from gcs.model import NS_PER_S, AgentStatus, Label, Track

REVIVE_EXISTENCE = 0.9
ARRIVAL_EPOCHS = 2
"""Consecutive epochs within the capture radius."""
UNSEEN_S = 5.0
"""An agent without track and report for this long is lost."""
NEVER_SEEN_S = 20.0
"""The same for an agent that was never seen."""


class AgentStatusMonitor:
    """Statuses of all agents.

    Parameters
    ----------
    vehicles : sequence of int
        System ids of all agents of the mission.
    capture_radius_m : float
        Distance at which an agent has reached its target.
    """

    def __init__(self, vehicles: Sequence[int], capture_radius_m: float) -> None:
        self._capture_radius_m = capture_radius_m
        self._awaited_t_ns: dict[int, int] = {}
        self._seen_t_ns: dict[int, int] = {}
        self._at_target = ConsecutiveEpochs()
        self._last_position_m: dict[int, tuple[float, float]] = {}
        self.by_vehicle: dict[int, AgentStatus] = {
            vehicle: AgentStatus(0, vehicle, "active") for vehicle in vehicles
        }

    def active(self) -> list[int]:
        """Return the active agents, in the order of the mission file."""
        return [vehicle for vehicle, status in self.by_vehicle.items() if status.status == "active"]

    def arrived(self) -> frozenset[int]:
        """Return the agents that have arrived."""
        return frozenset(vehicle for vehicle, status in self.by_vehicle.items() if status.status == "arrived")

    def lost(self) -> frozenset[int]:
        """Return the lost agents."""
        return frozenset(vehicle for vehicle, status in self.by_vehicle.items() if status.status == "lost")

    def at_targets(self) -> Counter[Label]:
        """Return the number of arrived agents by target."""
        statuses = self.by_vehicle.values()
        return Counter(s.target for s in statuses if s.status == "arrived" and s.target is not None)

    def update(
        self,
        t_ns: int,
        measured_t_ns: int,
        agents: TrackConfirmation,
        targets: TrackConfirmation,
        labels: Mapping[int, Label],
        assigned: Mapping[int, Label],
        reporting: set[int],
    ) -> list[AgentStatus]:
        """Update all statuses after one scan; return those that changed.

        Parameters
        ----------
        t_ns, measured_t_ns
            Arrival and measurement time of the scan.
        labels
            Track label of each associated vehicle.
        assigned
            Target of each tasked vehicle.
        reporting
            Vehicles with a fresh position report.
        """
        changed = []
        for vehicle, before in self.by_vehicle.items():
            label = labels.get(vehicle)
            track = agents.tracks.get(label) if label is not None else None
            if label is not None or vehicle in reporting:
                self._seen_t_ns[vehicle] = t_ns
            if track is not None and track.estimated:
                self._last_position_m[vehicle] = (float(track.mean[0]), float(track.mean[1]))
            target = targets.tracks.get(assigned[vehicle]) if vehicle in assigned else None
            is_lost = label is not None and agents.is_lost(label)
            after = None
            if before.status == "active":
                after = self._update_active(t_ns, measured_t_ns, vehicle, track, target, is_lost)
            elif before.status == "lost" and track is not None and vehicle in reporting:
                after = self._revived(t_ns, vehicle, track)
            if after is not None:
                self.by_vehicle[vehicle] = after
                changed.append(after)
        return changed

    def _update_active(
        self,
        t_ns: int,
        measured_t_ns: int,
        vehicle: int,
        track: Track | None,
        target: Track | None,
        is_lost: bool,
    ) -> AgentStatus | None:
        position = self._last_position_m.get(vehicle)
        near = track is not None and target is not None and self._is_at(track, target)
        epochs = self._at_target.count(vehicle, measured_t_ns, holds=near)
        if target is not None and epochs >= ARRIVAL_EPOCHS:
            return AgentStatus(t_ns, vehicle, "arrived", target.label, position)
        is_gone = is_lost or self._is_unseen(t_ns, vehicle)
        return AgentStatus(t_ns, vehicle, "lost", None, position) if is_gone else None

    def _is_unseen(self, t_ns: int, vehicle: int) -> bool:
        seen_t_ns = self._seen_t_ns.get(vehicle)
        if seen_t_ns is not None:
            return t_ns - seen_t_ns > UNSEEN_S * NS_PER_S
        return t_ns - self._awaited_t_ns.setdefault(vehicle, t_ns) > NEVER_SEEN_S * NS_PER_S

    def _revived(self, t_ns: int, vehicle: int, track: Track) -> AgentStatus | None:
        if track.existence < REVIVE_EXISTENCE:
            return None
        return AgentStatus(t_ns, vehicle, "active", None, self._last_position_m.get(vehicle))

    def _is_at(self, track: Track, target: Track) -> bool:
        distance_m = math.hypot(track.mean[0] - target.mean[0], track.mean[1] - target.mean[1])
        return track.estimated and distance_m <= self._capture_radius_m
