"""Signing times of streams, the senders of signed frames: the latest, and what is saved of them.

One row of integers a stream, so that the compiled check (`gcs.mavlink.frames.fast_verify`) and Python share
them. Times are ticks of signatures (`gcs.mavlink.frames.signing`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, TypeAlias

import numpy as np

Stream: TypeAlias = str
""""network/system/component/link id"; on an endpoint for other ground stations preceded by its name."""

TIME, LEAD, SAVED, WIDTH = range(4)
"""Latest time; greatest lead over our clock since times were saved, which may be negative; the time saved."""
_NEVER: Final = -(1 << 62)
_FIRST_ROWS: Final = 64
_MAX_AHEAD_TICKS: Final = 20_000
"""A stream may be ahead of its saved time by 0.2 s: less than the service needs for a restart."""


class SigningTimes:
    """Times of all streams.

    Parameters
    ----------
    times : mapping
        Latest time of each stream in an earlier run.
    """

    def __init__(self, times: Mapping[Stream, int]) -> None:
        self.rows: dict[Stream, int] = {}
        """Row of each stream in the table."""
        self.table = np.full((_FIRST_ROWS, WIDTH), _NEVER, np.int64)
        self.runs_ahead = False
        """True if a stream is ahead of its saved time: after a crash now, its frames could be replayed."""
        self._saved_at = 0
        for stream, time in times.items():
            row = self._add(stream)
            self.table[row, TIME] = time

    def latest(self) -> dict[Stream, int]:
        """Return the latest time of each stream."""
        return dict(zip(self.rows, self.table[: len(self.rows), TIME].tolist(), strict=True))

    def latest_of(self, stream: Stream) -> int | None:
        """Return the latest time of a stream; None if it is new."""
        row = self.rows.get(stream)
        return None if row is None else self.table.item(row, TIME)

    def max_ahead(self, now: int) -> int:
        """Return the ticks that a stream may be ahead of its saved time now."""
        return now - self._saved_at + _MAX_AHEAD_TICKS

    def advance(self, stream: Stream, time: int, now: int) -> None:
        """Advance a stream to a later time."""
        row = self._add(stream)
        times = self.table[row]
        times[TIME] = time
        times[LEAD] = max(times[LEAD], time - now)
        self.runs_ahead |= bool(time > times[SAVED] + self.max_ahead(now))

    def to_save(self, now: int) -> dict[Stream, int]:
        """Return a time for each stream, later than every frame that it may send until now.

        A stream advances with the clock. So a saved time plus the elapsed time is not behind any accepted
        frame, and behind the frames that the stream sends from then on.
        """
        used = self.table[: len(self.rows)]
        used[:, SAVED] = np.maximum(used[:, TIME], now + used[:, LEAD])
        used[:, LEAD] = _NEVER
        self._saved_at = now
        self.runs_ahead = False
        return dict(zip(self.rows, used[:, SAVED].tolist(), strict=True))

    def _add(self, stream: Stream) -> int:
        """Return the row of a stream, a new one if need be; the table may be another afterwards."""
        row = self.rows.setdefault(stream, len(self.rows))
        if row == len(self.table):
            self.table = np.concatenate([self.table, np.full_like(self.table, _NEVER)])
        return row
