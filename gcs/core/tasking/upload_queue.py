"""Routes that wait for their upload: the newest of each vehicle, first come, first served.

Besides the upload window of its link, a route waits for

* an item that its vehicle is about to reach, for `_MAX_ITEM_WAIT_NS` at most;
* a pause after repeated failures, so that a vehicle that refuses its missions does not block its link. The
  first failure causes no pause.

A newer route supersedes an upload in progress for `_SUPERSEDE_NS` only, counted from the first upload of such
a series. After that the upload may finish. On a lossy link an upload takes longer than the plan takes to
change, and a vehicle whose uploads were all superseded would circle for minutes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gcs.model import NS_PER_S, Effect, Notice, Route
from gcs.planning.terminal.landing import ReturnRoute

_MAX_ITEM_WAIT_NS: Final = 5 * NS_PER_S
_FIRST_PAUSE_NS: Final = 5 * NS_PER_S
"""Pause after the second failure; each further one doubles it."""
_MAX_PAUSE_NS: Final = 60 * NS_PER_S
_SUPERSEDE_NS: Final = 10 * NS_PER_S


@dataclass(frozen=True, slots=True)
class QueuedRoute:
    """A route that waits for its upload."""

    route: Route
    planned_t_ns: int
    until_ns: int
    """End of the wait for an item."""
    at_once: bool
    return_route: ReturnRoute | None


class UploadQueue:
    """Routes that wait for their upload, and the retry policy of each vehicle.

    Parameters
    ----------
    item_wait_s : callable
        Returns how long an upload to a vehicle should wait for it to pass an item, at a time in ns.
    """

    def __init__(self, item_wait_s: Callable[[int, int], float]) -> None:
        self._item_wait_s = item_wait_s
        self._routes: dict[int, QueuedRoute] = {}
        self._failures: dict[int, int] = {}
        self._paused_until_ns: dict[int, int] = {}
        self._first_began_ns: dict[int, int] = {}

    @property
    def vehicles(self) -> tuple[int, ...]:
        """Vehicles with a queued route, the longest waiting first."""
        return tuple(self._routes)

    def put(self, route: Route, t_ns: int, return_route: ReturnRoute | None, *, at_once: bool) -> None:
        """Queue a route in place of an older one; with `at_once` it waits for its link only."""
        before = self._routes.get(route.vehicle)
        until_ns = t_ns if at_once else t_ns + _MAX_ITEM_WAIT_NS
        if before is not None:
            until_ns, at_once = min(before.until_ns, until_ns), at_once or before.at_once
        self._routes[route.vehicle] = QueuedRoute(route, t_ns, until_ns, at_once, return_route)

    def pop(self, vehicle: int) -> QueuedRoute | None:
        """Remove the route of a vehicle and return it."""
        return self._routes.pop(vehicle, None)

    def is_due(self, vehicle: int, t_ns: int) -> bool:
        """Return True if a route waits for its link only."""
        queued = self._routes[vehicle]
        if not queued.at_once and t_ns < self._paused_until_ns.get(vehicle, 0):
            return False
        return t_ns >= queued.until_ns or not self._item_wait_s(vehicle, t_ns)

    def may_supersede(self, vehicle: int, t_ns: int) -> bool:
        """Return True if a newer route may replace an upload in progress."""
        return t_ns - self._first_began_ns.get(vehicle, t_ns) < _SUPERSEDE_NS

    def began(self, vehicle: int, t_ns: int) -> None:
        """Note that an upload begins, perhaps in place of another."""
        self._first_began_ns.setdefault(vehicle, t_ns)

    def ended(self, vehicle: int, t_ns: int, *, ok: bool) -> list[Effect]:
        """Note the result of an upload; return a notice if the next one has to wait."""
        if ok:
            self.forgive(vehicle)
            return []
        self._first_began_ns.pop(vehicle, None)
        failures = self._failures[vehicle] = self._failures.get(vehicle, 0) + 1
        if failures == 1:
            return []
        pause_ns = min(_FIRST_PAUSE_NS << min(failures - 2, 8), _MAX_PAUSE_NS)
        self._paused_until_ns[vehicle] = t_ns + pause_ns
        text = f"last {failures} mission uploads failed: next attempt in {pause_ns / NS_PER_S:.0f} s"
        return [Notice(t_ns, "alarm", text, vehicle)]

    def has_failed(self, vehicle: int) -> bool:
        """Return True if the last upload to a vehicle failed: the next one may have to wait."""
        return vehicle in self._failures

    def forgive(self, vehicle: int) -> None:
        """Forget the failures of a vehicle."""
        for noted in (self._failures, self._paused_until_ns, self._first_began_ns):
            noted.pop(vehicle, None)
