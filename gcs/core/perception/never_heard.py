"""Vehicles of the mission that were never heard.

The fleet watches vehicles that fall silent later (`gcs.mavlink.fleet.fleet`).
"""

from __future__ import annotations

from collections.abc import Mapping

from gcs.core.perception.perception_state import PerceptionState
from gcs.core.state import Agent
from gcs.model import NS_PER_S, Effect, Notice, NoticeCode

_TIMEOUT_NS = 10 * NS_PER_S
"""Time from the start: radios and autopilots take a while to boot."""


def check_never_heard(agents: Mapping[int, Agent], state: PerceptionState, t_ns: int) -> list[Effect]:
    """Warn once of the vehicles that were not heard since the start; return the all-clear later."""
    if state.never_heard_due_t_ns is None:
        state.never_heard_due_t_ns = t_ns + _TIMEOUT_NS
    is_due = not state.is_never_heard_checked and t_ns >= state.never_heard_due_t_ns
    if not (is_due or state.is_any_missing):
        return []
    state.is_never_heard_checked = True
    missing = [vehicle for vehicle, agent in agents.items() if agent.link.address is None]
    was_any_missing = state.is_any_missing
    state.is_any_missing = bool(missing)
    if was_any_missing:
        return [] if missing else [Notice(t_ns, NoticeCode.ALL_HEARD)]
    if not missing:
        return []
    return [Notice(t_ns, NoticeCode.NOT_HEARD_YET, None, {"vehicles": tuple(missing)})]
