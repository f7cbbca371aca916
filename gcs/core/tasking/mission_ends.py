"""Vehicles that pass the ends of their routes without having reached their targets.

Behind the last point of its route a vehicle circles, returns or lands. An ArduPlane without a further item
goes to RTL. If the vehicle passed too far from its target, or the target was elsewhere, the operator is
notified and the next plan gives the vehicle a new mission. A vehicle in its landing is not turned back.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from gcs.core.tasking.onboard_missions import OnboardMission, TerminalPhase
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Notice

_ARRIVAL_NS: Final = ns(5.0)
"""Time from the last point until an arrival would have been detected."""
_CIRCLING_NS: Final = ns(15.0)
"""The same on a loiter circle within the capture radius."""
_PHASE_WORDS: Final[dict[TerminalPhase, str]] = {
    "circle": "it circles at its route's end",
    "circle elsewhere": "it circles elsewhere",
    "return route": "it returns to land",
    "landing": "it lands, and gets no other mission before that",
    "return": "it ended its mission and flies RTL",
}


class MissionEnds:
    """Vehicles that have passed the ends of their routes.

    Parameters
    ----------
    capture_radius_m : float
        Distance at which a vehicle has reached its target.
    """

    def __init__(self, tasking: UploadManager, capture_radius_m: float) -> None:
        self._tasking, self._max_radius_m = tasking, capture_radius_m
        self._since: dict[int, tuple[OnboardMission | None, int]] = {}
        self._reported: dict[int, OnboardMission | None] = {}
        self._missed: set[int] = set()

    def check(self, t_ns: int, active: Iterable[int]) -> list[Effect]:
        """Check the vehicles that have not reached a target; report each mission once."""
        effects: list[Effect] = []
        self._missed.clear()
        for vehicle in active:
            mission, phase = self._tasking.onboard(vehicle), self._tasking.terminal_phase(vehicle)
            if not phase or (mission is None and phase != "return"):
                self._since.pop(vehicle, None)
                continue
            since, since_t_ns = self._since.setdefault(vehicle, (mission, t_ns))
            if since is not mission:
                self._since[vehicle] = mission, t_ns
                continue
            circle = None if mission is None else mission.circle
            is_at_target = phase == "circle" and circle is not None and circle.radius_m <= self._max_radius_m
            if t_ns - since_t_ns < (_CIRCLING_NS if is_at_target else _ARRIVAL_NS):
                continue
            if not is_at_target and phase != "landing":
                self._missed.add(vehicle)
            if vehicle not in self._reported or self._reported[vehicle] is not mission:
                self._reported[vehicle] = mission
                text = f"ended its route without having reached its target: {_PHASE_WORDS[phase]}"
                effects.append(Notice(t_ns, "alarm", text, vehicle))
        return effects

    def has_missed(self, vehicle: int) -> bool:
        """Return True if a vehicle has passed its target, and its mission does not lead back to it."""
        return vehicle in self._missed or self._tasking.has_passed_route_end(vehicle)
