"""Where a leg begins, as ArduPlane decides it.

Usually a leg begins where the last one led to, and its line is followed. After a mode change and after a
take-off it begins where the vehicle is, and is flown straight to its point. A flag says which of the two; it
is set again by each leg that begins. ``DO_SET_MISSION_CURRENT`` clears the flag after it has started the
item, ``MISSION_SET_CURRENT`` before.
"""

from __future__ import annotations

from dataclasses import replace

from sim_vehicles.vehicle.airframe import Airframe
from sim_vehicles.vehicle.guidance import ToPoint


class Legs:
    """Remembers where the last leg of an airframe led to."""

    def __init__(self, airframe: Airframe) -> None:
        self._airframe = airframe
        self._point = (airframe.east_m, airframe.north_m)
        self.do_join = False
        """True if the next leg begins where the last one led to; otherwise where the vehicle is."""

    def begin(self, east_m: float, north_m: float, accept_radius_m: float) -> ToPoint:
        """Return the leg to a point."""
        here = self._airframe.east_m, self._airframe.north_m
        is_tracked, self.do_join = self.do_join, True
        begin = self._point if is_tracked else here
        leg = ToPoint(east_m, north_m, east_m - begin[0], north_m - begin[1], accept_radius_m, is_tracked)
        if leg.is_past(self._airframe):  # it would be over at once
            leg = replace(leg, leg_east_m=east_m - here[0], leg_north_m=north_m - here[1])
        self._point = east_m, north_m
        return leg

    def leave(self) -> None:
        """Let the next leg begin where the vehicle is."""
        self._point, self.do_join = (self._airframe.east_m, self._airframe.north_m), False
