"""Operator notices about overridden vehicles and unattended targets.

A vehicle whose mode a pilot, a failsafe or another ground station chose is left alone
(`gcs.core.authority.overrides`). A notice reports its start, with the remedy, and its end.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

from gcs.core.authority.authority_state import AuthorityState
from gcs.core.authority.overrides import Overrides
from gcs.core.flight.failsafes import Failsafes
from gcs.core.operator.vehicle_orders import Orders
from gcs.core.state import Agent
from gcs.mavlink.autopilots.modes import INITIALISING, LOITER, PILOTED, RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.services.retry import ns
from gcs.model import Authority, Effect, Label, Notice, NoticeCode, targets_text, vehicle_name

_PERIOD_NS: Final = ns(1.0)
_BOOT_NS: Final = ns(30.0)
"""Time after a boot in which a vehicle may come up in LOITER by itself, as a PX4 does."""
_TOLD: Final = frozenset({Authority.OTHER_STATION, Authority.SECOND_COMMANDER})
"""Claims whose begin has a notice of its own."""
_MAX_NAMED: Final = 8
"""Maximum number of vehicles listed by name."""


class OverrideNotices:
    """Notices about overridden vehicles."""

    def __init__(
        self,
        agents: Mapping[int, Agent],
        state: AuthorityState,
        overrides: Overrides,
        orders: Orders,
        failsafes: Failsafes,
        fleet: Fleet,
    ) -> None:
        self._agents = agents
        self._state = state
        self._overrides = overrides
        self._orders = orders
        self._failsafes = failsafes
        self._fleet = fleet

    def poll(self, t_ns: int) -> list[Effect]:
        """Check once a second."""
        if t_ns < self._state.override_check_t_ns:
            return []
        self._state.override_check_t_ns = t_ns + _PERIOD_NS
        modes = self._overrides.modes()
        unknown = self._overrides.recently_in_rtl(t_ns)
        effects: list[Effect] = []
        free: list[Effect] = []
        for vehicle, agent in sorted(self._agents.items()):
            before = agent.authority.reported_mode
            mode = modes.get(vehicle, "")
            agent.authority.is_reported |= bool(before) or not _TOLD.isdisjoint(agent.claims.begun)
            if agent.authority.is_reported and not mode and agent.control.is_ours:
                agent.authority.is_reported = False
                free.append(Notice(t_ns, NoticeCode.OURS_AGAIN, vehicle))
            is_unknown = vehicle in unknown and not self._failsafes.cause(vehicle, t_ns)
            # What has landed is told as such, and is left alone: its autopilot may change its mode there.
            has_landed = agent.flight.phase.has_flown
            is_starting = mode == INITIALISING
            if is_unknown or has_landed or is_starting or self._orders.has_ordered(vehicle, mode):
                mode = ""
            elif mode not in ("", before):
                effects.append(self._notice(vehicle, mode, t_ns))
            agent.authority.reported_mode = mode
        return effects + free

    def _notice(self, vehicle: int, mode: str, t_ns: int) -> Notice:
        """Return the notice of a mode that was not commanded, with its cause."""
        cause = self._failsafes.cause(vehicle, t_ns)
        if cause:
            return Notice(t_ns, NoticeCode.FAILSAFE, vehicle, {"mode": mode, "cause": cause})
        why = {
            LOITER: "an operator or another station chose that mode",
            RTL: "a failsafe, its mission's end, or another station's order",
        }.get(mode, "a pilot or another station chose that mode")
        if mode == LOITER and self._fleet.may_have_rebooted(vehicle, t_ns - _BOOT_NS):
            why = "it rebooted, or an operator or another station chose that mode"
        return Notice(t_ns, NoticeCode.OVERRIDDEN, vehicle, {"mode": mode, "why": why})


def unattended_targets(
    state: AuthorityState, targets: Collection[Label], t_ns: int, *, has_ended: bool
) -> list[Effect]:
    """Process the open targets; return a notice about those that are left after the end of the mission."""
    if state.known_targets and (not has_ended or set(targets).isdisjoint(state.known_targets)):
        state.known_targets = ()
        attended = [Notice(t_ns, NoticeCode.TARGETS_ATTENDED)]
    else:
        attended = []
    if not has_ended:
        return [*attended]
    new = sorted(set(targets) - set(state.known_targets))
    state.known_targets += tuple(new)
    if not new:
        return [*attended]
    return [*attended, Notice(t_ns, NoticeCode.TARGETS_UNATTENDED, None, {"targets": targets_text(new)})]


def overridden_text(modes: Mapping[int, str]) -> str:
    """Return one line about overridden vehicles, with the remedy; empty if there are none."""
    by_mode: dict[str, list[int]] = {}
    for vehicle, mode in sorted(modes.items()):
        by_mode.setdefault(mode, []).append(vehicle)
    parts = []
    for mode, vehicles in sorted(by_mode.items(), key=lambda one: (one[0] in PILOTED, one[0])):
        names = [vehicle_name(vehicle) for vehicle in vehicles]
        listed = ", ".join(names) if len(names) <= _MAX_NAMED else f"{len(names)} agents"
        remedy = f"gcs order resume {' '.join(names) if len(names) <= _MAX_NAMED else '--all'}"
        remedy = "the pilot gives it back" if mode in PILOTED else remedy
        parts.append(f"{listed} in {mode}: {remedy}")
    return f"not ours: {'; '.join(parts)}" if parts else ""
