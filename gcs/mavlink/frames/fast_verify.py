"""Signatures of many datagrams in one call: the fast form of `gcs.mavlink.frames.signing.Gate`.

A datagram of which everything is in order is framed by the compiled kernel (`gcs.mavlink.frames.fast_scan`);
what is left for each frame is its hash. Whenever anything is out of the ordinary (bytes in no frame, an id
not known here, a frame that is not signed, by another key, late, or the first of its stream) nothing is
noted, and the gate looks at the datagram in its own, simple way: theirs is the word on what is let in and
why.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from hashlib import sha256
from hmac import compare_digest
from typing import NamedTuple

from gcs.endpoints import Link
from gcs.mavlink.frames.fast_scan import COMPONENT, LENGTH, OFFSET, SIGNED, SYSTEM, Frames

_SIGNATURE = 6
_STAMP = 12
_LINK_ID = 13


class Verified(NamedTuple):
    """What a datagram that may come in says."""

    frames: int
    times: dict[str, int]
    """Signing time of each stream in it."""
    keys: dict[bytes, None]
    """In use, in order."""


class Verifier:
    """Checks datagrams; changes nothing.

    Parameters
    ----------
    key_of : callable
        Link and system id to key, None where nothing has to be signed.
    stream_of : callable
        Link, system id, component id and link id of a signature to the stream's name.
    streams : mapping
        Latest signing time of each stream, as it is at each call.
    """

    def __init__(
        self,
        key_of: Callable[[Link, int], bytes | None],
        stream_of: Callable[[Link, int, int, int], str],
        streams: Mapping[str, int],
    ) -> None:
        self._key_of, self._stream_of, self._streams = key_of, stream_of, streams
        self._frames = Frames()
        self._known: dict[str, dict[int, tuple[bytes, str]]] = {}
        """Key and stream by link, and by the sender's and the signature's ids in one number."""

    def check(self, link: Link, name: str, data: bytes) -> Verified | None:
        """Check a datagram of a link of this name; None when the gate must look itself."""
        frames = self._frames
        frames.take(data)
        if frames.bad_bytes or frames.unknown or not frames.found:
            return None
        known, streams = self._known.setdefault(name, {}), self._streams
        times: dict[str, int] = {}
        keys: dict[bytes, None] = {}
        last = 0
        columns = frames.table[1 : frames.found + 1, (OFFSET, LENGTH, SYSTEM, COMPONENT, SIGNED)]
        for offset, length, system, component, signed in columns.tolist():
            if not signed:
                return None
            end = offset + length
            link_id = data[end - _LINK_ID]
            sender = system << 16 | component << 8 | link_id
            entry = known.get(sender)
            if entry is None:
                entry = self._meet(link, known, sender, (system, component, link_id))
                if entry is None:
                    return None
            key, stream = entry
            stamp = int.from_bytes(data[end - _STAMP : end - _SIGNATURE], "little")
            before = times.get(stream) or streams.get(stream)
            if before is None or stamp <= before or stamp < last:
                return None  # in a datagram the gate goes by signing time
            proof = sha256(key + data[offset : end - _SIGNATURE]).digest()[:_SIGNATURE]
            if not compare_digest(proof, data[end - _SIGNATURE : end]):
                return None
            times[stream] = last = stamp
            keys[key] = None
        return Verified(frames.found, times, keys)

    def _meet(
        self, link: Link, known: dict[int, tuple[bytes, str]], sender: int, ids: tuple[int, int, int]
    ) -> tuple[bytes, str] | None:
        """Look up whose key and stream it is; only streams that the gate has let in are kept."""
        key, stream = self._key_of(link, ids[0]), self._stream_of(link, *ids)
        if key is None or stream not in self._streams:
            return None
        return known.setdefault(sender, (key, stream))
