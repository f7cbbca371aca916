"""Counts of consecutive epochs; sensors that measure at the same time share an epoch."""

from __future__ import annotations


class ConsecutiveEpochs:
    """Counts, for each key, the consecutive epochs at which a condition held.

    Of several measurements at one epoch the last one counts.
    """

    def __init__(self) -> None:
        self._counts: dict[int, tuple[int, int, int]] = {}
        """Last epoch, count up to it, and count before it, by key."""

    def count(self, key: int, measured_t_ns: int, *, holds: bool) -> int:
        """Return the number of consecutive epochs up to `measured_t_ns`; 0 if the condition does not hold."""
        epoch_t_ns, count, before = self._counts.get(key, (-1, 0, 0))
        if measured_t_ns > epoch_t_ns:
            before = count
        count = before + 1 if holds else 0
        self._counts[key] = (measured_t_ns, count, before)
        return count

    def forget(self, key: int) -> None:
        """Restart the count of a key."""
        self._counts.pop(key, None)
