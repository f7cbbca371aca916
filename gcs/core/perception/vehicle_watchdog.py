"""Vehicles of the mission that were never heard.

A vehicle that falls silent after it was heard is watched by the fleet (`gcs.mavlink.fleet.fleet`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gcs.core.operator.replies import named
from gcs.model import NS_PER_S, Effect, Notice

_MISSED_AFTER_NS = 10 * NS_PER_S
"""From the start: radios and autopilots take their time."""


class VehicleWatchdog:
    """Names, once, the vehicles that were not heard since the start.

    Parameters
    ----------
    vehicles : sequence of int
        Of the mission.
    is_heard : callable
        True if a vehicle was ever heard.
    """

    def __init__(self, vehicles: Sequence[int], is_heard: Callable[[int], bool]) -> None:
        self._vehicles, self._is_heard = vehicles, is_heard
        self._start_t_ns: int | None = None
        self._is_told = False

    def poll(self, t_ns: int) -> list[Effect]:
        """Let time pass; return the warning when it is due."""
        if self._start_t_ns is None:
            self._start_t_ns = t_ns
        if self._is_told or t_ns - self._start_t_ns < _MISSED_AFTER_NS:
            return []
        self._is_told = True
        missing = [vehicle for vehicle in self._vehicles if not self._is_heard(vehicle)]
        if not missing:
            return []
        text = f"{named(missing)} not heard yet: on, with this system id, and sending to this machine?"
        return [Notice(t_ns, "warning", text)]
