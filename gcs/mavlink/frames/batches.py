"""Batches of the datagrams of a sender, up to a size, so that a flood costs the service few events.

Datagrams of one wake-up are concatenated by sender, in order, up to the size of a radio's datagram. Only
datagrams that consist of good frames of known ids are concatenated, so that a scan of the batch finds the
same. Senders may overtake each other, as on UDP; the order of each sender is kept.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from gcs import jit
from gcs.mavlink.frames.codec import CHECKED, WIDTH
from gcs.mavlink.frames.fast_scan import CRC_EXTRAS, Bytes, frame_at
from gcs.model import ByteArray, Int16Array, Int32Array, IntArray

MAX_BYTES: Final = 1400
_MAX_GATHERED_BYTES: Final = MAX_BYTES // 2
"""Size up to which a datagram is batched. Two larger ones do not fit into a batch, and a check costs time."""
_HASH_SLOTS: Final = 1024
_NO_GROUP: Final = -1


@jit.leaf
def _is_clean(data: Bytes, end: int, extras: Int16Array, scratch: Int32Array) -> bool:
    at = 0
    while at < end:
        length = frame_at(data, at, end, extras, scratch, 0)
        if length <= 0 or scratch[0, CHECKED] == 0:
            return False
        at += length
    return True


@jit.leaf
def _group(
    slots: ByteArray, count: int, lengths: IntArray, senders: IntArray, extras: Int16Array,
    scratch: Int32Array, group_of: IntArray, sizes: IntArray, last_group: IntArray, out: ByteArray,
    groups: IntArray, ends: IntArray,
) -> int:  # fmt: skip
    number = 0
    for i in range(count):
        slot = ((senders[i] >> 16) ^ (senders[i] >> 40)) & (_HASH_SLOTS - 1)
        clean = lengths[i] <= _MAX_GATHERED_BYTES and _is_clean(slots[i], lengths[i], extras, scratch)
        group = last_group[slot] if clean else _NO_GROUP
        if (
            group == _NO_GROUP
            or senders[groups[group]] != senders[i]
            or sizes[group] + lengths[i] > MAX_BYTES
        ):
            group = number
            groups[group] = i
            number += 1
        last_group[slot] = group if clean else _NO_GROUP
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
def _gather(
    slots: ByteArray, count: int, lengths: IntArray, senders: IntArray, extras: Int16Array, out: ByteArray,
    groups: IntArray, ends: IntArray,
) -> int:  # fmt: skip
    """Copy datagrams, grouped, into `out`; return the number of groups.

    `groups` receives the index of a datagram of each group, `ends` the group's end in `out`.
    """
    scratch = np.empty((1, WIDTH), np.int32)
    group_of = np.empty(count, np.int64)
    sizes = np.zeros(count, np.int64)
    last_group = np.empty(_HASH_SLOTS, np.int64)
    last_group[:] = _NO_GROUP
    return _group(
        slots, count, lengths, senders, extras, scratch, group_of, sizes, last_group, out, groups, ends
    )


class DatagramBatcher:
    """Concatenates up to `count` datagrams."""

    def __init__(self, count: int) -> None:
        self._groups = np.zeros(count, np.int64)
        self._ends = np.zeros(count, np.int64)

    def gather(self, slots: ByteArray, lengths: IntArray, senders: IntArray) -> list[tuple[int, bytes]]:
        """Return (index of a datagram of the sender, data) of each group, in order of their beginning.

        `slots` (n, max_bytes) holds the datagrams; `lengths` and `senders` are (n,).
        """
        out = np.empty(int(lengths.sum()), np.uint8)
        number = _gather(slots, len(lengths), lengths, senders, CRC_EXTRAS, out, self._groups, self._ends)
        data = out.tobytes()
        begin = 0
        found = []
        for group, end in zip(self._groups[:number].tolist(), self._ends[:number].tolist(), strict=True):
            found.append((group, data[begin:end]))
            begin = end
        return found


def warm_up_calls() -> list[jit.Call]:
    """Return one call of each kernel."""
    numbers = np.zeros(1, np.int64)
    slots = np.zeros((1, 64), np.uint8)
    out = np.zeros(1, np.uint8)
    return [(_gather, slots, 0, numbers, numbers, CRC_EXTRAS, out, numbers, numbers)]
