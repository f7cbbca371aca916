"""Out-of-sequence buffer: scans in the order of measurement, within a bounded delay.

Each scan is held until `window_s` after its measurement, and processed in order. Trackers refuse later ones.
The window delays the picture; 0 processes each scan at once.
"""

from __future__ import annotations

import heapq
from dataclasses import replace

from gcs.model import NS_PER_S, Scan

_MAX_HELD = 10_000
"""Beyond this number the oldest scans are processed at once."""


class OutOfSequenceBuffer:
    """Scans that wait for earlier ones.

    Parameters
    ----------
    window_s : float
        Time from the measurement of a scan to its processing.
    """

    def __init__(self, window_s: float) -> None:
        self._window_ns = round(window_s * NS_PER_S)
        self._held: list[tuple[int, str, int, Scan]] = []
        self._count = 0

    def add(self, scan: Scan) -> None:
        """Add a scan that has arrived."""
        self._count += 1
        heapq.heappush(self._held, (scan.measured_t_ns, scan.sensor.name, self._count, scan))

    def due(self, t_ns: int) -> list[Scan]:
        """Return the scans that are due at `t_ns`, oldest measurement first, with this arrival time."""
        found = []
        while self._held and (
            self._held[0][0] + self._window_ns <= t_ns or len(self._held) > _MAX_HELD or not self._window_ns
        ):
            scan = heapq.heappop(self._held)[-1]
            found.append(replace(scan, t_ns=max(t_ns, scan.t_ns)))
        return found
