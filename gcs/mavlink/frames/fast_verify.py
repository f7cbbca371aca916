"""Signature checks of whole datagrams as a compiled kernel: fast form of `signing.SigningGate`.

For anything irregular (bytes outside frames, an unknown id, an unsigned frame, a key in it, another key, a
late frame, the first of a sender) nothing is noted and the gate decides, frame by frame.

The kernel calls the SHA-256 of the OpenSSL that `hashlib` has loaded; that of the system where Python has
OpenSSL built in. Without such functions the gate decides on all.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import hashlib
import sys
from typing import Final

import numpy as np

from gcs import jit
from gcs.mavlink.frames.codec import (
    COMPONENT,
    LENGTH,
    MESSAGE_ID,
    OFFSET,
    SETUP_SIGNING,
    SIGNED,
    SYSTEM,
    FrameTable,
)
from gcs.mavlink.frames.codec import WIDTH as FRAME_WIDTH
from gcs.mavlink.frames.fast_scan import Bytes
from gcs.mavlink.frames.signing_times import LEAD, SAVED, TIME, SigningTimes
from gcs.mavlink.frames.signing_times import WIDTH as TIMES_WIDTH
from gcs.model import Int32Array, IntArray

_SIGNATURE_OFFSET: Final = 6
_TIMESTAMP_OFFSET: Final = 12
_LINK_ID_OFFSET: Final = 13
_CONTEXT_WORDS: Final = 16
"""At least OpenSSL's SHA256_CTX, 112 bytes."""
_CONTEXT, _DIGEST, _FIRST_KEY = range(3)
"""Rows of the contexts: of the hash in work, its digest, and that of the first key."""

_SENDER, _STREAM, _KEY = range(3)
_NONE: Final = -1


def _slot(senders: IntArray, sender: int) -> int:
    """Return the slot of a sender in the hash table; a free one if it is not there."""
    at = (sender * 0x9E3779B1 >> 16) & (len(senders) - 1)
    while senders[at, _SENDER] != sender and senders[at, _SENDER] != _NONE:
        at = (at + 1) & (len(senders) - 1)
    return at


_slot_of = jit.leaf(_slot)


@jit.leaf
def _six_bytes(data: Bytes, at: int) -> int:
    value = jit.int64(0)
    for k in range(6):
        value |= jit.int64(data[at + k]) << (8 * k)
    return value


@jit.kernel
def _verify(
    data: Bytes, frames: Int32Array, link: int, senders: IntArray, contexts: IntArray, update: int,
    final: int, times: IntArray, now: int, max_ahead: int, found: IntArray,
) -> tuple[int, bool]:  # fmt: skip
    """Verify a datagram, and advance the times of its streams, unless the gate must decide.

    `found` receives the row of the stream, its time before, and the row of the key of each frame.

    Returns the latest time, 0 if the gate must decide, and True if a stream runs ahead of its saved time.
    """
    count = 0
    last = jit.int64(0)
    for row in range(len(frames)):
        begin = jit.int64(frames[row, OFFSET])
        end = begin + frames[row, LENGTH]
        if not frames[row, SIGNED] or frames[row, MESSAGE_ID] == SETUP_SIGNING:
            break
        sender = link | (frames[row, SYSTEM] << 16) | (frames[row, COMPONENT] << 8)
        slot = _slot_of(senders, sender | jit.int64(data[end - _LINK_ID_OFFSET]))
        time = _six_bytes(data, end - _TIMESTAMP_OFFSET)
        stream = senders[slot, _STREAM]
        if senders[slot, _SENDER] == _NONE or time <= times[stream, TIME] or time < last:
            break  # in a datagram the gate goes by signing time
        key = senders[slot, _KEY]
        for k in range(_CONTEXT_WORDS):
            contexts[_CONTEXT, k] = contexts[key, k]
        jit.call_c(update, contexts, _CONTEXT, data, begin, end - _SIGNATURE_OFFSET - begin)
        jit.call_c(final, contexts, _DIGEST, contexts, _CONTEXT, 0)
        if (contexts[_DIGEST, 0] ^ _six_bytes(data, end - _SIGNATURE_OFFSET)) & 0xFFFFFFFFFFFF:
            break
        found[row, 0] = stream
        found[row, 1] = times[stream, TIME]
        found[row, 2] = key
        times[stream, TIME] = last = time
        count += 1
    is_ahead = False
    for row in range(count - 1, -1, -1):
        stream = found[row, 0]
        if count < len(frames):
            times[stream, TIME] = found[row, 1]
        else:
            time = times[stream, TIME]
            times[stream, LEAD] = max(times[stream, LEAD], time - now)
            is_ahead |= time > times[stream, SAVED] + max_ahead
    return last if count == len(frames) else 0, is_ahead


class _Sha256:
    """OpenSSL's SHA-256; `is_there` is False if it is not found, or does not do what `hashlib` does."""

    def __init__(self) -> None:
        try:
            import _hashlib

            path = getattr(_hashlib, "__file__", None)
            if path is None and sys.platform == "linux":  # others end programs that load their OpenSSL
                path = ctypes.util.find_library("crypto")
            library = ctypes.CDLL(path)
            self._init = library.SHA256_Init
            self._update = library.SHA256_Update
            final = library.SHA256_Final
        except (ImportError, AttributeError, OSError):
            self.is_there = False
            return
        self.update = ctypes.cast(self._update, ctypes.c_void_p).value or 0
        self.final = ctypes.cast(final, ctypes.c_void_p).value or 0
        digest = np.zeros(4, np.int64)
        final(digest.ctypes, self.begun(b"text").ctypes)
        self.is_there = digest.tobytes() == hashlib.sha256(b"text").digest()

    def begun(self, text: bytes) -> IntArray:
        """Return the context of a hash that begins with a text."""
        context = np.zeros(_CONTEXT_WORDS, np.int64)
        self._init(context.ctypes)
        self._update(context.ctypes, text, ctypes.c_size_t(len(text)))
        return context


class Verifier:
    """Checks datagrams of senders that the gate has accepted before.

    Parameters
    ----------
    times : SigningTimes
        Times of all streams; frames that are accepted advance them.
    """

    def __init__(self, times: SigningTimes) -> None:
        self._times = times
        self._sha256 = _Sha256()
        self._keys: list[bytes] = []
        self._contexts = np.zeros((_FIRST_KEY, _CONTEXT_WORDS), np.int64)
        self._known: dict[int, tuple[int, int]] = {}
        self._senders = np.full((64, 3), _NONE, np.int64)
        """Hash table of sender, row of its stream and row of its key; half of it is free at least."""
        self._found = np.zeros((64, 3), np.int64)

    def check(self, link: int, frames: FrameTable, now: int) -> tuple[list[bytes], int] | None:
        """Return the keys and the latest time of an accepted datagram; None if the gate must decide."""
        if frames.bad_bytes or frames.unknown or not frames.count or not self._known:
            return None
        if frames.count > len(self._found):
            self._found = np.zeros((2 * frames.count, 3), np.int64)
        latest, runs_ahead = _verify(
            frames.data, frames.rows, link << 24, self._senders, self._contexts, self._sha256.update,
            self._sha256.final, self._times.table, now, self._times.max_ahead(now), self._found,
        )  # fmt: skip
        if not latest:
            return None
        self._times.runs_ahead |= runs_ahead
        used = dict.fromkeys(self._found[: frames.count, 2].tolist())
        return [self._keys[key - _FIRST_KEY] for key in used], latest

    def add(self, link: int, system: int, component: int, link_id: int, stream: str, key: bytes) -> None:
        """Add a sender of which the gate has accepted a frame."""
        sender = (link << 24) | (system << 16) | (component << 8) | link_id
        if sender in self._known or not self._sha256.is_there:
            return
        if key not in self._keys:
            self._keys.append(key)
            self._contexts = np.vstack([self._contexts, self._sha256.begun(key)])
        self._known[sender] = self._times.rows[stream], _FIRST_KEY + self._keys.index(key)
        added = {sender: self._known[sender]}
        if 2 * len(self._known) > len(self._senders):
            self._senders = np.full((2 * len(self._senders), 3), _NONE, np.int64)
            added = self._known
        for one, rows in added.items():
            self._senders[_slot(self._senders, one)] = (one, *rows)


def warm_up_calls() -> list[jit.Call]:
    """Return one call of each kernel."""
    frames = np.zeros((1, FRAME_WIDTH), np.int32)
    numbers = np.zeros((1, max(3, TIMES_WIDTH)), np.int64)
    return [(_verify, b"\xfd", frames, 0, numbers, numbers, 0, 0, numbers, 0, 0, numbers)]
