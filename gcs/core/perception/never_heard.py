"""Vehicles of the mission that were never heard.

The fleet watches vehicles that fall silent later (`gcs.mavlink.fleet.fleet`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gcs.core.operator.replies import named
from gcs.core.perception.records import PerceptionState
from gcs.model import NS_PER_S, Effect, Notice

_TIMEOUT_NS = 10 * NS_PER_S
"""Time from the start: radios and autopilots take a while to boot."""


class NeverHeardCheck:
    """Warns once of the vehicles that were not heard since the start.

    Parameters
    ----------
    vehicles : sequence of int
        All vehicles of the mission.
    is_heard : callable
        Returns True if a vehicle was ever heard.
    state : PerceptionState
        Holds the time of the check.
    """

    def __init__(
        self, vehicles: Sequence[int], is_heard: Callable[[int], bool], state: PerceptionState
    ) -> None:
        self._vehicles, self._is_heard, self._state = vehicles, is_heard, state

    def poll(self, t_ns: int) -> list[Effect]:
        """Return the warning when it is due."""
        state = self._state
        if state.never_heard_due_t_ns is None:
            state.never_heard_due_t_ns = t_ns + _TIMEOUT_NS
        if state.is_never_heard_checked or t_ns < state.never_heard_due_t_ns:
            return []
        state.is_never_heard_checked = True
        missing = [vehicle for vehicle in self._vehicles if not self._is_heard(vehicle)]
        if not missing:
            return []
        text = f"{named(missing)} not heard yet: on, with this system id, and sending to this machine?"
        return [Notice(t_ns, "warning", text)]
