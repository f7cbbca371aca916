"""Flight phase and health of one vehicle: what a pilot would know of it from its own telemetry.

The phase changes by events that one observation of the telemetry gives (`gcs.core.flight.phases`), and by the
operator's order that a vehicle is ready again. One table has all transitions. A vehicle that stands on the
ground after a flight has landed, or is down: it came to the ground elsewhere than by a planned landing.
"""

from __future__ import annotations

from enum import Enum
from typing import Final, Literal, TypeAlias

FlightPhaseWord: TypeAlias = Literal[
    "unknown",
    "on the ground",
    "taking off",
    "en route",
    "at its target",
    "returning",
    "landing",
    "landed",
    "down",
]
"""Flight phase of a vehicle, for operators."""


class FlightPhase(Enum):
    """Flight phase of a vehicle."""

    UNKNOWN = "unknown"
    """Before its first position and mode."""
    ON_GROUND = "on the ground"
    """Before its flight."""
    TAKING_OFF = "taking off"
    EN_ROUTE = "en route"
    """In the air, and in none of the following phases."""
    AT_TARGET = "at its target"
    """On the loiter circle at the end of its route."""
    RETURNING = "returning"
    LANDING = "landing"
    LANDED = "landed"
    """On the ground after a planned landing."""
    DOWN = "down"
    """On the ground elsewhere, or by a crash."""

    @property
    def is_in_air(self) -> bool:
        """True in flight."""
        return self in _IN_AIR

    @property
    def has_flown(self) -> bool:
        """True on the ground after a flight, until an operator orders that the vehicle is ready."""
        return self in (FlightPhase.LANDED, FlightPhase.DOWN)


_IN_AIR: Final = frozenset(
    {
        FlightPhase.TAKING_OFF,
        FlightPhase.EN_ROUTE,
        FlightPhase.AT_TARGET,
        FlightPhase.RETURNING,
        FlightPhase.LANDING,
    }
)


class FlightEvent(Enum):
    """Event that may change the phase; the values are words for the documentation."""

    STANDS = "stands"
    """On the ground, and not seen higher than a low obstacle since it last stood."""
    TOUCHED_DOWN = "planned touchdown"
    CAME_DOWN = "touchdown elsewhere"
    CLIMBS = "climbs from the ground"
    FLIES = "flies"
    CIRCLES = "circles at its target"
    RETURNS = "returns"
    LANDS = "lands"
    READY = "ready"
    """An operator ordered that the vehicle is ready to fly again."""


_P = FlightPhase
_E = FlightEvent
_AIRBORNE: Final = {
    _E.CLIMBS: _P.TAKING_OFF,
    _E.FLIES: _P.EN_ROUTE,
    _E.CIRCLES: _P.AT_TARGET,
    _E.RETURNS: _P.RETURNING,
    _E.LANDS: _P.LANDING,
}
_GROUNDED: Final = {_E.STANDS: _P.ON_GROUND, _E.TOUCHED_DOWN: _P.LANDED, _E.CAME_DOWN: _P.DOWN}
PHASE_TRANSITIONS: Final[dict[FlightPhase, dict[FlightEvent, FlightPhase]]] = {
    _P.UNKNOWN: {
        **_AIRBORNE,
        _E.STANDS: _P.ON_GROUND,
        _E.TOUCHED_DOWN: _P.ON_GROUND,
        _E.CAME_DOWN: _P.ON_GROUND,
    },
    _P.ON_GROUND: _AIRBORNE,
    _P.TAKING_OFF: {**_AIRBORNE, **_GROUNDED},
    _P.EN_ROUTE: {**_AIRBORNE, **_GROUNDED},
    _P.AT_TARGET: {**_AIRBORNE, **_GROUNDED},
    _P.RETURNING: {**_AIRBORNE, **_GROUNDED},
    _P.LANDING: {**_AIRBORNE, **_GROUNDED},
    _P.LANDED: {**_AIRBORNE, _E.READY: _P.ON_GROUND},
    _P.DOWN: {**_AIRBORNE, _E.READY: _P.ON_GROUND},
}
"""The phase after each event; an event without an entry changes nothing."""


class HealthItem(Enum):
    """Part of a vehicle whose health is watched, with its word."""

    GPS = "GPS"
    GPS_POSITION = "GPS position"
    ESTIMATE = "attitude and position estimate"
    AIRSPEED = "airspeed sensor"
    PROPULSION = "propulsion"
    BATTERY = "battery"
    RC = "RC receiver"
    FENCE = "fence"
    WIND = "wind"
