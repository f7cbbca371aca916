"""Scans in the order in which they were measured: a bounded wait for those that are on their way.

Sensors differ in how long they take to publish, so scans arrive out of order. A tracker cannot take back what
it has worked, so each scan is held until `window_s` have passed since it was measured; what arrives within
that is put in its place. What is later still is refused by the trackers, counted and shown. Waiting makes
the picture older by the window; 0 works every scan as it comes.

Time is that of the events alone: the same events give the same order.
"""

from __future__ import annotations

import heapq
from dataclasses import replace

from gcs.model import NS_PER_S, Scan

_MOST_HELD = 10_000
"""Then the oldest go at once: a sensor that runs wild must not fill the memory."""


class OutOfSequenceBuffer:
    """Scans that wait.

    Parameters
    ----------
    window_s : float
        How long after its measurement a scan is worked.
    """

    def __init__(self, window_s: float) -> None:
        self._window_ns = round(window_s * NS_PER_S)
        self._held: list[tuple[int, str, int, Scan]] = []
        self._count = 0

    def hold(self, scan: Scan) -> None:
        """Take a scan that has arrived."""
        self._count += 1
        heapq.heappush(self._held, (scan.measured_t_ns, scan.sensor.name, self._count, scan))

    def due(self, t_ns: int) -> list[Scan]:
        """Return the scans whose time has come by `t_ns`, oldest measurement first, as if they came now."""
        found = []
        while self._held and (
            self._held[0][0] + self._window_ns <= t_ns or len(self._held) > _MOST_HELD or not self._window_ns
        ):
            scan = heapq.heappop(self._held)[-1]
            found.append(replace(scan, t_ns=max(t_ns, scan.t_ns)))
        return found
