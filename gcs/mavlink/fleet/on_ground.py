"""Vehicles on the ground: the one definition of it."""

from __future__ import annotations

from typing import Final

from gcs.mavlink.mission.items import Home
from gcs.model import VehicleState

LOW_M: Final = 10.0
"""A slow armed vehicle is on the ground below this height above its home."""
_MAX_GROUND_SPEED_M_S: Final = 3.0
_MAX_CLIMB_M_S: Final = 1.0
_ROLL_M: Final = 5.0
_MAX_ROLL_M_S: Final = 7.0
"""So near the height of its home, and slower, a vehicle that neither climbs nor sinks rolls, or slides.

In a valley below its home it may fly as slowly, against the wind.
"""
_MIN_FALL_M: Final = 20.0
"""A disarmed vehicle that moves at this height above its home is in the air."""


def is_on_ground(state: VehicleState | None, home: Home | None) -> bool:
    """Return True if a vehicle is on the ground as far as known.

    Its autopilot says so and it does not move; or it is slow and low, or rolls; or it is disarmed, unless it
    moves high above its home.
    """
    if state is None or not state.mode:
        return False
    height_m = 0.0 if home is None else state.alt_msl_m - home.alt_msl_m
    moves = state.ground_speed_m_s >= _MAX_GROUND_SPEED_M_S or abs(state.climb_m_s) >= _MAX_CLIMB_M_S
    if not state.armed:
        return not moves or height_m < _MIN_FALL_M
    if home is not None and abs(height_m) < _ROLL_M and state.ground_speed_m_s < _MAX_ROLL_M_S:
        return abs(state.climb_m_s) < _MAX_CLIMB_M_S
    if moves:
        return False
    return state.grounded is True or (home is not None and height_m < LOW_M)
