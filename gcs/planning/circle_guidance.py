"""L1 guidance to a loiter circle and round it (ArduPlane, `AP_L1_Control::update_loiter`).

From afar a vehicle flies straight to the centre, until the circle needs a harder turn: that of a damped
oscillator in the distance from the circle, with the centripetal acceleration added. A vehicle that begins a
circle at its centre flies outwards first, and turns later.
"""

from __future__ import annotations

import math
from typing import Final

L1_S: Final = 3.6
"""T1 by default: NAVL1_DAMPING NAVL1_PERIOD / pi, 0.75 times 15 s / pi."""
L1_TURN: Final = 0.59
"""1 / (4 damping^2), and a quarter of the turn rate lost by slip, as in recorded flights of ArduPlane."""
_DAMPING: Final = 0.75
_SLIP_SHARE: Final = 0.75
"""Share of the demanded turn rate that is left after slip, as in `L1_TURN`."""
_WIDENING_S2: Final = (1.0 / _SLIP_SHARE - 1.0) * (0.5 * L1_S / _DAMPING) ** 2
"""Widening of a circle by slip: (flown radius - commanded radius) times flown radius, by airspeed^2."""
_CENTRE_M: Final = 0.1
"""Distance from the centre within which a vehicle counts as flying straight away from it."""


def l1_circle_rate(
    dx: float,
    dy: float,
    course: float,
    ground: float,
    speed: float,
    radius: float,
    l1_s: float,
    loop_s: float,
) -> float:
    """Return the turn rate by which L1 flies to a circle and round it, clockwise, in rad/s.

    Parameters
    ----------
    dx, dy : float
        Place, east and north of the centre, in metres.
    course, ground, speed : float
        Course and speed over ground, and airspeed, in rad and m/s.
    radius : float
        Commanded radius, in metres.
    l1_s, loop_s : float
        T1, and the time constant of the turn to the centre from afar.
    """
    gap = math.hypot(dx, dy)
    outwards = ground
    around = 0.0
    if gap > _CENTRE_M:
        outwards = ground * (math.sin(course) * dx + math.cos(course) * dy) / gap
        around = ground * (math.sin(course) * dy - math.cos(course) * dx) / gap
    to_centre = min(max(math.atan2(around, -outwards), -0.5 * math.pi), 0.5 * math.pi)
    straight = math.sin(to_centre) / loop_s * ground / speed
    omega = 2.0 * _DAMPING / l1_s
    back = (gap - radius) * omega * omega + outwards * 2.0 * _DAMPING * omega
    if outwards > 0.0 and around < 0.0:
        back = max(back, 0.0)
    circling = _SLIP_SHARE * (back + around * around / max(gap, 0.5 * radius)) / speed
    return min(straight, circling) if gap > radius else circling


def commanded_radius_m(flown_m: float, speed_m_s: float) -> float:
    """Return the commanded radius of a circle, which slip makes wider in flight; the sign is kept.

    Parameters
    ----------
    flown_m : float
        Radius of the flown circle, in metres.
    speed_m_s : float
        Airspeed.
    """
    wider_m = _WIDENING_S2 * speed_m_s * speed_m_s / max(abs(flown_m), 1.0)
    return math.copysign(max(abs(flown_m) - wider_m, 1.0), flown_m)
