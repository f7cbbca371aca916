"""Status of the swarm: what an operator needs to know of each agent, target and sensor at one time.

`gcs status --json`, zenoh, `/api/status` and the console's page get these records. Numbers are rounded to
what a display shows. Positions are east and north in the mission's local frame.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from gcs.model.authority import AuthorityWord
from gcs.model.basics import Label
from gcs.model.flight_phase import FlightPhaseWord

SensorState: TypeAlias = Literal["", "late", "silent"]
"""Empty if scans come in time; `silent` while the alarm about that is raised."""


class AgentRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One agent."""

    vehicle: int
    status: Literal["active", "arrived", "lost", "down"]
    authority: AuthorityWord
    reason: str
    """Why it is not ours, in words; empty if it is."""
    heard_age_s: float | None
    """Time since its last frame; None: never heard."""
    is_late: bool = False
    """True if it was not heard for some time, or never."""
    loss: float
    """Fraction of its frames that did not arrive."""
    mode: str
    armed: bool
    battery_percent: int | None
    is_battery_low: bool = False
    """True if its charge is known and below the limit of its alarm."""
    fix_type: int | None
    """GPS_FIX_TYPE."""
    position_m: tuple[float, float] | None
    """Reported position; None before its first one."""
    course_rad: float | None = None
    """Reported course over ground, clockwise from north."""
    alt_rel_m: float | None
    """Reported height above its home."""
    alt_msl_m: float | None = None
    """Reported height above mean sea level."""
    agl_m: float | None = None
    """Height above the ground below it, by the elevation model; None without one."""
    ground_speed_m_s: float | None
    is_position_doubted: bool
    """True if an integrity warning about its reports is open."""
    lost_at_m: tuple[float, float] | None = None
    """Position at which it was last seen, if it is lost or down."""
    track: Label | None
    """Label of its track."""
    existence: float
    """Existence probability of its track; 0 without one."""
    layer: int
    """Altitude layer of its route."""
    target: Label | None
    """Target that it flies to, or that it reached."""
    to_go_m: float | None
    """Length of the rest of its climb and route."""
    eta_s: float | None
    """Flight time of the rest of its route, at its ground speed; on the ground that of take-off and route."""
    upload: str
    """Stage of its upload: empty for none, else such as "waiting" or "read-back"."""
    has_failed: bool
    """True if its last upload failed."""
    is_verified: bool
    """True if its onboard mission is known, and read back equal."""
    phase: FlightPhaseWord = "unknown"
    problems: tuple[str, ...] = ()
    """Health problems that the operator was notified of, in words."""
    points_passed: int = 0
    """Number of points of its route that it has passed."""
    proposed_target: Label | None = None
    """Target of the route that waits for approval."""
    pinned: Label | None = None
    """Target that it is to fly to, by order."""


class TargetRecord(msgspec.Struct, frozen=True):
    """One confirmed target."""

    label: Label
    existence: float
    """Existence probability of its track."""
    position_m: tuple[float, float]
    speed_m_s: float
    agents: tuple[int, ...]
    """Agents on their way to it."""
    reached_by: tuple[int, ...]
    is_ignored: bool = False
    """True if no vehicle flies to it, by order."""
    priority: int | None = None
    """Priority by order; None: that of the mission file."""
    pinned: tuple[int, ...] = ()
    """Vehicles that are to fly to it, by order."""


class SensorRecord(msgspec.Struct, frozen=True):
    """One sensor."""

    name: str
    scan_age_s: float | None
    """Time since its last processed scan; None: no scan was processed."""
    refused: int
    """Scans refused since then."""
    state: SensorState = ""


class SwarmStatus(msgspec.Struct, frozen=True):
    """Status of all agents, targets and sensors; the answer to the command `status`."""

    t_ns: int
    order_id: str
    agents: tuple[AgentRecord, ...]
    """Ordered by vehicle."""
    targets: tuple[TargetRecord, ...]
    sensors: tuple[SensorRecord, ...]
    plan_id: int | None
    """Number of the plan that waits for approval; None: no plan waits."""
    has_ended: bool
    """True after the end of the mission."""
    terrain: str = "flat"
    """Elevation model and flight band in words, or "flat"."""
