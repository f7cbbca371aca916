"""Persisted state: what a service needs to continue after a restart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs.model.effects import AgentStatus
from gcs.model.orders import NoFlyZone
from gcs.model.picture import Track
from gcs.model.plans import Route

Suspension: TypeAlias = Literal["hold", "return", "found"]
"""Why a vehicle is suspended: ordered to hold or to return, or found with a mission that is not ours."""


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
    is_obsolete: bool = False
    """True if the vehicle stores the route, and was not to fly it any more."""


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
    targets: tuple[Track, ...]
    """Confirmed tracks."""
    no_fly_zones: tuple[NoFlyZone, ...]
