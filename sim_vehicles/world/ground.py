"""When a simulated world begins to move: with the first ground station that stays."""

from __future__ import annotations

from gcs.model import NS_PER_S

_STAYS_NS = 10 * NS_PER_S
"""`gcs preflight` and `gcs fence` come, ask, and are gone before."""
_GAP_NS = 10 * NS_PER_S
"""Of run time: heartbeats come once a second of wall time, at any speed of the run."""


class GroundContact:
    """Presence of a ground station at a vehicle.

    Attributes
    ----------
    began_t_ns : int or None
        When it had been heard for 10 s without a gap of 10 s; None before.
    """

    def __init__(self) -> None:
        self.began_t_ns: int | None = None
        self._since_t_ns = self._last_t_ns = -_GAP_NS

    def hear(self, t_ns: int) -> bool:
        """Note a datagram; return True if the ground station has now stayed for the first time."""
        if t_ns - self._last_t_ns >= _GAP_NS:
            self._since_t_ns = t_ns
        self._last_t_ns = t_ns
        if self.began_t_ns is not None or t_ns - self._since_t_ns < _STAYS_NS:
            return False
        self.began_t_ns = t_ns
        return True
