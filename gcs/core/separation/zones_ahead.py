"""Zones ahead: which no-fly zone a predicted flight leads into, and whether it is clear of obstacles, too."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

from gcs.core.airspace.no_fly_zones import ClosedZone, NoFlyZones
from gcs.core.separation.forward_flight import Flight, simulate_flights
from gcs.planning.map.line_of_sight import line_of_sight

_OFF_M: Final = 10.0
"""Distance by which predicted circles are off."""


class ZonesAhead:
    """Compares predicted flights with no-fly zones and obstacles.

    Parameters
    ----------
    zones : NoFlyZones
    clearance_m : float
        Horizontal distance that routes keep from what reaches from the ground to the sky.
    """

    def __init__(self, zones: NoFlyZones, clearance_m: float) -> None:
        self._zones = zones
        self.margin_m = min(clearance_m, _OFF_M)
        """Distance that a predicted circle should keep from obstacles."""

    def first(self, flight: Flight, ahead_s: float) -> str:
        """Return the name of the first closed zone that a flight leads into; empty if it leads into none."""
        closed = self._zones.closed
        for leg in _legs(flight, ahead_s) if closed else ():
            for name, zone in closed.items():
                if _is_met(zone, *leg):
                    return name
        return ""

    def problem(self, flight: Flight, ahead_s: float, margin_m: float = 0.0) -> str:
        """Return which zone or obstacle a flight meets, or comes near to, in words; empty if none."""
        if zone := self.first(flight, ahead_s):
            return f"would fly into no-fly zone {zone}"
        full = self._zones.obstacles.full
        legs = list(_legs(flight, ahead_s))
        is_clear = all(line_of_sight(full, begin[:2], end[:2], margin_m) for begin, end in legs)
        cells = self._zones.limited_cells
        near = [leg for leg in legs if not line_of_sight(cells, leg[0][:2], leg[1][:2])]
        meets = any(_is_met(area, *leg) for area in self._zones.limited for leg in near)
        return "would come near an obstacle" if meets or not is_clear else ""

    def is_on_map(self, flight: Flight, ahead_s: float) -> bool:
        """Return True if a flight stays where obstacles are known."""
        full = self._zones.obstacles.full
        return all(full.contains(begin[:2]) for begin, _ in _legs(flight, ahead_s))


_Place = tuple[float, float, float, float]
"""East, north, lowest and greatest height above mean sea level."""


def _legs(flight: Flight, ahead_s: float) -> Iterator[tuple[_Place, _Place]]:
    """Yield the legs between two steps of a predicted flight, as far as it stays in the air."""
    paths = simulate_flights([flight], ahead_s)
    columns = (paths.east_m, paths.north_m, paths.low_m, paths.high_m)
    return pairwise(zip(*(column[:, 0].tolist() for column in columns), strict=True))


def _is_met(zone: ClosedZone, begin: _Place, end: _Place) -> bool:
    """Return True if a leg with its band of heights leads through a zone."""
    heights_m = 0.5 * (begin[2] + begin[3]), 0.5 * (end[2] + end[3])
    half_m = 0.5 * max(begin[3] - begin[2], end[3] - end[2])
    return zone.is_met(begin[:2], end[:2], heights_m, half_m)
