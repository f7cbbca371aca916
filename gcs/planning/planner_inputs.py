"""Inputs of the planner: agent states, target demands and options; all inputs of a mission's plan."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from gcs.model import Label
from gcs.planning.forward_simulation import Motion
from gcs.planning.map.grid import Grid, Point
from gcs.planning.path.path_shaping import Shape
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.terrain.ground import Terrain


@dataclass(frozen=True, slots=True)
class AgentState:
    """State of an agent where its route begins."""

    east_m: float
    north_m: float
    course_rad: float | None = None
    speed_m_s: float = 15.0
    start_delay_s: float = 0.0
    """Time from the epoch of the target positions to the start of the route."""
    motion: Motion | None = None
    """Predicted motion at route capture, if known. The explicit first turn begins a little later."""
    options: PlanOptions | None = None
    """Options of its own airframe: turns and terminal loiter; None: those of the plan."""
    height_msl_m: float = math.nan
    """Height there above mean sea level; used over terrain only."""
    climbs_first: bool = False
    """True if it would climb in a circle to the first point of a mission; used over terrain only."""
    is_grounded: bool = False
    """True on the ground: agents in the air get targets first."""
    is_doubtful: bool = False
    """True if it rejected its last mission: all other agents get targets first."""
    pinned: Label | None = None
    """Target that it must get, if that is there and a path leads to it."""
    settled: Label | None = None
    """Target to which it keeps the route that it has, if it gets that target: no other route is shaped."""
    layer: int = 0
    """Altitude layer whose heights its route prefers; used over terrain only."""
    is_unfit: bool = False
    """True if it may keep its target where no other agent can take it, and gets no other."""
    home_m: Point = (0.0, 0.0)
    wind_m_s: Point = (0.0, 0.0)
    """East and north, as it reports it: for times along its route."""
    range_m: float = math.inf
    """Distance that its battery lets it fly; its home must be within reach from its target."""


@dataclass(frozen=True, slots=True)
class TargetDemand:
    """Number of agents that a target needs, its rank and its velocity."""

    velocity_m_s: Point = (0.0, 0.0)
    """East and north."""
    rank: int = 0
    """Targets of lower rank are served first."""
    agents: int = 1
    """Number of agents needed."""


@dataclass(frozen=True, slots=True)
class LoiterSpec:
    """Loiter at the end of a route, and the distance at which a target counts as reached."""

    radius_m: float
    """Loiter radius."""
    reach_radius_m: float
    """Capture radius around a target. Two epochs within it count as an arrival."""
    turn_lag_s: float
    """Delay until a commanded turn rate is reached."""
    turns: TurnAnticipation
    """Turn anticipation at the waypoints."""
    is_left: bool = False
    """True if the vehicle only needs the room, and flies on to its landing."""


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """Options of a plan.

    Attributes
    ----------
    shape : "grid", "pulled" or "flyable"
        Legs along the grid, string-pulled legs, or string-pulled legs with turns of `turn_radius_m`.
    clearance_m : float
        Distance to keep from blocked cells. Given up where no path keeps it, or only a long detour does.
    switch_gain_m : float
        Gain in total length that a swap of two targets needs, beside a small fraction of the total.
    turn_radius_m : float
        Minimum turn radius of a flyable route.
    horizon_s : float
        Prediction horizon for moving targets. 0: routes end at the current target positions.
    cost : "length" or "arrival"
        Assignment cost: metres flown, or times of arrival.
    loiter : LoiterSpec or None
        Terminal loiter of flyable routes. None: the end of a route is not checked.
    turns : TurnAnticipation or None
        Turn anticipation at waypoints, for the captures of flyable routes. None: no capture is simulated.
    turn_lag_s : float
        Delay until a commanded turn rate is reached.
    climb_gradient, sink_gradient : float
        Greatest height gained or lost per distance over ground; used over terrain only.
    """

    shape: Shape = "grid"
    clearance_m: float = 0.0
    switch_gain_m: float = 0.0
    turn_radius_m: float = 40.0
    horizon_s: float = 0.0
    cost: Literal["length", "arrival"] = "length"
    loiter: LoiterSpec | None = None
    turns: TurnAnticipation | None = None
    turn_lag_s: float = 0.0
    climb_gradient: float = 0.1
    sink_gradient: float = 0.1


@dataclass(frozen=True, slots=True)
class MissionInputs:
    """Inputs of `planner.plan_mission`.

    Attributes
    ----------
    grid : Grid
    options : PlanOptions
    layers : int
        Number of altitude layers.
    separation_m : float
        Minimum distance of two vehicles in one layer.
    agents : mapping of int to AgentState
    targets : mapping of label to (float, float)
        East and north.
    preferred_layers : mapping of int to int
        Layer of each agent, if it is free.
    begins_m : mapping of int to positions
        Where an agent is, and the end of its climb; without an entry the position of its `AgentState`.
    flown_to : mapping of int to label
        Assignment that is being flown. Vehicles and targets that are gone are ignored.
    demands : mapping of label to TargetDemand
        Targets that need more than one agent, have a rank, or move.
    terrain : Terrain or None
        Ground that routes keep above, at heights of their own; None: the ground is flat.
    min_height_m : float
        Difference in height from which two vehicles over terrain are separated.
    """

    grid: Grid
    options: PlanOptions
    layers: int
    separation_m: float
    agents: Mapping[int, AgentState]
    targets: Mapping[Label, Point]
    preferred_layers: Mapping[int, int]
    begins_m: Mapping[int, Sequence[Point]] = field(default_factory=dict)
    flown_to: Mapping[int, Label] = field(default_factory=dict)
    demands: Mapping[Label, TargetDemand] = field(default_factory=dict)
    terrain: Terrain | None = None
    min_height_m: float = 0.0
