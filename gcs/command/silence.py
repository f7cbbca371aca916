"""Who has not spoken: sensors without whom nobody is seen to die, and vehicles that were never heard.

A vehicle that falls silent after it was heard is watched by the fleet (`gcs.mavlink.fleet`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gcs.command.answers import named
from gcs.model import NS_PER_S, Effect, Notice

_BLIND_AFTER_NS = 5 * NS_PER_S
_MISSED_AFTER_NS = 10 * NS_PER_S
"""From the start: radios and autopilots take their time."""


class Silence:
    """Tells of silence once, and of its end.

    Parameters
    ----------
    vehicles
        Of the mission.
    is_heard
        Whether a vehicle was ever heard.
    """

    def __init__(self, vehicles: Sequence[int], is_heard: Callable[[int], bool]) -> None:
        self.scan_t_ns: int | None = None
        """When the last scan came."""
        self._vehicles, self._is_heard = vehicles, is_heard
        self._start_t_ns: int | None = None
        self._blind = self._missed = False

    def scan(self, t_ns: int) -> list[Effect]:
        """Note that a scan came; the first one after an alarm is its all-clear."""
        before, was_blind = self.scan_t_ns or self._start_t_ns or t_ns, self._blind
        self.scan_t_ns, self._blind = t_ns, False
        if not was_blind:
            return []
        return [Notice(t_ns, "info", f"scans come again after {(t_ns - before) / NS_PER_S:.0f} s")]

    def poll(self, t_ns: int) -> list[Effect]:
        """Say who has been silent for too long."""
        if self._start_t_ns is None:
            self._start_t_ns = t_ns
        return [*self._sensors(t_ns), *self._never_heard(t_ns, self._start_t_ns)]

    def _sensors(self, t_ns: int) -> list[Effect]:
        since_t_ns = self.scan_t_ns or self._start_t_ns or t_ns
        if self._blind or t_ns - since_t_ns < _BLIND_AFTER_NS:
            return []
        self._blind = True
        text = f"no scan for {(t_ns - since_t_ns) / NS_PER_S:.0f} s: is the sensor there?"
        return [Notice(t_ns, "alarm", text)]

    def _never_heard(self, t_ns: int, start_t_ns: int) -> list[Effect]:
        if self._missed or t_ns - start_t_ns < _MISSED_AFTER_NS:
            return []
        self._missed = True
        missing = [vehicle for vehicle in self._vehicles if not self._is_heard(vehicle)]
        if not missing:
            return []
        text = f"{named(missing)} not heard yet: on, with this system id, and sending to this machine?"
        return [Notice(t_ns, "warning", text)]
