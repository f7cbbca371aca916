"""A wall clock that a test sets."""

import time


class WallClock:
    """Stands in for the `time` module of `gcs.io.clock`."""

    def __init__(self) -> None:
        self.set_by_ns = 0
        """How far it was set from the machine's."""
        self.t_ns: int | None = None
        """The Unix time where it stands still; `None` when it runs."""
        self.monotonic_t_ns: int | None = None
        """The monotonic time where it stands still; `None` for the machine's."""

    def time_ns(self) -> int:
        return time.time_ns() + self.set_by_ns if self.t_ns is None else self.t_ns

    def clock_gettime_ns(self, clock: int) -> int:
        return time.clock_gettime_ns(clock)

    def monotonic_ns(self) -> int:
        return time.monotonic_ns() if self.monotonic_t_ns is None else self.monotonic_t_ns
