"""Wind triangle: speed over ground from airspeed, wind and course, and back.

Autopilots keep their airspeed V and follow lines over ground. So in a wind w the speed over ground on a
course with the unit vector c is ``w . c + sqrt(V^2 - (w x c)^2)``.
"""

from __future__ import annotations

import math
from typing import Final

LOW_SPEED_M_S: Final = 1.0
"""Least airspeed and least speed over ground that is returned."""
_LEAST_AIRSPEED: Final = 0.5
_GREATEST_AIRSPEED: Final = 2.0
"""Airspeeds, by the cruising speed, between which an estimate of the wind is plausible."""


def airspeed_m_s(speed_m_s: float, course_rad: float, wind_m_s: tuple[float, float]) -> float:
    """Return the airspeed of a vehicle with a speed and a course over ground."""
    east, north = wind_m_s
    along = east * math.sin(course_rad) + north * math.cos(course_rad)
    squared = speed_m_s * (speed_m_s - 2.0 * along) + east * east + north * north
    return max(math.sqrt(max(squared, 0.0)), LOW_SPEED_M_S)


def over_ground(course: float, airspeed: float, wind_east: float, wind_north: float) -> tuple[float, float]:
    """Return the speed over ground on a course, and the part of the airspeed along it."""
    sine = math.sin(course)
    cosine = math.cos(course)
    across = wind_east * cosine - wind_north * sine
    ahead = math.sqrt(max(airspeed * airspeed - across * across, 0.0))
    along = wind_east * sine + wind_north * cosine
    return max(along + ahead, LOW_SPEED_M_S), ahead


def plausible_wind_m_s(
    reported_m_s: tuple[float, float] | None, speed_m_s: float, course_rad: float, cruise_m_s: float
) -> tuple[float, float] | None:
    """Return the wind that a vehicle reports; (0, 0) where its airspeed would be no such aeroplane's.

    Parameters
    ----------
    reported_m_s : tuple of float or None
        East and north. If None, None is returned.
    speed_m_s, course_rad : float
        Speed over ground and course.
    cruise_m_s : float
        Airspeed at which it cruises.
    """
    if reported_m_s is None:
        return None
    share = airspeed_m_s(speed_m_s, course_rad, reported_m_s) / cruise_m_s
    return reported_m_s if _LEAST_AIRSPEED < share < _GREATEST_AIRSPEED else (0.0, 0.0)


def leg_time_s(leg_m: tuple[float, float], airspeed: float, wind_m_s: tuple[float, float]) -> float:
    """Return the time of a straight leg, east and north."""
    along, _ = over_ground(math.atan2(*leg_m), airspeed, *wind_m_s)
    return math.hypot(*leg_m) / along
