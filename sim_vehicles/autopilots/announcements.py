"""Status texts of simulated autopilots about a fault, apart from those of failsafes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicles.autopilots.autopilot_states import StatusText
from sim_vehicles.vehicle.faults import FaultKind, Faults


class Announcement(NamedTuple):
    """One text."""

    kind: FaultKind
    after_s: float
    """From the begin of the fault."""
    text: StatusText


_CRITICAL: Final = mavlink.MAV_SEVERITY_CRITICAL
_ERROR: Final = mavlink.MAV_SEVERITY_ERROR
_INFO: Final = mavlink.MAV_SEVERITY_INFO
PLANE_TEXTS: Final = (
    Announcement(FaultKind.GLITCH, 0.9, StatusText(_CRITICAL, "EKF3 lane switch 1")),
    Announcement(FaultKind.GLITCH, 3.9, StatusText(_INFO, "AHRS: DCM active")),
    Announcement(FaultKind.AIRSPEED, 4.0, StatusText(_ERROR, "Airspeed sensor 1 failure. Disabling")),
)
PLANE_END_TEXTS: Final = {FaultKind.GLITCH: StatusText(_INFO, "AHRS: EKF3 active")}
_AIRSPEED_TEXT: Final = "Airspeed sensor failure detected. Return to launch (RTL) is advised."
PX4_TEXTS: Final = (
    Announcement(FaultKind.AIRSPEED, 1.1, StatusText(_CRITICAL, _AIRSPEED_TEXT)),
    Announcement(FaultKind.AIRSPEED, 1.1, StatusText(_CRITICAL, "Preflight Fail: Airspeed invalid")),
    Announcement(FaultKind.CRASH, 3.2, StatusText(_CRITICAL, "Preflight Fail: Attitude failure (pitch)")),
)


class Announcer:
    """Says each text once in each fault."""

    def __init__(self, faults: Faults, px4: bool) -> None:
        self._faults = faults
        self._texts = PX4_TEXTS if px4 else PLANE_TEXTS
        self._end_texts = {} if px4 else PLANE_END_TEXTS
        self._said: set[Announcement] = set()

    def due(self, t_ns: int) -> Iterator[StatusText]:
        """Yield the texts that are due."""
        for one in self._texts:
            if one in self._said or not self._faults.has_lasted(one.kind, one.after_s, t_ns):
                continue
            self._said.add(one)
            yield one.text
        ended = {one.kind for one in self._said if one.kind not in self._faults}
        if ended:
            self._said = {one for one in self._said if one.kind not in ended}
            yield from (self._end_texts[kind] for kind in sorted(ended) if kind in self._end_texts)
