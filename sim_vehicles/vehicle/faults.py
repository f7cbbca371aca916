"""Faults of a simulated vehicle: what breaks, when, and for how long.

What a fault does is where it acts: in the airframe, the failsafes and the telemetry. Times and messages
are those of recorded flights where there is one (`tests/sim_vehicles/test_recorded_faults.py`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from gcs.errors import SimulationError
from gcs.model import NS_PER_S

_FAULT_TEXT = re.compile(r"(?P<kind>\w+):(?P<vehicle>\d{1,3})@(?P<at>\d+(\.\d+)?)(\+(?P<lasts>\d+(\.\d+)?))?")


class FaultKind(StrEnum):
    """Kind of a fault."""

    CRASH = "crash"
    """It dives into the ground; its radio lives on."""
    ENGINE = "engine"
    """No thrust: it glides down."""
    GPS = "gps"
    """No fix."""
    GLITCH = "glitch"
    """The GPS position jumps by 200 m."""
    BATTERY = "battery"
    """The battery is nearly empty."""
    RC = "rc"
    """No signal of the radio control."""
    AIRSPEED = "airspeed"
    """The airspeed sensor is blocked."""
    FENCE = "fence"
    """A ceiling below the vehicle: it is beyond its fence."""
    RADIO = "radio"
    """The telemetry link is silent, both ways."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault."""

    kind: FaultKind
    at_s: float
    """Seconds from the start, or from ground contact."""
    lasts_s: float = 0.0
    """0: for good. A crash is always for good."""


@dataclass(frozen=True, slots=True)
class FaultChange:
    """Begin or end of a fault."""

    t_ns: int
    kind: FaultKind
    begins: bool


def fault_changes(faults: Iterable[Fault], start_t_ns: int) -> list[FaultChange]:
    """Return when faults begin and end, the next change last."""
    changes = []
    for fault in faults:
        begins_ns = start_t_ns + int(fault.at_s * NS_PER_S)
        changes.append(FaultChange(begins_ns, fault.kind, True))
        if fault.lasts_s > 0.0 and fault.kind is not FaultKind.CRASH:
            changes.append(FaultChange(begins_ns + int(fault.lasts_s * NS_PER_S), fault.kind, False))
    return sorted(changes, key=lambda change: (change.t_ns, change.kind), reverse=True)


def parse_fault(text: str) -> tuple[int, Fault]:
    """Read ``KIND:VEHICLE@SECONDS``, or ``KIND:VEHICLE@SECONDS+DURATION``; return vehicle and fault.

    Raises
    ------
    SimulationError
        The text has another form.
    """
    found = _FAULT_TEXT.fullmatch(text)
    kinds = [kind.value for kind in FaultKind]
    if found is None or found["kind"] not in kinds:
        raise SimulationError(
            f"--faults: expected KIND:VEHICLE@SECONDS or KIND:VEHICLE@SECONDS+DURATION, got {text!r}; "
            f"kinds are {', '.join(kinds)}"
        )
    lasts_s = float(found["lasts"] or 0.0)
    return int(found["vehicle"]), Fault(FaultKind(found["kind"]), float(found["at"]), lasts_s)


class Faults:
    """The faults of one vehicle that are at work."""

    def __init__(self) -> None:
        self._begun_ns: dict[FaultKind, int] = {}

    def begin(self, kind: FaultKind, t_ns: int) -> None:
        """Begin a fault; one that is at work goes on."""
        self._begun_ns.setdefault(kind, t_ns)

    def end(self, kind: FaultKind) -> None:
        """End a fault."""
        self._begun_ns.pop(kind, None)

    def __contains__(self, kind: FaultKind) -> bool:
        return kind in self._begun_ns

    def has_lasted(self, kind: FaultKind, seconds: float, t_ns: int) -> bool:
        """Return True if a fault has been at work for some seconds."""
        begun_ns = self._begun_ns.get(kind)
        return begun_ns is not None and t_ns - begun_ns >= seconds * NS_PER_S

    def age_s(self, kind: FaultKind, t_ns: int) -> float:
        """Return the seconds since a fault began that is at work."""
        return (t_ns - self._begun_ns[kind]) / NS_PER_S
