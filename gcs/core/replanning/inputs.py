"""What a plan is made from, at one moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs.core.perception.vehicle_kinematics import motion_of
from gcs.model import Label, Track
from gcs.planning.map.grid import Point
from gcs.planning.terminal.climb import Climb
from gcs.planning.vehicle_model import Motion


@dataclass(frozen=True, slots=True)
class OtherVehicle:
    """A vehicle in the air that is held, returns, or is flown by somebody else."""

    vehicle: int
    place_m: Point
    to_m: Point
    """Where it flies: home when it returns, else where it is."""
    height_m: float
    """Above home."""


@dataclass(frozen=True, slots=True)
class PlanningInputs:
    """What a plan is made from, at one moment."""

    t_ns: int
    picture_t_ns: int
    agents: Mapping[int, Track]
    """Track of each flying vehicle that is tied to one."""
    targets: Mapping[Label, Track]
    """Believed targets that need somebody."""
    arrived: frozenset[int]
    """Vehicles that have done their work."""
    at_targets: Mapping[Label, int] = field(default_factory=dict)
    """How many of them are at each target that needs more."""
    lost: frozenset[int] = frozenset()
    """Vehicles whose status is lost."""
    untaskable: Mapping[int, str] = field(default_factory=dict)
    """Vehicles that fly but are not ours to task, and why, in words."""
    motions: Mapping[int, Motion] = field(default_factory=dict)
    """How agents move; who is not among them flies as its track does."""
    late_s: Mapping[int, float] = field(default_factory=dict)
    """Upload time beyond that of a good link (`gcs.core.tasking.upload_latency`)."""
    left_s: Mapping[int, float] = field(default_factory=dict)
    """Until vehicles fly the mission that is under way to them."""
    climbs: Mapping[int, Climb] = field(default_factory=dict)
    """What agents on the ground, or in their take-off, fly before their routes."""
    other_vehicles: tuple[OtherVehicle, ...] = ()
    """Vehicles in the air that are not planned for: routes of others keep clear of them."""
    passed: frozenset[int] = frozenset()
    """Vehicles that wait where their routes led them after they passed their targets."""

    def motion(self, vehicle: int) -> Motion:
        """How an agent moves; at the end of its climb, if it has one before it."""
        if vehicle in self.climbs:
            return self.climbs[vehicle].motion
        return self.motions.get(vehicle) or motion_of(self.agents[vehicle], self.t_ns - self.picture_t_ns)
