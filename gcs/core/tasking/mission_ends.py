"""Vehicles that end their missions without having reached their targets.

A vehicle goes on by itself behind the last point of its route: it circles, flies home, lands. An ArduPlane
that has no item left goes to RTL. One that has reached its target may. One that has not, because it passed
too far off or the target was elsewhere, would circle, or be at home, and the target would wait: so the
operator is told, and it counts as having passed its target, for which the next plan gives it a new mission.
On final it is let land.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from gcs.core.tasking.onboard_missions import OnboardMission, TerminalLoiter
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Notice

_ARRIVAL_NS: Final = ns(5.0)
"""From the last point until an arrival would have been seen."""
_CIRCLING_NS: Final = ns(15.0)
"""The same on a circle on which a vehicle is at its target all the time."""
_NOW: Final[dict[TerminalLoiter, str]] = {
    "circle": "it circles at its route's end",
    "circle elsewhere": "it circles elsewhere",
    "way home": "it flies home to land",
    "landing": "it lands, and gets no other mission before that",
    "return": "it ended its mission and flies RTL",
}


class MissionEnds:
    """Which vehicles are behind their routes' ends, and for how long.

    Parameters
    ----------
    tasking : Tasking
        What they hold, and where in it they are.
    capture_radius_m : float
        A vehicle this near to its target has reached it.
    """

    def __init__(self, tasking: UploadManager, capture_radius_m: float) -> None:
        self._tasking, self._capture_radius_m = tasking, capture_radius_m
        self._since: dict[int, tuple[OnboardMission | None, int]] = {}
        self._told: dict[int, OnboardMission | None] = {}
        self._missed: set[int] = set()

    def look(self, t_ns: int, active: Iterable[int]) -> list[Effect]:
        """Look at the vehicles that have not reached a target; say, once a mission, which ended it so."""
        effects: list[Effect] = []
        self._missed.clear()
        for vehicle in active:
            flown, ending = self._tasking.onboard(vehicle), self._tasking.terminal_phase(vehicle)
            if not ending or (flown is None and ending != "return"):
                self._since.pop(vehicle, None)
                continue
            since, since_t_ns = self._since.setdefault(vehicle, (flown, t_ns))
            if since is not flown:
                self._since[vehicle] = flown, t_ns
                continue
            is_at_target = ending == "circle" and flown is not None and self._is_within_reach(flown)
            if t_ns - since_t_ns < (_CIRCLING_NS if is_at_target else _ARRIVAL_NS):
                continue
            if not is_at_target and ending != "landing":
                self._missed.add(vehicle)
            if vehicle not in self._told or self._told[vehicle] is not flown:
                self._told[vehicle] = flown
                text = f"ended its route without having reached its target: {_NOW[ending]}"
                effects.append(Notice(t_ns, "alarm", text, vehicle))
        return effects

    def has_missed(self, vehicle: int) -> bool:
        """Return True if a vehicle has its target behind it, and will not come to it again by itself."""
        return vehicle in self._missed or self._tasking.has_passed_route_end(vehicle)

    def _is_within_reach(self, flown: OnboardMission) -> bool:
        circle = flown.circle
        return circle is not None and circle.radius_m <= self._capture_radius_m
