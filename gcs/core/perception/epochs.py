"""What was so for several moments in a row: sensors that measure at the same moment count once."""

from __future__ import annotations


class ConsecutiveEpochs:
    """Counts, for each key, the moments in a row at which something was so; the last look at one decides."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[int, int, int]] = {}
        """By key: the last moment, the row up to it, and the row before it."""

    def take(self, key: int, measured_t_ns: int, *, holds: bool) -> int:
        """Return how long the row is with what was seen at `measured_t_ns`, 0 when it does not hold."""
        moment_t_ns, row, before = self._known.get(key, (-1, 0, 0))
        if measured_t_ns > moment_t_ns:
            before = row
        row = before + 1 if holds else 0
        self._known[key] = (measured_t_ns, row, before)
        return row

    def forget(self, key: int) -> None:
        """Begin anew."""
        self._known.pop(key, None)
