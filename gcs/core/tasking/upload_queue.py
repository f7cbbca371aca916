"""Routes that wait for their transfer, in the order in which their vehicles came: one a vehicle, the newest.

What a route may wait for is bounded in time, room on its link and an end of the transfer under way apart:

* An item that its vehicle is about to reach, `_MOST_WAIT_NS` at the most.
* A pause after transfers that failed one after the other. The first is made up for at the next plan; a
  vehicle that refuses its missions must not keep its link from the others.

A transfer under way gives way to a newer route for `_REPLACED_NS` only, counted from the first of those
that replaced each other; then it is let end. On a lossy link a mission takes longer than the picture takes
to change: a vehicle whose transfers were all replaced would circle for minutes, and keep the link to itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gcs.model import NS_PER_S, Route

_MOST_WAIT_NS: Final = 5 * NS_PER_S
_PAUSE_NS: Final = 5 * NS_PER_S
"""After the second failure; each one after it doubles the pause."""
_MOST_PAUSE_NS: Final = 60 * NS_PER_S
_REPLACED_NS: Final = 10 * NS_PER_S


@dataclass(frozen=True, slots=True)
class _Waiting:
    route: Route
    made_t_ns: int
    until_ns: int
    """From then on it does not wait for its vehicle to pass an item."""
    at_once: bool


class UploadQueue:
    """Routes that wait, and how patient their vehicles are.

    Parameters
    ----------
    wait_s : callable
        Vehicle and time (ns) to how long a transfer should wait for it to pass an item.
    """

    def __init__(self, wait_s: Callable[[int, int], float]) -> None:
        self._wait_s = wait_s
        self._routes: dict[int, _Waiting] = {}
        self._failures: dict[int, int] = {}
        self._paused_until_ns: dict[int, int] = {}
        self._first_began_ns: dict[int, int] = {}

    @property
    def vehicles(self) -> tuple[int, ...]:
        """Whose routes wait, the longest waiting first."""
        return tuple(self._routes)

    def put(self, route: Route, t_ns: int, *, at_once: bool) -> None:
        """Let a route wait, in place of an older one; `at_once` for nothing but room on its link."""
        before = self._routes.get(route.vehicle)
        until_ns = t_ns if at_once else t_ns + _MOST_WAIT_NS
        if before is not None:
            until_ns, at_once = min(before.until_ns, until_ns), at_once or before.at_once
        self._routes[route.vehicle] = _Waiting(route, t_ns, until_ns, at_once)

    def take(self, vehicle: int) -> Route | None:
        """Take a vehicle's route out."""
        one = self._routes.pop(vehicle, None)
        return None if one is None else one.route

    def made_t_ns(self, vehicle: int) -> int:
        """When a vehicle's route was made."""
        return self._routes[vehicle].made_t_ns

    def is_due(self, vehicle: int, t_ns: int) -> bool:
        """Whether a vehicle's route waits for room on its link alone."""
        one = self._routes[vehicle]
        if not one.at_once and t_ns < self._paused_until_ns.get(vehicle, 0):
            return False
        return t_ns >= one.until_ns or not self._wait_s(vehicle, t_ns)

    def is_replaceable(self, vehicle: int, t_ns: int) -> bool:
        """Whether a transfer under way may give way to a newer route."""
        return t_ns - self._first_began_ns.get(vehicle, t_ns) < _REPLACED_NS

    def began(self, vehicle: int, t_ns: int) -> None:
        """Note that a transfer begins, perhaps in place of another."""
        self._first_began_ns.setdefault(vehicle, t_ns)

    def ended(self, vehicle: int, t_ns: int, *, ok: bool) -> float:
        """Note that a transfer came to its own end; returns the pause after it, in seconds."""
        if ok:
            self.forgive(vehicle)
            return 0.0
        self._first_began_ns.pop(vehicle, None)
        failures = self._failures[vehicle] = self._failures.get(vehicle, 0) + 1
        if failures == 1:
            return 0.0
        pause_ns = min(_PAUSE_NS << min(failures - 2, 8), _MOST_PAUSE_NS)
        self._paused_until_ns[vehicle] = t_ns + pause_ns
        return pause_ns / NS_PER_S

    def has_failed(self, vehicle: int) -> bool:
        """True if a vehicle's last transfer failed: the next one may have to wait."""
        return vehicle in self._failures

    def forgive(self, vehicle: int) -> None:
        """Forget what went wrong with a vehicle before: it is another case now."""
        for noted in (self._failures, self._paused_until_ns, self._first_began_ns):
            noted.pop(vehicle, None)
