"""Forward-simulated flight along a mission: climb, legs with turns, and the loiter circle at the end.

The climb is straight. From its end, or from the vehicle's motion in flight, the legs are simulated with the
vehicle's turn lag and turn radius (`gcs.planning.forward_simulation`). Obstacles do not end the flight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.geo import bearing_rad
from gcs.model import FloatArray, IntArray
from gcs.planning.circle_guidance import L1_S
from gcs.planning.forward_simulation import STEP_S, Motion, RemainingMission, simulate
from gcs.planning.map.grid import Point, free_grid

_CIRCLE_LAPS: Final = 1.5
_MORE_TIME: Final = 1.25
"""Simulated time, as a multiple of that along the straight legs."""
_TURNS_S: Final = 20.0
"""Simulated time beyond that."""
_SLOWEST_SHARE: Final = 0.3
"""Least speed over ground in wind for the simulated time, as a share of the airspeed."""
NOWHERE: Final = free_grid((2, 2), 1.0)
"""Map without obstacles."""


@dataclass(frozen=True, slots=True)
class MissionFlight:
    """Simulated flight along a mission; a climb comes first.

    Attributes
    ----------
    places_m : ndarray, shape (k, 2)
        East and north, each `STEP_S` after the one before; in a climb evenly spaced.
    passed : ndarray of int, shape (k,)
        Number of waypoints passed before each place, -1 in the climb.
    climb_s : float
        Duration of the climb.
    """

    places_m: FloatArray
    passed: IntArray
    climb_s: float

    def time_to_s(self, count: int) -> float:
        """Return the time until `count` waypoints are passed; that of the whole flight if they are not."""
        return self.climb_s + STEP_S * int(np.count_nonzero((self.passed >= 0) & (self.passed < count)))


def simulate_mission(
    motion: Motion,
    climb_end_m: Point | None,
    ahead: RemainingMission,
    turn_lag_s: float,
    turn_radius_m: float,
    wind_m_s: Point = (0.0, 0.0),
) -> MissionFlight:
    """Simulate a flight along a mission.

    Parameters
    ----------
    motion : Motion
        Motion where the mission begins.
    climb_end_m : tuple of float or None
        End of a straight climb before the first waypoint; None in flight.
    ahead : RemainingMission
        Waypoints, their acceptance radii, and the circle behind the last one.
    turn_lag_s, turn_radius_m : float
        Delay until a commanded turn rate is reached, and least turn radius in still air.
    wind_m_s : tuple of float
        Velocity of the air, east and north; the speed of the motion is the airspeed then.
    """
    speed_m_s = max(motion.speed_m_s, 1.0)
    climb_m = np.empty((0, 2))
    climb_s = 0.0
    begin = motion.place_m
    course_rad = motion.course_rad
    rate_rad_s = motion.turn_rate_rad_s
    if climb_end_m is not None:
        climb_s = math.dist(begin, climb_end_m) / speed_m_s
        share = np.linspace(0.0, 1.0, max(2, round(climb_s / STEP_S)))
        climb_m = begin + share[:, None] * np.subtract(climb_end_m, begin)
        course_rad = bearing_rad(*begin, *climb_end_m)
        begin = climb_end_m
        rate_rad_s = 0.0
    legs_m = math.fsum(map(math.dist, (begin, *ahead.points_m), ahead.points_m))
    if ahead.circle is not None:
        legs_m += math.dist((begin, *ahead.points_m)[-1], ahead.circle.centre_m)
    round_m = 0.0 if ahead.circle is None else _CIRCLE_LAPS * 2.0 * math.pi * ahead.circle.radius_m
    slowest_m_s = max(speed_m_s - math.hypot(*wind_m_s), _SLOWEST_SHARE * speed_m_s)
    states = simulate(
        NOWHERE,
        Motion(*begin, speed_m_s, course_rad, rate_rad_s, 0.0, ahead),
        (_MORE_TIME * legs_m + round_m) / slowest_m_s + _TURNS_S,
        turn_lag_s,
        min_radius_m=turn_radius_m,
        l1_s=L1_S,
        wind_m_s=wind_m_s,
    ).states
    return MissionFlight(
        np.concatenate((climb_m, states[:, :2])),
        np.concatenate((np.full(len(climb_m), -1), states[:, 4].astype(np.int64))),
        climb_s,
    )
