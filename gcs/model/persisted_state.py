"""Persisted state: what a service needs to continue after a restart."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.model.basics import FloatArray, Label
from gcs.model.control import Suspension
from gcs.model.effects import AgentStatus
from gcs.model.orders import NoFlyZone
from gcs.model.plans import Route


@dataclass(frozen=True, slots=True)
class PersistedAuthority:
    """Who chose the mode that a vehicle was in (`gcs.mavlink.fleet.mode_authority`)."""

    mode: str
    taken: str
    ordered: str
    tasked: bool


@dataclass(frozen=True, slots=True)
class ExternalMission:
    """A mission that another ground station uploads, or has uploaded, to a vehicle."""

    system_id: int
    """Of the ground station."""
    component_id: int
    station: str
    """Name of the ground station for operators."""
    ended: bool
    """True if the upload was accepted, refused, or broke off."""


@dataclass(frozen=True, slots=True)
class PersistedVehicle:
    """Persisted state of one vehicle."""

    status: AgentStatus
    suspension: Suspension | None
    route: Route | None
    """The route that it flies, or flew before it was suspended."""
    items: tuple[tuple[float | None, ...], ...]
    """Mission items that it stores, by the last read-back; none when that is not known. None is NaN."""
    first_point: int
    """Number of the item that is the route's first point."""
    may_be_inconsistent: bool
    """True if an upload was in progress or broke off: its mission may be inconsistent."""
    authority: PersistedAuthority | None = None
    external_mission: ExternalMission | None = None
    """The mission of another ground station that it holds; None: it holds ours."""
    track: Label | None = None
    """Label of its track."""
    is_obsolete: bool = False
    """True if the vehicle stores the route, and was not to fly it any more."""


@dataclass(frozen=True, slots=True)
class PersistedFilter:
    """Posterior of a GLMB filter; the arrays are those of `gcs.tracking.glmb.recursion.Posterior`."""

    t_ns: int | None
    """Time of the last scan; None before the first."""
    scans: int
    rng: int
    """State of the Gibbs sampler's random generator."""
    first: tuple[int, ...]
    start: tuple[int, ...]
    items: tuple[int, ...]
    logw: FloatArray
    track_label: tuple[int, ...]
    labels: tuple[Label, ...]
    mean: FloatArray
    cov: FloatArray
    turn: FloatArray
    is_certain: tuple[bool, ...]


@dataclass(frozen=True, slots=True)
class Confirmation:
    """Confirmation of one label."""

    label: Label
    count: int
    """Consecutive epochs in the estimate; negative: out of it."""
    is_confirmed: bool


@dataclass(frozen=True, slots=True)
class PersistedTracker:
    """Tracker of one kind."""

    filter: PersistedFilter
    birth_probabilities: tuple[float, ...]
    """Probability of each birth component of the mission."""
    confirmations: tuple[Confirmation, ...]


@dataclass(frozen=True, slots=True)
class PersistedTrackers:
    """Trackers of agents and targets after the last scan."""

    agents: PersistedTracker
    targets: PersistedTracker
    measured_t_ns: int
    """Time of the last scan; older scans are refused."""
    sensors: tuple[str, ...]
    """Sensors with a scan of that time."""


@dataclass(frozen=True, slots=True)
class PersistedState:
    """What a service needs to continue after a restart."""

    t_ns: int
    mission_count: int
    """Number of missions made so far."""
    plan_count: int
    """Number of the last plan that was proposed to an operator."""
    ended: bool
    vehicles: tuple[PersistedVehicle, ...]
    trackers: PersistedTrackers
    no_fly_zones: tuple[NoFlyZone, ...]
