"""Datagrams of one sender put together, so that a flood costs a service few events instead of many.

What waited at a wake-up is put together by sender, in order, up to what a radio's router would put into one
datagram. Only datagrams that good frames of known ids fill from end to end are put together: what is found in
the whole is then what was found in the parts. Any other datagram stays alone. Senders may overtake each
other, as they may on UDP; no sender overtakes itself.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from gcs import jit
from gcs.mavlink.frames.fast_scan import CHECKED, CRC_EXTRAS, WIDTH, frame_at

MAX_BYTES: Final = 1400
_SEATS: Final = 1024
_ALONE: Final = -1


@jit.leaf
def _is_clean(data, end, extras, scratch):  # type: ignore[no-untyped-def]
    at = 0
    while at < end:
        length = frame_at(data, at, end, extras, scratch, 0)
        if length <= 0 or scratch[0, CHECKED] == 0:
            return False
        at += length
    return True


@jit.leaf
def _group(slots, count, lengths, senders, extras, scratch, group_of, sizes, seats, out, groups, ends):  # type: ignore[no-untyped-def]
    number = 0
    for i in range(count):
        seat = (senders[i] >> 16 ^ senders[i] >> 40) & _SEATS - 1
        clean = _is_clean(slots[i], lengths[i], extras, scratch)
        group = seats[seat] if clean else _ALONE
        if group == _ALONE or senders[groups[group]] != senders[i] or sizes[group] + lengths[i] > MAX_BYTES:
            group = number
            groups[group] = i
            number += 1
        seats[seat] = group if clean else _ALONE
        group_of[i] = group
        sizes[group] += lengths[i]
    end = 0
    for group in range(number):
        ends[group] = end
        end += sizes[group]
    for i in range(count):
        begin = ends[group_of[i]]
        for k in range(lengths[i]):
            out[begin + k] = slots[i, k]
        ends[group_of[i]] = begin + lengths[i]
    return number


@jit.kernel
def _gather(slots, count, lengths, senders, extras, out, groups, ends):  # type: ignore[no-untyped-def]
    """Copy datagrams, grouped, into `out`; put a datagram of each group, and its end, where they belong."""
    scratch = np.empty((1, WIDTH), np.int32)
    group_of = np.empty(count, np.int64)
    sizes = np.zeros(count, np.int64)
    seats = np.empty(_SEATS, np.int64)
    seats[:] = _ALONE
    return _group(slots, count, lengths, senders, extras, scratch, group_of, sizes, seats, out, groups, ends)


class DatagramBatcher:
    """Puts batches of up to `count` datagrams together."""

    def __init__(self, count: int) -> None:
        self._groups = np.zeros(count, np.int64)
        self._ends = np.zeros(count, np.int64)

    def gather(
        self, slots: npt.NDArray[np.uint8], lengths: npt.NDArray[np.int64], senders: npt.NDArray[np.int64]
    ) -> list[tuple[int, bytes]]:
        """Return (number of a datagram of the same sender, data) of each group, in order of their beginning.

        `slots` (n, longest) holds the datagrams, `lengths` and `senders` (n,) are each one's.
        """
        out = np.empty(int(lengths.sum()), np.uint8)
        number = _gather(slots, len(lengths), lengths, senders, CRC_EXTRAS, out, self._groups, self._ends)
        data, begin, found = out.tobytes(), 0, []
        for group, end in zip(self._groups[:number].tolist(), self._ends[:number].tolist(), strict=True):
            found.append((group, data[begin:end]))
            begin = end
        return found


def warm_up_calls() -> list[jit.Call]:
    """List one call of each kernel."""
    numbers = np.zeros(1, np.int64)
    slots, out = np.zeros((1, 64), np.uint8), np.zeros(1, np.uint8)
    return [(_gather, slots, 0, numbers, numbers, CRC_EXTRAS, out, numbers, numbers)]
