"""Tells of vehicles in modes that are not ours, and of targets that nobody is sent to.

What a vehicle does by somebody else's choice (a pilot, a failsafe, another ground station) is left alone
(`gcs.mavlink.fleet.mode_authority`). The operator is told when it begins, also of what a service finds at its
start, with what to do, and when it ends.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Mapping
from typing import Final

from gcs.core.operator.vehicle_orders import PILOTED
from gcs.mavlink.autopilots.modes import LOITER, RTL
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Label, Notice, target_name, vehicle_name

_PERIOD_NS: Final = ns(1.0)
_MAX_NAMED: Final = 8
"""Vehicles of one mode that are named one by one."""


class OverrideNotices:
    """Modes that somebody else chose, as the operator was told of them."""

    def __init__(self) -> None:
        self._told: dict[int, str] = {}
        self._next_look_t_ns = 0

    def poll(self, t_ns: int, taken: Mapping[int, str], ordered: Container[int]) -> list[Effect]:
        """Look once a second.

        Parameters
        ----------
        taken
            The mode that somebody else chose, by vehicle.
        ordered
            Vehicles that are in their modes by an operator's order here, or have yet to tell why.
        """
        if t_ns < self._next_look_t_ns:
            return []
        self._next_look_t_ns = t_ns + _PERIOD_NS
        now = {vehicle: mode for vehicle, mode in taken.items() if vehicle not in ordered}
        effects: list[Effect] = []
        for vehicle, mode in sorted(now.items()):
            if self._told.get(vehicle) != mode:
                effects.append(Notice(t_ns, "warning", _words(vehicle, mode), vehicle))
        free = sorted(self._told.keys() - taken.keys())
        effects += [Notice(t_ns, "info", "is ours to task again", vehicle) for vehicle in free]
        self._told = now
        return effects


class Unattended:
    """Targets that appear after the mission has ended, as the operator was told of them."""

    def __init__(self) -> None:
        self._known: set[Label] = set()

    def look(self, t_ns: int, targets: Collection[Label], *, ended: bool) -> list[Effect]:
        """Take the targets that need somebody; after the end say which of them are new."""
        if not ended:
            self._known = set(targets)
            return []
        new = sorted(set(targets) - self._known)
        self._known.update(new)
        if not new:
            return []
        names = ", ".join(map(target_name, new))
        text = (
            f"{'targets' if len(new) > 1 else 'target'} {names} appeared after the mission ended: nobody is "
        )
        return [Notice(t_ns, "warning", text + "sent there; start the service with --no-resume to fly on")]


def overridden_text(taken: Mapping[int, str]) -> str:
    """Say in one line which vehicles are in modes that somebody else chose, and what to do; else empty."""
    by_mode: dict[str, list[int]] = {}
    for vehicle, mode in sorted(taken.items()):
        by_mode.setdefault(mode, []).append(vehicle)
    parts = []
    for mode, vehicles in sorted(by_mode.items(), key=lambda one: (one[0] in PILOTED, one[0])):
        names = [vehicle_name(vehicle) for vehicle in vehicles]
        whom = ", ".join(names) if len(names) <= _MAX_NAMED else f"{len(names)} agents"
        remedy = f"gcs order resume {' '.join(names) if len(names) <= _MAX_NAMED else '--all'}"
        remedy = "whoever flies gives it back" if mode in PILOTED else remedy
        parts.append(f"{whom} in {mode}: {remedy}")
    return f"not ours: {'; '.join(parts)}" if parts else ""


def _words(vehicle: int, mode: str) -> str:
    back = f"`gcs order resume --vehicle {vehicle_name(vehicle)}`"
    why = {
        LOITER: "an operator or another station stopped it",
        RTL: "it returns by a failsafe, by its mission's end, or by somebody's order",
    }.get(mode, "somebody chose that mode")
    return f"is in {mode}, not by this service: {why}. It is left alone until {back}, or until it is in AUTO"
