"""What a service must know to take up where an earlier one was."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs.model.effects import AgentStatus
from gcs.model.orders import NoFlyZone
from gcs.model.picture import Track
from gcs.model.plans import Route

Aside: TypeAlias = Literal["hold", "return", "found"]
"""Why a vehicle is not tasked: ordered to hold or to return, or found with a mission of somebody else's."""


@dataclass(frozen=True, slots=True)
class PersistedAuthority:
    """Who chose the mode that a vehicle was in (`gcs.mavlink.fleet.mode_authority`)."""

    mode: str
    taken: str
    ordered: str
    tasked: bool


@dataclass(frozen=True, slots=True)
class ExternalMission:
    """A mission that another ground station writes, or wrote, to a vehicle of ours."""

    system_id: int
    """The station's."""
    component_id: int
    words: str
    """Who that is, to be shown."""
    ended: bool
    """Whether the upload had an end: it was taken, refused, or broke off."""


@dataclass(frozen=True, slots=True)
class PersistedVehicle:
    """What the service knew of one vehicle."""

    fate: AgentStatus
    aside: Aside | None
    route: Route | None
    """What it flies; of a vehicle that is set aside, what it flew."""
    items: tuple[tuple[float | None, ...], ...]
    """Mission items that it stores, by the last read-back; none when that is not known. None is NaN."""
    first_point: int
    """Number of the item that is the route's first point."""
    unsure: bool
    """Whether a transfer was under way, or left a mix behind: it may hold one."""
    custody: PersistedAuthority | None = None
    """None in what was written before this was remembered."""
    guest: ExternalMission | None = None
    """Whose mission it holds, when not ours."""
    spare: bool = False
    """Whether the route is only what it stores: it was not to be flown any more."""


@dataclass(frozen=True, slots=True)
class PersistedState:
    """What a service must know to take up where an earlier one was."""

    t_ns: int
    missions: int
    """Missions that were made so far."""
    plans: int
    """Number of the last plan that was put to an operator."""
    ended: bool
    vehicles: tuple[PersistedVehicle, ...]
    targets: tuple[Track, ...]
    """Believed then."""
    keep_outs: tuple[NoFlyZone, ...]
