"""Start of a simulated world with the first ground station that stays in contact."""

from __future__ import annotations

from gcs.model import NS_PER_S

_STAYS_NS = 10 * NS_PER_S
"""Longer than a session of `gcs preflight` or `gcs fence`."""
_GAP_NS = 10 * NS_PER_S
"""Run time; heartbeats come once a second of wall time."""


class GroundContact:
    """Presence of a ground station at a vehicle.

    Attributes
    ----------
    began_t_ns : int or None
        Time when it was heard for 10 s without a gap of 10 s; None before.
    """

    def __init__(self) -> None:
        self.began_t_ns: int | None = None
        self._since_t_ns = self._last_t_ns = -_GAP_NS

    def hear(self, t_ns: int) -> bool:
        """Note a datagram; return True at the start of ground contact."""
        if t_ns - self._last_t_ns >= _GAP_NS:
            self._since_t_ns = t_ns
        self._last_t_ns = t_ns
        if self.began_t_ns is not None or t_ns - self._since_t_ns < _STAYS_NS:
            return False
        self.began_t_ns = t_ns
        return True
