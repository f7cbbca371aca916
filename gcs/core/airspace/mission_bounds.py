"""The last look at a mission before it is uploaded: no item may lie outside the map or the fence.

Routes are planned inside both. This check knows nothing of planning: whatever went wrong before, a mission
with an item elsewhere does not leave, and its vehicle keeps the mission that it holds.
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
_RELATIVE: Final = (dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)


class MissionBoundsCheck:
    """Says what is wrong with the places of a mission's items.

    Parameters
    ----------
    config : Config
        The mission: where its frame lies, and its fence.
    grid : Grid
        Its map, of which only the extent counts here.
    """

    def __init__(self, config: Config, grid: Grid) -> None:
        self._frame, self._grid = config.local_frame, grid
        self._areas, self._ceiling_m = areas_of(config, config.name), config.fence.max_alt_rel_m

    def problem(self, items: Sequence[Item], state: VehicleState | None) -> str:
        """Say which item lies where it must not; empty when none does.

        A vehicle inside an area to stay out of may get items there: it has to leave it.

        Parameters
        ----------
        items : sequence of Item
            Those that are flown: without home.
        state : VehicleState or None
            Where the vehicle is.
        """
        areas = self._areas
        if state is not None:
            place_m = state.east_m, state.north_m
            areas = [area for area in areas if area.stay_in or not self._holds(area, place_m)]
        for number, item in enumerate(items, start=1):
            where = self._outside(item, areas)
            if where:
                name = dialect.enums["MAV_CMD"][item.command].name.removeprefix("MAV_CMD_NAV_").lower()
                lat_lon = f"{item.x * 1e-7:.6f}, {item.y * 1e-7:.6f}"
                return f"point {number} of {len(items)} ({name} at {lat_lon}) {where}"
        return ""

    def _outside(self, item: Item, areas: Sequence[Area]) -> str:
        if not math.isfinite(item.z_m):
            return "has no height"
        ceiling_m = self._ceiling_m
        if ceiling_m and item.frame in _RELATIVE and item.z_m > ceiling_m + _ROUNDING_M:
            return f"is {item.z_m:.0f} m high, above the fence's ceiling of {ceiling_m:g} m"
        place_m = self._frame.to_local(item.x * 1e-7, item.y * 1e-7)
        if not self._grid.contains(place_m):
            return "lies outside the map"
        if any(self._holds(area, place_m) != area.stay_in for area in areas):
            return "lies outside the fence"
        return ""

    def _holds(self, area: Area, place_m: tuple[float, float]) -> bool:
        return bool(area.contains(np.array([place_m]), self._frame)[0])
