"""Who is about to fly into an area that was closed, by the mission that it holds.

Closing an area changes no mission by itself: routes are planned around it, and each vehicle flies its last
good mission until the next one is verified on board. Where there is no other way, or nobody confirms one, or
it cannot be delivered, that mission leads into the area. Then nothing is done to the vehicle unasked: a place
to circle is no safer than its mission, for all we know here. The operator is told who it is, where and when
it enters, once when the area is closed and once more shortly before, and holds it or calls it back.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gcs.core.tasking.upload_manager import UploadManager
from gcs.model import Notice, VehicleState
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight

SOON_S = 20.0
_SLOW_M_S = 1.0
_HALVINGS = 12


@dataclass(frozen=True, slots=True)
class Incursion:
    """Where a vehicle enters a closed area."""

    vehicle: int
    area: str
    item: int
    """Of the mission that it holds: the one that it flies to then."""
    after_s: float
    """0 when it is inside."""

    @property
    def text(self) -> str:
        """In words, without who it is."""
        if self.after_s == 0.0:
            return f"is inside no-fly zone {self.area}: hold it, or call it back"
        return (
            f"would fly through no-fly zone {self.area}: in {self.after_s:.0f} s, on its way to item "
            f"{self.item} of the mission that it holds"
        )


class IncursionWarnings:
    """What vehicles hold, against the closed areas.

    Parameters
    ----------
    tasking : Tasking
        Knows what vehicles hold.
    """

    def __init__(self, tasking: UploadManager) -> None:
        self._tasking = tasking
        self._warned: dict[tuple[int, str], float] = {}
        """At how many seconds to go each was last told of."""

    def entries(self, states: Iterable[VehicleState], areas: Mapping[str, Grid]) -> list[Incursion]:
        """Who enters which area; one that comes to several is told of the first."""
        found = []
        together = _together(areas)
        for state in states:
            if together is None or self._entry(state, "", together) is None:
                continue
            ways = [entry for name, closed in areas.items() if (entry := self._entry(state, name, closed))]
            found += sorted(ways, key=lambda entry: entry.after_s)[:1]
        return found

    def look(self, t_ns: int, states: Iterable[VehicleState], areas: Mapping[str, Grid]) -> list[Notice]:
        """Say who is about to enter, and who has: each once, until it is out of danger."""
        due = {(e.vehicle, e.area): e for e in self.entries(states, areas) if e.after_s <= SOON_S}
        self._warned = {key: after_s for key, after_s in self._warned.items() if key in due}
        notices = []
        for key, entry in due.items():
            before_s = self._warned.get(key)
            if before_s is None or (entry.after_s == 0.0 < before_s):
                notices.append(Notice(t_ns, "alarm", entry.text, entry.vehicle))
            self._warned[key] = entry.after_s
        return notices

    def _entry(self, state: VehicleState, name: str, closed: Grid) -> Incursion | None:
        place, points = (state.east_m, state.north_m), self._tasking.points_ahead(state.system_id)
        if not line_of_sight(closed, place, place):
            return Incursion(state.system_id, name, state.mission_seq, 0.0)
        flown_m = 0.0
        for number, (start, end) in enumerate(pairwise((place, *points))):
            if not line_of_sight(closed, start, end):
                flown_m += _clear_m(closed, start, end)
                after_s = flown_m / max(state.ground_speed_m_s, _SLOW_M_S)
                return Incursion(state.system_id, name, state.mission_seq + number, max(after_s, 0.1))
            flown_m += math.dist(start, end)
        return None


def _together(areas: Mapping[str, Grid]) -> Grid | None:
    """Return the cells that any area blocks, so that a vehicle clear of all is looked at once."""
    grids = list(areas.values())
    if not grids:
        return None
    blocked = np.logical_or.reduce([grid.blocked for grid in grids])
    return Grid(grids[0].origin_m, grids[0].spacing_m, blocked)


def _clear_m(closed: Grid, start: Point, end: Point) -> float:
    """How far a leg is clear, by halving."""
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        there = (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))
        low, high = (share, high) if line_of_sight(closed, start, there) else (low, share)
    return low * math.dist(start, end)
