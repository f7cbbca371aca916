"""What a planner is asked: where agents begin, what targets need, and how to plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gcs.planning.assignment import Objective
from gcs.planning.map.grid import Point
from gcs.planning.path.shortcut import Shape
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.search.shortest import SearchCost
from gcs.planning.vehicle_model import Motion


@dataclass(frozen=True, slots=True)
class AgentState:
    """Where an agent's route begins, its course over ground if that is known, how fast it flies, and when."""

    east_m: float
    north_m: float
    course_rad: float | None = None
    speed_m_s: float = 15.0
    start_delay_s: float = 0.0
    """It begins so long after targets are where they are said to be."""
    motion: Motion | None = None
    """How it moves when it takes the route up, if that is known better; its turn begins a little later."""


@dataclass(frozen=True, slots=True)
class TargetDemand:
    """What is asked of the agents at a target, and how it moves."""

    velocity_m_s: Point = (0.0, 0.0)
    """East and north."""
    rank: int = 0
    """Targets of lower rank are served before all others."""
    agents: int = 1
    """How many it needs."""


@dataclass(frozen=True, slots=True)
class LoiterSpec:
    """What agents do at the end of a route, and how near to a target they have reached it."""

    radius_m: float
    """Of the circle that they fly."""
    reach_radius_m: float
    """From a target; two moments within it count."""
    turn_lag_s: float
    """Until a turn is taken up."""
    turns: TurnAnticipation
    """How early they turn at the corners on the way."""


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """How to plan.

    Attributes
    ----------
    search_cost : "metric" or "paper"
        Shortest paths, or the paper's cost of nodes traversed plus Euclidean heuristic.
    shape : "grid", "pulled" or "flyable"
        Legs along the grid, or pulled taut by line of sight, or with turns that can be flown besides.
    turn_radius_m : float
        Least radius of the turns of a flyable route.
    horizon_s : float
        How far ahead targets that move are met; 0: routes end where targets are.
    cost : "length" or "arrival"
        What the assignment adds up: metres flown, or times until agents arrive.
    objective : "total" or "longest"
        Whether the sum of these is made small, or the greatest of them.
    spare : "hold" or "double"
        What agents do that no target needs: nothing, or fly to targets besides those who do already.
    clearance_m : float
        Distance to keep from blocked cells, unless there is no way that does or only a long detour.
    switch_gain_m : float
        By how much agents that exchange targets must shorten the team's way.
    wait : Wait or None
        How agents wait at the ends of flyable routes; None: nobody looks whether there is room for it.
    """

    search_cost: SearchCost = "metric"
    shape: Shape = "grid"
    clearance_m: float = 0.0
    switch_gain_m: float = 0.0
    turn_radius_m: float = 40.0
    horizon_s: float = 0.0
    cost: Literal["length", "arrival"] = "length"
    objective: Objective = "total"
    surplus: Literal["hold", "double"] = "hold"
    loiter: LoiterSpec | None = None
