"""State of take-offs."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class AgentTakeoff:
    """Take-off of one vehicle."""

    blocked: str = ""
    """Why the climb of the vehicle, which stands on the ground, is not clear: it gets no mission."""
    is_grounded: bool = False
    """True if the vehicle was on the ground when it was last checked."""
    is_climbing: bool = False
    """True from the ground to the lowest altitude layer."""
    traffic: str = ""
    """Vehicle in the air that its climb would meet, in words; empty if there is none."""
    traffic_t_ns: int = 0
    """Time of that check."""
    low_since_t_ns: int | None = None
    """Begin of its take-off while it is lower than 10 m; else None."""
    is_stuck: bool = False
    """True after the warning that it does not lift off, until it does or is stopped."""
    is_waiting: bool = False
    """True while its take-off waits for that of another vehicle."""


@dataclass(slots=True)
class TakeoffState:
    """What belongs to no single vehicle."""

    next_check_t_ns: int = 0
    """Next time at which take-offs are checked."""
    close_pairs: list[tuple[int, int]] = field(default_factory=list)
    """Vehicles that climb near each other, in order; an alarm has been raised."""
