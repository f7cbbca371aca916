"""Routes that wait for their upload: the newest of each vehicle, first come, first served.

Besides the upload window of its link, a route waits for

* an item that its vehicle is about to reach, for `_MAX_ITEM_WAIT_NS` at most;
* a pause after repeated failures (`gcs.core.tasking.upload_retry`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from gcs.core.state import Agent
from gcs.core.tasking.records import QueuedRoute
from gcs.model import NS_PER_S, Route
from gcs.planning.terminal.landing import ReturnRoute

_MAX_ITEM_WAIT_NS: Final = 5 * NS_PER_S


class UploadQueue:
    """Routes that wait for their upload.

    Parameters
    ----------
    routes : dict of int to QueuedRoute
        By vehicle, the longest waiting first.
    item_wait_s : callable
        Returns how long an upload to a vehicle should wait for it to pass an item, at a time in ns.
    """

    def __init__(
        self,
        agents: Mapping[int, Agent],
        routes: dict[int, QueuedRoute],
        item_wait_s: Callable[[int, int], float],
    ) -> None:
        self._agents, self._routes, self._item_wait_s = agents, routes, item_wait_s

    def put(self, route: Route, t_ns: int, return_route: ReturnRoute | None, *, at_once: bool) -> None:
        """Queue a route in place of an older one; with `at_once` it waits for its link only."""
        before = self._routes.get(route.vehicle)
        until_ns = t_ns if at_once else t_ns + _MAX_ITEM_WAIT_NS
        if before is not None:
            until_ns, at_once = min(before.until_ns, until_ns), at_once or before.at_once
        self._routes[route.vehicle] = QueuedRoute(route, t_ns, until_ns, at_once, return_route)

    def is_due(self, vehicle: int, t_ns: int) -> bool:
        """Return True if a route waits for its link only."""
        queued = self._routes[vehicle]
        if not queued.at_once and t_ns < self._agents[vehicle].tasking.retry.paused_until_t_ns:
            return False
        return t_ns >= queued.until_ns or not self._item_wait_s(vehicle, t_ns)
