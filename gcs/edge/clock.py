"""The run's clock: wall time, scaled. The only place where a running service reads the time."""

from __future__ import annotations

import time
from dataclasses import dataclass

from gcs.model import NS_PER_S


@dataclass(frozen=True, slots=True)
class RunClock:
    """Run time as a line through (wall time, run time); with speed 1 and no offset it is the Unix time.

    Every process of a simulated run is told the same line, so that all stamp the same time.
    """

    epoch_ns: int = 0
    """A wall time, nanoseconds since the Unix epoch."""
    start_t_ns: int = 0
    """The run time at that wall time."""
    speed: float = 1.0

    def now_ns(self) -> int:
        """Run time now."""
        wall_ns = time.time_ns()
        if self.speed == 1.0:
            return self.start_t_ns + wall_ns - self.epoch_ns
        return self.start_t_ns + int((wall_ns - self.epoch_ns) * self.speed)

    def wall_s_until(self, t_ns: int) -> float:
        """Seconds of wall time until run time `t_ns`; negative when it has passed."""
        return (t_ns - self.now_ns()) / self.speed / NS_PER_S
