"""Last check of a mission before its upload: no item may lie outside the map or the fence.

The check is independent of planning, which also keeps routes inside both. The vehicle of a refused mission
keeps its onboard mission.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.fence import Area, areas_of
from gcs.mavlink.mission.items import Item
from gcs.model import VehicleState
from gcs.planning.map.grid import Grid

_ROUNDING_M: Final = 1.0
_PLACE_ROUNDING_M: Final = 0.02
"""Items hold 1e-7 degrees, 11 mm."""
_RELATIVE: Final = (dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)


class MissionBoundsCheck:
    """Checks the positions of mission items."""

    def __init__(self, config: Config, grid: Grid) -> None:
        self._frame, self._grid = config.local_frame, grid
        self._areas, self._ceiling_m = areas_of(config, config.name), config.fence.max_alt_rel_m

    def problem(self, items: Sequence[Item], state: VehicleState | None) -> str:
        """Return the first item out of bounds, in words; empty if there is none.

        A vehicle inside an exclusion area may get items there: it has to leave it.

        Parameters
        ----------
        items : sequence of Item
            Mission items without home.
        state : VehicleState or None
            State of the vehicle.
        """
        areas = self._areas
        if state is not None:
            position_m = state.east_m, state.north_m
            areas = [area for area in areas if area.stay_in or not self._contains(area, position_m)]
        for number, item in enumerate(items, start=1):
            problem = self._outside(item, areas)
            if problem:
                name = dialect.enums["MAV_CMD"][item.command].name.removeprefix("MAV_CMD_NAV_").lower()
                lat_lon = f"{item.x * 1e-7:.6f}, {item.y * 1e-7:.6f}"
                return f"point {number} of {len(items)} ({name} at {lat_lon}) {problem}"
        return ""

    def _outside(self, item: Item, areas: Sequence[Area]) -> str:
        if not math.isfinite(item.z_m):
            return "has no height"
        ceiling_m = self._ceiling_m
        if ceiling_m and item.frame in _RELATIVE and item.z_m > ceiling_m + _ROUNDING_M:
            return f"is {item.z_m:.0f} m high, above the fence's ceiling of {ceiling_m:g} m"
        position_m = self._frame.to_local(item.x * 1e-7, item.y * 1e-7)
        if not self._grid.contains(position_m, _PLACE_ROUNDING_M):
            return "lies outside the map"
        if any(self._contains(area, position_m) != area.stay_in for area in areas):
            return "lies outside the fence"
        return ""

    def _contains(self, area: Area, position_m: tuple[float, float]) -> bool:
        return bool(area.contains(np.array([position_m]), self._frame)[0])
