"""Records as MCAP messages and tlog entries, hundreds in one call.

Nine records of ten are datagrams that came or went. Each is written as JSON with its bytes in base64
(RFC 4648) into a message of the MCAP (https://mcap.dev/spec, opcode 5: length, channel, sequence, log time,
publish time, data), and frame by frame into the tlog. By itself each of these is a short step; in Python
they were most of what recording costs. `_pack` takes them for a whole batch.

What is the same for all datagrams of a peer is its *form*: a channel, and the JSON before the bytes. All
other records come as JSON already, and each topic is a form as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from gcs import jit
from gcs.io.recording.tlog import tlog_entries
from gcs.io.zenoh.messages import Recordable, encode, topic_of
from gcs.model import Datagram, Send

Numbers: TypeAlias = npt.NDArray[np.int64]
UploadQueue: TypeAlias = tuple[Recordable, int, bytes]
"""A record, its time, and its JSON where somebody has made it already."""

_PLAIN, _SENT, _HEARD = 0, 1, 2
"""Kinds of forms: JSON as it comes; of a `Send`; of a `Datagram`, whose time stands before the head."""
_TRAFFIC: Final = (Datagram, Send)
_LEAD: Final = 9
"""Bytes of a message's opcode and length; its length counts from behind them."""
_MOST_EXTRA: Final = 80
"""Bytes of a message beside its form's head and twice its data."""
_MOST_FORMS: Final = 4096
_MOST_BYTES: Final = 512 * 1024
"""Of data that are packed at once, unless one record has more."""
_LETTERS: Final = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
_TIME: Final = b'{"t_ns":'
_NOT_FRAMES: Final = -1


@jit.leaf
def _put(out, at, value, size):  # type: ignore[no-untyped-def]
    """Write a number, little end first; return the place behind it."""
    for k in range(size):
        out[at + k] = value >> 8 * k & 0xFF
    return at + size


@jit.leaf
def _put_time(out, at, t_ns):  # type: ignore[no-untyped-def]
    """Write the beginning of a datagram's JSON."""
    for k in range(len(_TIME)):
        out[at + k] = _TIME[k]
    at += len(_TIME)
    if t_ns < 0:
        out[at] = 0x2D
        at += 1
        t_ns = -t_ns
    digits, rest = 1, t_ns // 10
    while rest:
        digits, rest = digits + 1, rest // 10
    for k in range(digits - 1, -1, -1):
        out[at + k] = 0x30 + t_ns % 10
        t_ns //= 10
    return at + digits


@jit.leaf
def _put_base64(out, at, data, begin, end):  # type: ignore[no-untyped-def]
    for k in range(begin, end, 3):
        word, left = np.int64(0), 0
        for j in range(3):
            word <<= 8
            if k + j < end:
                word |= np.int64(data[k + j])
                left += 1
        for j in range(4):
            out[at + j] = _LETTERS[word >> 18 - 6 * j & 63] if j <= left else 0x3D
        at += 4
    return at


@jit.leaf
def _put_entries(log, at, data, begin, end, t_us):  # type: ignore[no-untyped-def]
    """Write the frames that fill a datagram from end to end, each with its stamp; see `split_frames`."""
    while begin < end:
        if data[begin] == 0xFD and begin + 12 <= end:
            length = 12 + data[begin + 1] + 13 * (data[begin + 2] & 1)
        elif data[begin] == 0xFE and begin + 8 <= end:
            length = 8 + np.int64(data[begin + 1])
        else:
            return _NOT_FRAMES
        if begin + length > end:
            return _NOT_FRAMES
        for k in range(8):
            log[at + k] = t_us >> 56 - 8 * k & 0xFF
        for k in range(length):
            log[at + 8 + k] = data[begin + k]
        at += 8 + length
        begin += length
    return at


@jit.leaf
def _pack_all(data, ends, forms, times_ns, sequence, table, heads, out, places, log):  # type: ignore[no-untyped-def]
    at = begin = logged = 0
    for i in range(len(ends)):
        start, end, form, t_ns = at, ends[i], forms[i], max(times_ns[i], 0)
        kind = table[form, 1]
        at = _put(out, start + _LEAD, table[form, 0], 2)
        at = _put(out, at, sequence + i, 4)
        at = _put(out, at, t_ns, 8)
        at = _put(out, at, t_ns, 8)
        if kind == _PLAIN:
            for k in range(begin, end):
                out[at + k - begin] = data[k]
            at += end - begin
        else:
            if kind == _HEARD:
                at = _put_time(out, at, times_ns[i])
            for k in range(table[form, 2], table[form, 3]):
                out[at] = heads[k]
                at += 1
            at = _put_base64(out, at, data, begin, end)
            out[at], out[at + 1] = 0x22, 0x7D
            at += 2
            if logged != _NOT_FRAMES:
                logged = _put_entries(log, logged, data, begin, end, t_ns // 1000)
        out[start] = 5
        _put(out, start + 1, at - start - _LEAD, 8)
        places[i, 0], places[i, 1] = t_ns, start
        begin = end
    return at, logged


@jit.kernel
def _pack(data, ends, forms, times_ns, sequence, table, heads, out, places, log):  # type: ignore[no-untyped-def]
    """Write messages to `out`, their times and places, and entries to `log`; return the sizes of both.

    `table` (forms, 4) has channel, kind, and where in `heads` the form's head begins and ends. The log's size
    is `_NOT_FRAMES` when a datagram is not made of frames.
    """
    return _pack_all(data, ends, forms, times_ns, sequence, table, heads, out, places, log)


class Packed(NamedTuple):
    """Some records, written."""

    messages: bytes
    channels: npt.NDArray[np.uint16]
    """(n,) channel of each message."""
    places: npt.NDArray[np.uint64]
    """(n, 2) log time of each message, and where in `messages` it begins."""
    log: bytes
    """Entries of the tlog."""


class Packer:
    """Writes records; `channels` has the number of each type's channel, and of each topic's of pictures."""

    def __init__(self, channels: Mapping[type | str, int]) -> None:
        self._channels = channels
        self._begin_forms()

    def _begin_forms(self) -> None:
        self._forms: dict[Any, int] = {}
        self._rows: list[tuple[int, int, int, int]] = []
        self._heads = b""
        for key, channel in self._channels.items():
            self._form(key, channel, _PLAIN, b"")

    def _form(self, key: Any, channel: int, kind: int, head: bytes) -> int:
        """Note a form; return its number."""
        begin = len(self._heads)
        self._heads += head
        self._rows.append((channel, kind, begin, len(self._heads)))
        self._table = np.array(self._rows)
        self._longest_head = max(end - start for _, _, start, end in self._rows)
        return self._forms.setdefault(key, len(self._rows) - 1)

    def _traffic_form(self, record: Datagram | Send) -> int:
        text = encode(replace(record, data=b"")).removesuffix(b'"}')
        kind = _HEARD if isinstance(record, Datagram) else _SENT
        head = text[text.index(b",") :] if kind == _HEARD else text
        key = (type(record), record.link, record.peer)
        return self._form(key, self._channels[type(record)], kind, head)

    def pack(self, records: Sequence[UploadQueue], sequence: int) -> Iterator[Packed]:
        """Write records, numbered from `sequence` on, in pieces of bounded size."""
        times = [t_ns for _, t_ns, _ in records]
        try:
            times_ns, in_range = np.array(times, np.int64), True
        except OverflowError:  # what they hold themselves stays as it is
            times_ns, in_range = np.array([min(max(t, 0), 2**63 - 1) for t in times]), False
        formed, data = self._formed(records, in_range)
        forms = np.array(formed)
        ends = np.cumsum(np.fromiter(map(len, data), np.int64, len(data)))
        first = 0
        while first < len(data):
            begin = int(ends[first - 1]) if first else 0
            last = max(first + 1, int(np.searchsorted(ends, begin + _MOST_BYTES, "right")))
            some = slice(first, last)
            yield self._packed(data[some], ends[some] - begin, forms[some], times_ns[some], sequence + first)
            first = last

    def _formed(self, records: Sequence[UploadQueue], in_range: bool) -> tuple[list[int], list[bytes]]:
        """Return the form of each record, and what is written in it."""
        if len(self._forms) > _MOST_FORMS:
            self._begin_forms()
        of, forms, data = self._forms, [], []
        for record, _, payload in records:
            if in_range and isinstance(record, _TRAFFIC):
                form = of.get((type(record), record.link, record.peer))
                forms.append(self._traffic_form(record) if form is None else form)
                data.append(record.data)
            else:
                form = of.get(type(record))
                forms.append(of[topic_of(record)] if form is None else form)
                data.append(payload or encode(record))
        return forms, data

    def _packed(
        self, data: list[bytes], ends: Numbers, forms: Numbers, times_ns: Numbers, sequence: int
    ) -> Packed:
        size = len(data) * (_MOST_EXTRA + self._longest_head) + 2 * int(ends[-1])
        out, log = np.empty(size, np.uint8), np.empty(2 * int(ends[-1]), np.uint8)
        places = np.empty((len(data), 2), np.uint64)
        one = b"".join([*data, b" "])  # an array of no bytes has no type of its own
        heads = np.frombuffer(self._heads + b" ", np.uint8)
        size, logged = _pack(
            np.frombuffer(one, np.uint8),
            ends,
            forms,
            times_ns,
            sequence,
            self._table,
            heads,
            out,
            places,
            log,
        )
        rows = self._table[forms]
        if logged == _NOT_FRAMES:
            traffic = np.flatnonzero(rows[:, 1] != _PLAIN).tolist()
            entries = b"".join(tlog_entries(int(places[number, 0]), data[number]) for number in traffic)
        else:
            entries = log[:logged].tobytes()
        return Packed(out[:size].tobytes(), rows[:, 0].astype(np.uint16), places, entries)


def warm_up_calls() -> list[jit.Call]:
    """List one call of each kernel."""
    text, out, numbers = np.frombuffer(b" ", np.uint8), np.zeros(99, np.uint8), np.zeros(1, np.int64)
    places, table = np.zeros((1, 2), np.uint64), np.zeros((1, 4), np.int64)
    return [(_pack, text, numbers, numbers, numbers, 0, table, text, out, places, out)]
