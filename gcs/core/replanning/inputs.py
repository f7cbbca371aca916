"""Inputs of a plan as a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs.core.perception.vehicle_kinematics import motion_of
from gcs.core.replanning.replanning_state import OtherVehicle
from gcs.model import Label, Track
from gcs.planning.forward_simulation import Motion
from gcs.planning.manoeuvres.climb import Climb
from gcs.planning.map.grid import Point


@dataclass(frozen=True, slots=True)
class PlanningInputs:
    """Inputs of a plan at one time."""

    t_ns: int
    picture_t_ns: int
    agents: Mapping[int, Track]
    """Track of each active agent."""
    targets: Mapping[Label, Track]
    """Confirmed targets that need more agents."""
    arrived: frozenset[int]
    """Agents that have arrived."""
    at_targets: Mapping[Label, int] = field(default_factory=dict)
    """Number of arrived agents, by target."""
    priorities: Mapping[Label, int] = field(default_factory=dict)
    """Priorities of targets by order; without an entry that of the mission file."""
    ignored: frozenset[Label] = frozenset()
    """Targets that are ignored by order."""
    lost: frozenset[int] = frozenset()
    """Lost agents."""
    down: frozenset[int] = frozenset()
    """Agents that came down."""
    unfit: frozenset[int] = frozenset()
    """Agents whose health allows no other target; theirs go to others where there are any."""
    grounded: frozenset[int] = frozenset()
    """Agents on the ground: those in the air go first."""
    doubtful: frozenset[int] = frozenset()
    """Agents that rejected their last mission: all others go first."""
    ranges: Mapping[int, tuple[Point, float]] = field(default_factory=dict)
    """Home of each agent whose use of the battery is known, and the distance in metres that it can fly."""
    untaskable: Mapping[int, str] = field(default_factory=dict)
    """Vehicles that must not be tasked, with the reason in words."""
    motions: Mapping[int, Motion] = field(default_factory=dict)
    """Motion of agents; without an entry that of the track."""
    heights_msl_m: Mapping[int, float] = field(default_factory=dict)
    """Height above mean sea level of each agent, or at the end of its climb; over terrain only."""
    climbing_first: frozenset[int] = frozenset()
    """Agents that would climb in a circle to the first point of a mission."""
    late_s: Mapping[int, float] = field(default_factory=dict)
    """Upload time beyond that of a good link (`gcs.core.tasking.upload_latency`)."""
    left_s: Mapping[int, float] = field(default_factory=dict)
    """Remaining time of each upload in progress."""
    climbs: Mapping[int, Climb] = field(default_factory=dict)
    """Climbs of agents on the ground, or in their take-off."""
    other_vehicles: tuple[OtherVehicle, ...] = ()
    """Vehicles in the air that are not planned for; routes keep clear of them."""
    passed: frozenset[int] = frozenset()
    """Agents that have passed their targets without reaching them."""

    def motion(self, vehicle: int) -> Motion:
        """Return the motion of an agent, or that at the end of its climb."""
        if vehicle in self.climbs:
            return self.climbs[vehicle].motion
        return self.motions.get(vehicle) or motion_of(self.agents[vehicle], self.t_ns - self.picture_t_ns)
