"""Arrival and loss: when an agent counts as arrived, as lost, and as active again.

The fourth status, down, comes from the vehicle's own telemetry (`gcs.core.flight.phases`).

An agent is lost when its track is lost (`track_lifecycle.TrackConfirmation.is_lost` compares the existence
probability with `lost_existence`), or after `UNSEEN_S` without track and report. It is also lost after
`UNSEEN_S` without report if one sensor alone sees it, and another one misses it (`sensor_contradictions`):
one sensor keeps no crashed vehicle in the picture. The agent is active again only when it reports and is
associated with a track above `REVIVE_EXISTENCE`: clutter near a lost agent does not revive it.

An agent has arrived after `ARRIVAL_EPOCHS` consecutive epochs in which its confirmed track and that of its
target are within the capture radius, outside no-fly zones. Arrival is final until an operator continues the
mission, or closes a zone there (`gcs.core.operator.arrived_agents`).
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping

from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.perception.perception_state import AgentSighting
from gcs.core.perception.track_lifecycle import TrackConfirmation
from gcs.core.state import Agent
from gcs.model import NS_PER_S, AgentStatus, Label, Track

REVIVE_EXISTENCE = 0.9
ARRIVAL_EPOCHS = 2
"""Consecutive epochs within the capture radius."""
UNSEEN_S = 5.0
"""An agent without track and report for this long is lost."""
NEVER_SEEN_S = 20.0
"""The same for an agent that was never seen."""


class AgentStatusMonitor:
    """Statuses of all agents; within `capture_radius_m` an agent has reached its target."""

    def __init__(self, agents: Mapping[int, Agent], zones: NoFlyZones, capture_radius_m: float) -> None:
        self._agents = agents
        self._zones = zones
        self._capture_radius_m = capture_radius_m

    def update(
        self,
        t_ns: int,
        measured_t_ns: int,
        agents: TrackConfirmation,
        targets: TrackConfirmation,
        reporting: set[int],
        seen_by_one: Container[Label] = (),
    ) -> list[AgentStatus]:
        """Update all statuses after one scan; return those that changed.

        Parameters
        ----------
        t_ns, measured_t_ns
            Arrival and measurement time of the scan.
        reporting
            Vehicles with a fresh position report.
        seen_by_one
            Tracks of agents that one sensor alone detects, against another one.
        """
        changed = []
        for vehicle, agent in self._agents.items():
            perception = agent.perception
            label = perception.association.label
            before = perception.status
            sighting = perception.sighting
            track = agents.tracks.get(label) if label is not None else None
            if label is not None or vehicle in reporting:
                sighting.seen_t_ns = t_ns
            if vehicle in reporting:
                sighting.reported_t_ns = t_ns
            if track is not None and track.estimated:
                sighting.position_m = (float(track.mean[0]), float(track.mean[1]))
            route = agent.routes.flown
            target = None if route is None else targets.tracks.get(route.target)
            is_lost = label is not None and agents.is_lost(label)
            is_lost |= label in seen_by_one and _is_silent(t_ns, sighting)
            after = None
            if before.status == "active":
                near = track is not None and target is not None and self._is_at(track, target)
                epochs = sighting.at_target.count(measured_t_ns, holds=near)
                if target is not None and epochs >= ARRIVAL_EPOCHS:
                    after = AgentStatus(t_ns, vehicle, "arrived", target.label, sighting.position_m)
                elif is_lost or _is_unseen(t_ns, sighting):
                    after = AgentStatus(t_ns, vehicle, "lost", None, sighting.position_m)
            elif track is not None and vehicle in reporting and before.status == "lost":
                is_sure = track.existence >= REVIVE_EXISTENCE
                after = AgentStatus(t_ns, vehicle, "active", None, sighting.position_m) if is_sure else None
            if after is not None:
                perception.status = after
                changed.append(after)
        return changed

    def apply(self, status: AgentStatus) -> None:
        """Apply a status that follows from the flight phase of a vehicle."""
        perception = self._agents[status.vehicle].perception
        if status.status == "active" and perception.status.target is not None:
            perception.reached = (*perception.reached, perception.status.target)
        perception.status = status

    def _is_at(self, track: Track, target: Track) -> bool:
        distance_m = math.hypot(track.mean[0] - target.mean[0], track.mean[1] - target.mean[1])
        if not track.estimated or distance_m > self._capture_radius_m:
            return False
        return not self._zones.contain((float(track.mean[0]), float(track.mean[1])))


def _is_silent(t_ns: int, sighting: AgentSighting) -> bool:
    return sighting.reported_t_ns is not None and t_ns - sighting.reported_t_ns > UNSEEN_S * NS_PER_S


def _is_unseen(t_ns: int, sighting: AgentSighting) -> bool:
    if sighting.seen_t_ns is not None:
        return t_ns - sighting.seen_t_ns > UNSEEN_S * NS_PER_S
    if sighting.awaited_t_ns is None:
        sighting.awaited_t_ns = t_ns
    return t_ns - sighting.awaited_t_ns > NEVER_SEEN_S * NS_PER_S
