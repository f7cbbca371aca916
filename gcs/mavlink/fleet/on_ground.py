"""Vehicles on the ground."""

from __future__ import annotations

from typing import Final

from gcs.mavlink.mission.items import Home
from gcs.model import VehicleState

_GROUND_M: Final = 10.0
_GROUND_SPEED_M_S: Final = 3.0


def is_on_ground(state: VehicleState | None, home: Home | None) -> bool:
    """Return True if a vehicle is on the ground as far as known: disarmed, or slow and low."""
    if state is None or not state.mode:
        return False
    if not state.armed:
        return True
    low = home is not None and state.alt_msl_m - home.alt_msl_m < _GROUND_M
    return low and state.ground_speed_m_s < _GROUND_SPEED_M_S
