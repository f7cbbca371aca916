"""The state of the decision core: one tree of plain records.

`gcs.core.engine.Engine.step` alone changes it. Each stage gets the part that it may change.
`gcs.core.snapshot` encodes the whole tree. A snapshot and the events after it are the service.

Everything else in the engine is derived from the mission file and from this tree, or is a cache that changes
no result.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from gcs.core.airspace.airspace_state import AirspaceState
from gcs.core.authority.authority_state import AgentAuthority, AuthorityState
from gcs.core.authority.derived_claims import derived_claims
from gcs.core.flight.flight_state import AgentFlight, FlightState
from gcs.core.operator.operator_state import AgentOrders, OperatorState
from gcs.core.perception.perception_state import AgentPerception, PerceptionState
from gcs.core.preflight.preflight_state import AgentReturn
from gcs.core.replanning.replanning_state import AgentRoutes, ReplanningState
from gcs.core.separation.separation_state import AgentSeparation, SeparationState
from gcs.core.takeoff.takeoff_state import AgentTakeoff, TakeoffState
from gcs.core.tasking.tasking_state import AgentTasking, TaskingState
from gcs.mavlink.fleet.fleet_state import FleetState, VehicleLink
from gcs.mavlink.fleet.notice_queue import RepeatLimit
from gcs.mavlink.fleet.telemetry_table import new_table
from gcs.mavlink.services.terrain_data import TerrainRecord
from gcs.model import AgentStatus, Authority, Claim, Claims, Control, Label, Route


@dataclass(slots=True)
class Agent:
    """Everything that is known and wanted of one vehicle."""

    claims: Claims = field(default_factory=Claims)
    """Recorded claims to it; `control` has the derived ones, too."""
    authority: AgentAuthority = field(default_factory=AgentAuthority)
    link: VehicleLink = field(default_factory=VehicleLink)
    perception: AgentPerception = field(default_factory=AgentPerception)
    flight: AgentFlight = field(default_factory=AgentFlight)
    routes: AgentRoutes = field(default_factory=AgentRoutes)
    tasking: AgentTasking = field(default_factory=AgentTasking)
    takeoff: AgentTakeoff = field(default_factory=AgentTakeoff)
    orders: AgentOrders = field(default_factory=AgentOrders)
    separation: AgentSeparation = field(default_factory=AgentSeparation)
    returns: AgentReturn = field(default_factory=AgentReturn)
    terrain: TerrainRecord = field(default_factory=TerrainRecord)

    @property
    def control(self) -> Control:
        """Who controls the vehicle now."""
        derived = derived_claims(
            self.link, self.authority, self.tasking, self.takeoff, self.orders, self.routes
        )
        return Control(self.claims.begun | {claim: Claim(None, detail) for claim, detail in derived})

    @classmethod
    def initial(cls, vehicle: int) -> Agent:
        """Return the record of a vehicle before the first event."""
        return cls(perception=AgentPerception(status=AgentStatus(0, vehicle, "active")))


def with_status(agents: Mapping[int, Agent], status: str) -> list[int]:
    """Return the agents with a status, in the order of the mission file."""
    return [vehicle for vehicle, agent in agents.items() if agent.perception.status.status == status]


def at_targets(agents: Mapping[int, Agent]) -> Counter[Label]:
    """Return the number of agents that have reached each target, also of those that are down since."""
    return Counter(label for agent in agents.values() for label in reached(agent))


def reached(agent: Agent) -> tuple[Label, ...]:
    """Return the targets that an agent has reached."""
    before = agent.perception.reached
    status = agent.perception.status
    if status.status not in ("arrived", "down") or status.target is None:
        return before
    return (*before, status.target)


def flown_routes(agents: Mapping[int, Agent]) -> dict[int, Route]:
    """Return the routes that vehicles fly, or whose missions are on their way to them, by vehicle."""
    routes = {vehicle: agent.routes.flown for vehicle, agent in sorted(agents.items())}
    return {vehicle: route for vehicle, route in routes.items() if route is not None}


def wanted_routes(agents: Mapping[int, Agent]) -> dict[int, Route]:
    """Return the routes whose missions vehicles get: to targets, else to a circle in a layer."""
    stacked = {vehicle: agent.routes.stacked for vehicle, agent in sorted(agents.items())}
    return {v: route for v, route in stacked.items() if route is not None} | flown_routes(agents)


def without_missions(agents: Mapping[int, Agent]) -> dict[int, str]:
    """Return the vehicles that get no mission now, with the reason in words: not ours, or unable to fly."""
    controls = {vehicle: agent.control for vehicle, agent in agents.items()}
    return {v: control.reason for v, control in controls.items() if control.authority is not Authority.OURS}


@dataclass(slots=True)
class State:
    """The whole state."""

    agents: dict[int, Agent]
    """By vehicle, in the order of the mission file."""
    fleet: FleetState = field(default_factory=FleetState)
    perception: PerceptionState = field(default_factory=PerceptionState)
    replanning: ReplanningState = field(default_factory=ReplanningState)
    tasking: TaskingState = field(default_factory=TaskingState)
    takeoff: TakeoffState = field(default_factory=TakeoffState)
    flight: FlightState = field(default_factory=FlightState)
    authority: AuthorityState = field(default_factory=AuthorityState)
    airspace: AirspaceState = field(default_factory=AirspaceState)
    operator: OperatorState = field(default_factory=OperatorState)
    separation: SeparationState = field(default_factory=SeparationState)
    repeats: RepeatLimit = field(default_factory=RepeatLimit)
    """Notices that were given a moment ago."""
    has_ended: bool = False
    """True after the end of the mission."""
    ended_without_agents: bool = False
    """True if it ended since no agent could fly, before its targets had their agents."""
    measured_t_ns: int = 0
    """Measurement time of the last scan."""
    resumed_t_ns: int | None = None
    """Time of a restart of the service; None once plans are made again."""

    @classmethod
    def initial(cls, vehicles: Iterable[int]) -> State:
        """Return the state before the first event."""
        agents = {vehicle: Agent.initial(vehicle) for vehicle in vehicles}
        return cls(agents, FleetState(new_table(len(agents))))
