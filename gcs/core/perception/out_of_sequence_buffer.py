"""Out-of-sequence buffer: scans in the order of measurement, within a bounded delay.

Each scan is held until `window_s` after its measurement, and processed in order. Trackers refuse later ones.
The window delays the picture; 0 processes each scan at once.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field, replace

from gcs.model import NS_PER_S, Scan

_MAX_HELD = 10_000
"""Beyond this number the oldest scans are processed at once."""


@dataclass(slots=True)
class OutOfSequenceBuffer:
    """Scans that wait for earlier ones."""

    held: list[tuple[int, str, int, Scan]] = field(default_factory=list)
    """Heap of scans by measurement time, sensor and number."""
    count: int = 0
    """Number of scans that have arrived."""

    def __post_init__(self) -> None:
        shapes = {(scan.z_m.shape[1:], scan.sensor.noise_cov_m2.shape) for *_, scan in self.held}
        if shapes - {((2,), (2, 2))}:
            raise ValueError("out-of-sequence buffer: a scan is not valid")

    def add(self, scan: Scan) -> None:
        """Add a scan that has arrived."""
        self.count += 1
        heapq.heappush(self.held, (scan.measured_t_ns, scan.sensor.name, self.count, scan))

    def due(self, t_ns: int, window_s: float) -> list[Scan]:
        """Return the scans measured `window_s` before `t_ns`, the oldest first, with this arrival time."""
        found = []
        window_ns = round(window_s * NS_PER_S)
        while self.held and (
            self.held[0][0] + window_ns <= t_ns or len(self.held) > _MAX_HELD or not window_ns
        ):
            scan = heapq.heappop(self.held)[-1]
            found.append(replace(scan, t_ns=max(t_ns, scan.t_ns)))
        return found
