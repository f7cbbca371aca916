"""State of the flight phases and of the health of vehicles."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.model import FlightPhase, HealthItem


@dataclass(slots=True)
class HealthProblem:
    """Problem of one part of a vehicle."""

    cause: str
    """Cause in words; it may change while the problem lasts."""
    since_t_ns: int
    seen_ns: int = 0
    """Time for which it was seen; gaps do not count."""
    is_told: bool = False
    """True once the operator was notified."""
    good_since_t_ns: int | None = None
    """Time since when it is not seen any more; None while it is."""


@dataclass(slots=True)
class AgentFlight:
    """Flight phase and health of one vehicle."""

    phase: FlightPhase = FlightPhase.UNKNOWN
    since_t_ns: int = 0
    """Begin of the phase."""
    highest_m: float = 0.0
    """Greatest height above its home since it last stood on the ground."""
    grounded_since_t_ns: int | None = None
    """Time since when it is on the ground; None in the air."""
    airborne_since_t_ns: int | None = None
    """Time since when it is in the air; None on the ground."""
    is_landing_planned: bool = False
    """True if a touchdown at its last position in the air would be a planned landing."""
    sinks_since_t_ns: int | None = None
    """Time since when it sinks below its planned height; None if it does not."""
    sank_t_ns: int = 0
    """Last time at which it sank below its planned height."""
    is_sinking: bool = False
    """True after the alarm that it sinks, until it does not."""
    problems: dict[HealthItem, HealthProblem] = field(default_factory=dict)
    """Problems of its parts, told or about to be."""
    unfit: str = ""
    """Problems that do not allow another target, in words; empty if it is fit."""
    sensors_good: int = 0
    """MAV_SYS_STATUS_SENSOR bits that were enabled and healthy in this flight."""
    battery_begin: tuple[int, int] | None = None
    """Time and charge in percent at which its use of the battery is measured from; None on the ground."""
    endurance_s: float | None = None
    """Time that it can fly until its battery is critical; None before its use of the battery is known."""
    texts: list[tuple[int, str]] = field(default_factory=list)
    """Time and text of its last messages about a failsafe, the oldest first."""


@dataclass(slots=True)
class FlightState:
    """What belongs to no single vehicle."""

    next_check_t_ns: int = 0
    """Time of the next check of all phases."""
    next_health_t_ns: int = 0
    """Time of the next check of the health of all vehicles."""
