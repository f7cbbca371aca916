"""Variants of a flight along one path: slow and quick to turn, in still air, wind and gusts.

How fast a vehicle turns is known roughly, and of the wind only its greatest speed. A path is clear if all of
these are: two in still air, and twenty in the greatest wind. Those are by L1 and by a heading law in wind
from each of eight directions, and by L1 with a limited bank from each of four.

In still air each waypoint is flown to straight. In wind a vehicle drifts off that line and returns to it, so
lines are followed, as autopilots do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gcs.model import FloatArray
from gcs.planning.circle_guidance import L1_S
from gcs.planning.forward_simulation import (
    HEADING_S,
    Motion,
    SimulatedFlight,
    max_turn_rate_rad_s,
    simulate,
)
from gcs.planning.map.grid import Grid
from gcs.planning.path.initial_turn import MIN_RADIUS_SHARE
from gcs.planning.path.turns import TurnAnticipation

_DIRECTIONS = 8
_GUST_S = 2.0
"""Time in which gusts as strong as the wind itself would take a vehicle off its path by the margin."""


def flight_variants(turns: TurnAnticipation, lag_s: float, speed_m_s: float) -> FloatArray:
    """Return the flights to simulate, (k, 5): turn lag, limit of the turn rate, T1, wind east and north.

    Two are in still air; without wind no others. T1 as `l1_s` of `simulate`.
    """
    widest = max_turn_rate_rad_s(speed_m_s, turns.radius_m)
    quick_s = MIN_RADIUS_SHARE * lag_s
    rows = [(lag_s, widest, 0.0, 0.0, 0.0), (quick_s, math.inf, 0.0, 0.0, 0.0)]
    if turns.wind_m_s > 0.0:
        widest *= (1.0 + turns.wind_m_s / speed_m_s) ** 2  # the radius allows for turns downwind
        for k in range(_DIRECTIONS):
            angle = 2.0 * math.pi * k / _DIRECTIONS
            wind = (turns.wind_m_s * math.sin(angle), turns.wind_m_s * math.cos(angle))
            rows += [(quick_s, math.inf, L1_S, *wind), (lag_s, math.inf, -HEADING_S, *wind)]
            if k % 2 == 0:
                rows.append((lag_s, widest, L1_S, *wind))
    return np.array(rows)


def windy_flights(
    grid: Grid, motion: Motion, ahead_s: float, turns: TurnAnticipation, lag_s: float, clearance_m: float
) -> Iterator[SimulatedFlight]:
    """Yield the flights in wind, each up to where it comes nearer than the clearance; none without wind.

    The speed of `motion` is the airspeed.
    """
    for lag, max_rate, l1_s, *wind in flight_variants(turns, lag_s, motion.speed_m_s)[2:].tolist():
        min_radius_m = motion.speed_m_s / max_rate
        yield simulate(
            grid, motion, ahead_s, lag, clearance_m, min_radius_m, l1_s, wind_m_s=(wind[0], wind[1])
        )


def wind_margin_m(turns: TurnAnticipation) -> float:
    """Return the distance that gusts may take a vehicle off its simulated flights."""
    return _GUST_S * turns.wind_m_s
