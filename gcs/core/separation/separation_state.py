"""State of separation: alarms, avoidance, waiting missions, other aircraft."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.mavlink.services.command_sender import CommandSender


@dataclass(slots=True)
class Avoidance:
    """Hold of a vehicle that would come near another one, or fly into a no-fly zone."""

    other: str
    """That vehicle, aircraft or zone, in words."""
    since_t_ns: int
    is_before_zone: bool = False
    next_check_t_ns: int = 0
    sender: CommandSender | None = None
    """Command to hold, or to fly on."""
    is_ending: bool = False
    """True from the command to fly on."""


@dataclass(frozen=True, slots=True)
class FirstClimb:
    """Climb in a circle, from where the mission was begun in the air, to the height of its first point."""

    east_m: float
    north_m: float
    """Centre of the circle."""
    height_msl_m: float


@dataclass(slots=True)
class AgentSeparation:
    """Turn and climb of one vehicle, from its reports."""

    t_ns: int = 0
    """Time of the newest course."""
    course_rad: float = 0.0
    rate_rad_s: float = 0.0
    """Positive to the right; 0 if unknown."""
    climb_gradient: float = 0.0
    """Vertical speed by ground speed in its last take-off; 0 before that."""
    hold_m: tuple[float, float] | None = None
    """Place where LOITER was seen first: the centre of its circle; None in other modes."""
    mode: str = ""
    """Mode at the last check."""
    first_climb: FirstClimb | None = None
    """Climb of a PX4 to the first point of its mission; it goes on if it is set to LOITER. None: no such."""
    radius_m: float = 0.0
    """Radius of the last circle that it flew in LOITER or RTL, negative to the left; 0 if unknown."""
    landing_t_ns: int = 0
    """Time of its landing as planned; 0 before that."""
    landing_wait_m: tuple[float, float] | None = None
    """Place where it waits for that time on a circle; None if it does not."""
    traffic: str = ""
    """Vehicle that its queued mission would lead it near to, in words; empty if there is none."""
    traffic_t_ns: int = 0
    """Time of that check."""
    avoidance: Avoidance | None = None
    circle_searched_t_ns: int = 0
    """Time of the last search for a circle clear of a vehicle that is not steered; 0 before that."""
    circle_search: int = 0
    """Number of that search, from 0 in each encounter."""
    waits_since_t_ns: int | None = None
    """Begin of the wait of its queued mission; None if it need not wait."""


@dataclass(slots=True)
class Approach:
    """Two vehicles that come, or are, too near to each other."""

    stage: int
    """Number of warning times that are past; one more after the loss of separation."""
    seen_t_ns: int
    """Last check that found it."""
    nearest_m: float | None = None
    """Least horizontal distance in a loss of separation; None before that."""
    nearest_height_m: float = 0.0
    """Difference in height there."""
    avoided_t_ns: int | None = None
    """Begin of the last hold of one of them."""
    name: str = ""
    """Aircraft of the pair, in words; empty for two of our vehicles."""


@dataclass(frozen=True, slots=True)
class Aircraft:
    """Newest report of an aircraft that is not ours."""

    t_ns: int
    """Time of its position."""
    east_m: float
    north_m: float
    alt_msl_m: float
    speed_m_s: float
    course_rad: float
    climb_m_s: float
    height_error_m: float
    callsign: str


@dataclass(slots=True)
class SeparationState:
    """What belongs to no single vehicle."""

    next_check_t_ns: int = 0
    approaches: dict[tuple[int, int], Approach] = field(default_factory=dict)
    """By pair of vehicles, the lower one first."""
    aircraft: dict[int, Aircraft] = field(default_factory=dict)
    """By number (`gcs.core.separation.aircraft`)."""
    mission_checks: int = 0
    """New missions that were checked against traffic at `mission_checks_t_ns`."""
    mission_checks_t_ns: int = 0
