"""Separation minima: least distances and heights between vehicles in the air, and from other aircraft."""

from __future__ import annotations

from typing import Final

from gcs.config import Config

_LEAST_DISTANCE_M: Final = 30.0
"""Least horizontal distance, whatever `planning.separation_m` says."""
_ONE_LAYER_M: Final = 20.0
"""Height between layers that counts where there is one layer."""
AIRCRAFT_M: Final = 300.0
AIRCRAFT_HEIGHT_M: Final = 75.0
"""Least distance and difference in height of a vehicle and an aircraft that is not ours."""
PREDICTED_SHARE: Final = 0.75
LOST_SHARE: Final = 0.5
"""Shares of a layer step: least difference in height, predicted and measured."""


def layer_step_m(config: Config) -> float:
    """Return the height between layers, or what counts where there is one layer."""
    return config.mission.layer_step_m or _ONE_LAYER_M


def min_distance_m(config: Config) -> float:
    """Return the least horizontal distance of two vehicles that are not apart in height."""
    return max(config.planning.separation_m, _LEAST_DISTANCE_M)
