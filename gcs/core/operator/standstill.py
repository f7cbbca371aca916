"""Standstill: told when no agent that is left can be tasked, so that only the operator can go on.

A vehicle that a failsafe brought home circles there until a pilot lands it or an operator resumes it. Such a
mission has not ended: a resumed vehicle continues it. The operator is told once what is left and why, and
again when it goes on. A vehicle that is held or returns by order is the operator's own choice, and no news.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from gcs.core.operator.operator_state import Standstill
from gcs.core.state import Agent, with_status
from gcs.mavlink.services.retry import ns
from gcs.model import Authority, Effect, Notice, NoticeCode, vehicle_name

_PERIOD_NS: Final = ns(0.5)
_TELL_NS: Final = ns(10.0)
_MAX_NAMED: Final = 8
"""Maximum number of vehicles listed by name."""
_ORDERED: Final = frozenset({Authority.HELD, Authority.RETURNING})


def check_standstill(agents: Mapping[int, Agent], state: Standstill, t_ns: int) -> list[Effect]:
    """Check a mission that has begun and has not ended, twice a second."""
    if t_ns < state.next_check_t_ns:
        return []
    state.next_check_t_ns = t_ns + _PERIOD_NS
    reasons = {vehicle: _reason(agents[vehicle]) for vehicle in with_status(agents, "active")}
    flies = any(agents[vehicle].flight.phase.is_in_air for vehicle in reasons)
    if not flies or not all(reasons.values()):
        return _end(reasons, state, t_ns)
    if state.since_t_ns is None:
        state.since_t_ns = t_ns
    if state.is_told or t_ns - state.since_t_ns < _TELL_NS:
        return []
    state.is_told = True
    return [Notice(t_ns, NoticeCode.STANDSTILL, None, {"vehicles": _left(reasons)})]


def _end(reasons: Mapping[int, str], state: Standstill, t_ns: int) -> list[Effect]:
    """End a standstill; return a notice if the operator was told of it."""
    was_told = state.is_told
    state.since_t_ns = None
    state.is_told = False
    able = [vehicle_name(vehicle) for vehicle, reason in reasons.items() if not reason]
    if not (was_told and able):
        return []
    return [Notice(t_ns, NoticeCode.STANDSTILL_OVER, None, {"vehicles": ", ".join(able)})]


def _reason(agent: Agent) -> str:
    """Return why an active agent neither flies to a target nor can get one; empty if it does or can."""
    control = agent.control
    flight = agent.flight
    if control.authority in _ORDERED:
        return ""
    if not control.is_ours:
        return control.reason
    if agent.link.liveness == "down":
        return "is not heard"
    if agent.routes.flown is not None and agent.tasking.route_end.since_t_ns is None:
        return ""  # it is on its way
    if agent.link.high_latency is not None:
        return "is heard by HIGH_LATENCY2 alone"
    return f"is unfit: {flight.unfit}" if flight.unfit else ""


def _left(reasons: Mapping[int, str]) -> str:
    """Return the vehicles by reason, in words."""
    by_reason: dict[str, list[str]] = {}
    for vehicle, reason in sorted(reasons.items()):
        by_reason.setdefault(reason, []).append(vehicle_name(vehicle))
    return "; ".join(
        f"{', '.join(names) if len(names) <= _MAX_NAMED else f'{len(names)} agents'} ({reason})"
        for reason, names in by_reason.items()
    )
