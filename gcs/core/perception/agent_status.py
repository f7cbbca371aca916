"""What became of each agent: flying, arrived or dead, decided from the pictures alone.

Death has hysteresis, against the weakness that the paper names (a clutter point near a dead agent revives
it for a scan): an agent dies when the existence probability of its track falls below `lost_existence`, and
it lives again only when a track above `REVIVE_EXISTENCE` is tied to it and it reports over its link once
more.

Arrival takes two moments in a row within the capture radius, with the agent surely there: one that dies on
its last metres has not arrived. It is latched: an agent that reached its target has done its work, whatever
happens later.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from gcs.core.perception.confirmation import TrackConfirmation
from gcs.core.perception.epochs import ConsecutiveEpochs
from gcs.model import NS_PER_S, AgentStatus, Label, Track

REVIVE_EXISTENCE = 0.9
ARRIVAL_MOMENTS = 2
"""In a row; sensors that measure at the same moment are one."""
UNSEEN_S = 5.0
"""An agent that was there and has had neither track nor report for this long is taken for dead."""
NEVER_SEEN_S = 20.0
"""One that never showed up is given this long."""


class AgentStatusMonitor:
    """The agents' statuses over time.

    Parameters
    ----------
    vehicles : sequence of int
        System ids of all agents of the mission.
    capture_radius_m : float
        An agent this near to its target has reached it.
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
        """Vehicles that are neither dead nor arrived, in order."""
        return [vehicle for vehicle, status in self.by_vehicle.items() if status.status == "active"]

    def arrived(self) -> frozenset[int]:
        """Vehicles that have done their work."""
        return frozenset(vehicle for vehicle, status in self.by_vehicle.items() if status.status == "arrived")

    def lost(self) -> frozenset[int]:
        """Vehicles that are lost."""
        return frozenset(vehicle for vehicle, status in self.by_vehicle.items() if status.status == "lost")

    def at_targets(self) -> Counter[Label]:
        """How many agents arrived at each target that one arrived at."""
        statuses = self.by_vehicle.values()
        return Counter(f.target for f in statuses if f.status == "arrived" and f.target is not None)

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
        """Judge every agent after one scan; return the statuses that changed.

        Parameters
        ----------
        t_ns, measured_t_ns
            When the scan came, and of when it is.
        labels
            Track label of each tied vehicle.
        assigned
            Target that each vehicle is tasked to.
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
                after = self._judge_active(t_ns, measured_t_ns, vehicle, track, target, is_lost)
            elif before.status == "lost" and track is not None and vehicle in reporting:
                after = self._revived(t_ns, vehicle, track)
            if after is not None:
                self.by_vehicle[vehicle] = after
                changed.append(after)
        return changed

    def _judge_active(
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
        moments = self._at_target.take(vehicle, measured_t_ns, holds=near)
        if target is not None and moments >= ARRIVAL_MOMENTS:
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
