"""Signature checks of whole datagrams: fast form of `signing.SigningGate`.

Of a regular datagram only the hashes remain to be checked here. For anything irregular (bytes outside frames,
an unknown id, an unsigned frame, another key, a late frame, the first of its stream) nothing is noted and the
gate decides, frame by frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from hashlib import sha256
from hmac import compare_digest
from typing import NamedTuple

from gcs.endpoints import Link
from gcs.mavlink.frames.codec import FrameTable

_HASH_BYTES = 6
_TIMESTAMP_OFFSET = 12
_LINK_ID_OFFSET = 13


class Verified(NamedTuple):
    """Contents of a datagram that is accepted."""

    frames: int
    times: dict[str, int]
    """Signing time of each stream in it."""
    keys: dict[bytes, None]
    """Keys in use, in order."""


class Verifier:
    """Checks datagrams; changes nothing.

    Parameters
    ----------
    key_of : callable
        Link and system id to key; None where no signature is needed.
    stream_of : callable
        Link, system id, component id and link id of a signature to the stream's name.
    streams : mapping
        Latest signing time of each stream, at the time of the call.
    """

    def __init__(
        self,
        key_of: Callable[[Link, int], bytes | None],
        stream_of: Callable[[Link, int, int, int], str],
        streams: Mapping[str, int],
    ) -> None:
        self._key_of = key_of
        self._stream_of = stream_of
        self._streams = streams
        self._senders: dict[str, dict[int, tuple[bytes, str]]] = {}
        """Key and stream by link, and by the sender's and the signature's ids in one number."""

    def check(self, link: Link, name: str, frames: FrameTable) -> Verified | None:
        """Check a datagram of a link of this name; None if the gate must decide."""
        data = frames.data
        if frames.bad_bytes or frames.unknown or not data:
            return None
        senders = self._senders.setdefault(name, {})
        streams = self._streams
        times: dict[str, int] = {}
        keys: dict[bytes, None] = {}
        last = 0
        for offset, length, _, system, component, _, signed, _ in frames.rows.tolist():
            if not signed:
                return None
            end = offset + length
            link_id = data[end - _LINK_ID_OFFSET]
            sender = (system << 16) | (component << 8) | link_id
            entry = senders.get(sender)
            if entry is None:
                entry = self._add_sender(link, senders, sender, (system, component, link_id))
                if entry is None:
                    return None
            key, stream = entry
            timestamp = int.from_bytes(data[end - _TIMESTAMP_OFFSET : end - _HASH_BYTES], "little")
            before = times.get(stream) or streams.get(stream)
            if before is None or timestamp <= before or timestamp < last:
                return None  # in a datagram the gate goes by signing time
            digest = sha256(key + data[offset : end - _HASH_BYTES]).digest()[:_HASH_BYTES]
            if not compare_digest(digest, data[end - _HASH_BYTES : end]):
                return None
            times[stream] = last = timestamp
            keys[key] = None
        return Verified(frames.count, times, keys)

    def _add_sender(
        self, link: Link, senders: dict[int, tuple[bytes, str]], sender: int, ids: tuple[int, int, int]
    ) -> tuple[bytes, str] | None:
        """Look up key and stream of a sender; only accepted streams are kept."""
        key = self._key_of(link, ids[0])
        stream = self._stream_of(link, *ids)
        if key is None or stream not in self._streams:
            return None
        return senders.setdefault(sender, (key, stream))
