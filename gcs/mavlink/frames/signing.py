"""MAVLink 2 message signing (https://mavlink.io/en/guide/message_signing.html).

A signed frame has bit 0 of its incompatibility flags set, and 13 bytes after its checksum::

    link id (1)   timestamp (6, little endian, 10 us since 2015-01-01 UTC)   signature (6)

The signature is the first 48 bits of SHA-256(secret key (32), frame up to and including the timestamp). The
checksum covers the flag. A CRC is linear: setting the flag changes it by a value that depends on the frame's
length only. So frames of unknown messages can be signed as well.

Where there is a key, a frame must be signed with it, and later than any frame before of the same (system,
component, link id). The first frame of such a stream may be at most a minute behind our time. Our time never
goes back and follows the latest valid signature. Only valid frames advance a stream, else a forger could
silence a vehicle. RADIO_STATUS is accepted unsigned, as the specification asks: the radios send it.
SETUP_SIGNING is never accepted or forwarded: it carries a key, and accepted frames are recorded.

Pure: frames and times in, frames out. Nothing raises on any frame, and no text contains a key.
"""

from __future__ import annotations

import hashlib
import hmac
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link
from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.frames.codec import MAGIC_V2, SETUP_SIGNING, SIGNED_FLAG, Frame, FrameTable, target_of
from gcs.mavlink.frames.signing_times import SigningTimes, Stream
from gcs.model import NS_PER_S, network_of, vehicle_id

if TYPE_CHECKING:
    from gcs.mavlink.frames.fast_verify import Verifier

KEY_BYTES: Final = 32
EPOCH_S: Final = 1_420_070_400
"""2015-01-01T00:00:00Z."""
MIN_SIGNED_LATER_NS: Final = 2 * NS_PER_S
"""A vehicle whose frames from a new address are signed this much later has moved there. The frames from the
old address are a replay."""
TICKS_PER_S: Final = 100_000
MAX_STALE_TICKS: Final = 60 * TICKS_PER_S

NS_PER_TICK: Final = 10_000
_MAYBE_SETUP: Final = re.compile(b"\xfd.{6}" + re.escape(SETUP_SIGNING.to_bytes(3, "little")), re.DOTALL)
_RADIO: Final = (dialect.MAVLINK_MSG_ID_RADIO_STATUS, dialect.MAVLINK_MSG_ID_RADIO)
_MAX_STREAMS: Final = 16_384
_MAX_ADDRESSES: Final = 1024
_ANSWER_EVERY_NS: Final = NS_PER_S
"""Time between two answers to one address with stale frames, which may be replayed."""
_MAX_ANSWERS: Final = 16
"""Answers in that time to all addresses together."""


def _flag_changes() -> tuple[int, ...]:
    """Return the change of the checksum by the signed flag, by payload length."""
    changes = []
    crc = dialect.x25crc(None)
    crc.crc = 0
    crc.accumulate(bytes((SIGNED_FLAG, *[0] * 8)))  # the flag, seven bytes of header, the definition's byte
    for _ in range(256):
        changes.append(crc.crc)
        crc.accumulate(b"\0")
    return tuple(changes)


_FLAG_CHANGES: Final = _flag_changes()


def timestamp_of(t_ns: int) -> int:
    """Return the signing time of a Unix time in nanoseconds."""
    return max(0, t_ns // NS_PER_TICK - EPOCH_S * TICKS_PER_S)


def passphrase_key(passphrase: str) -> bytes:
    """Return the key of a passphrase, as Mission Planner and MAVProxy derive it: its SHA-256."""
    return hashlib.sha256(passphrase.encode()).digest()


def fingerprint(key: bytes) -> str:
    """Return 8 hex digits that identify a key without revealing it."""
    return hashlib.sha256(b"fingerprint" + key).hexdigest()[:8]


def signed(frame: bytes, key: bytes, link_id: int, timestamp: int) -> bytes:
    """Return a MAVLink 2 frame signed; an existing signature is replaced."""
    body = bytearray(frame[: 12 + frame[1]])
    if not body[2] & SIGNED_FLAG:
        body[2] |= SIGNED_FLAG
        change = _FLAG_CHANGES[body[1]]
        body[-2] ^= change & 0xFF
        body[-1] ^= change >> 8
    body.append(link_id)
    body += timestamp.to_bytes(6, "little")
    return bytes(body + hashlib.sha256(key + body).digest()[:6])


def is_signed_by(frame: bytes, key: bytes) -> bool:
    """Return True if a signed frame's signature is this key's."""
    return hmac.compare_digest(hashlib.sha256(key + frame[:-6]).digest()[:6], frame[-6:])


def signed_t_ns(frame: Frame) -> int | None:
    """Return the Unix time in a frame's signature in nanoseconds; None if unsigned."""
    return signing_time(frame) * NS_PER_TICK + EPOCH_S * NS_PER_S if frame.signed else None


def signing_time(frame: Frame) -> int:
    """Return the timestamp in a frame's signature; 0 if unsigned."""
    return int.from_bytes(frame.data[-12:-6], "little") if frame.signed else 0


@dataclass(frozen=True, slots=True)
class Keys:
    """Signing keys: a vehicle's own, else its link's, else the default."""

    vehicles: Mapping[int, bytes] = field(default_factory=dict, repr=False)
    """By `gcs.model.vehicle_id`."""
    links: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    """By the endpoint's canonical form. Other ground stations have these only."""
    default: bytes | None = field(default=None, repr=False)

    def key_for(self, link: Link, system_id: int) -> bytes | None:
        """Return the key of a sender on a link; None if its frames need no signature."""
        if link.role != "vehicles":
            return self.links.get(link.name)
        own = self.vehicles.get(vehicle_id(link.network, system_id))
        return own or self.links.get(link.name) or self.default

    def has_any_on(self, link: Link) -> bool:
        """Return True if any sender on a link has a key."""
        if link.name in self.links:
            return True
        here = any(network_of(vehicle) == link.network for vehicle in self.vehicles)
        return link.role == "vehicles" and (self.default is not None or here)


@dataclass(slots=True)
class SigningCounters:
    """Counters of one link."""

    verified: int = 0
    """Signed frames accepted."""
    signed: int = 0
    """Frames that we signed."""
    rejected: dict[str, int] = field(default_factory=Counter)
    """Frames rejected, by reason."""
    last: dict[str, str] = field(default_factory=dict)
    """Sender of the last of these."""


class SigningGate:
    """Checks and signs the frames of all links.

    Parameters
    ----------
    keys : Keys
    links : iterable of Link
        In the order of the mission file: the index is the link id of our signatures.
    timestamp : int
        Signing time that an earlier run had reached.
    streams : mapping
        Latest signing time of each stream then.
    """

    def __init__(
        self,
        keys: Keys,
        links: Iterable[Link],
        timestamp: int = 0,
        streams: Mapping[Stream, int] | None = None,
    ) -> None:
        self.timestamp = timestamp
        self.times = SigningTimes(streams or {})
        self.counters: dict[str, SigningCounters] = {}
        self._keys = keys
        self.links = {link.name: link for link in links}
        self._ids = {name: number % 256 for number, name in enumerate(self.links)}
        self._keyed = {name: keys.has_any_on(link) for name, link in self.links.items()}
        self._keys_at: dict[Address, dict[bytes, None]] = {}
        """Keys that verified frames from an address."""
        self._stale_senders: dict[Address, None] = {}
        self._answered_t_ns: dict[Address, int] = {}
        """Time of the last answer to a stale sender."""
        self._numbers = {name: number for number, name in enumerate(self.links)}
        self._verifier: Verifier | None = None
        if any(self._keyed.values()):
            from gcs.mavlink.frames.fast_verify import Verifier

            self._verifier = Verifier(self.times)

    def is_keyed(self, link: str, system_id: int | None = None) -> bool:
        """Return True if frames of a system on a link must be signed; without a system id: of any system."""
        if system_id is None:
            return self._keyed.get(link, False)
        return link in self.links and self._keys.key_for(self.links[link], system_id) is not None

    # ------------------------------------------------------------ in

    def accept_frames(self, t_ns: int, address: Address, frames: FrameTable) -> bytes:
        """Return the accepted part of a datagram: unchanged, unless a frame is rejected."""
        data = frames.data
        is_keyed = self._keyed[address[0]]
        if is_keyed and self._verifier is not None:
            verified = self._verifier.check(self._numbers[address[0]], frames, timestamp_of(t_ns))
            if verified is not None:
                keys, latest = verified
                self._counters_of(address[0]).verified += frames.count
                for key in keys:
                    self._note_key(address, key)
                self.timestamp = max(self.timestamp, latest)
                return data
        has_setup = _MAYBE_SETUP.search(data) is not None
        if not (has_setup or is_keyed):
            return data
        link = self.links[address[0]]
        in_order = sorted(frames, key=signing_time)
        kept = [frame.data for frame in in_order if self._is_accepted(t_ns, address, link, frame)]
        hides = frames.bad_bytes and has_setup  # a damaged frame may hold most of a key
        return data if len(kept) == frames.count and not hides else b"".join(kept)

    def _note_key(self, address: Address, key: bytes) -> None:
        if len(self._keys_at) < _MAX_ADDRESSES or address in self._keys_at:
            self._keys_at.setdefault(address, {})[key] = None

    def _is_accepted(self, t_ns: int, address: Address, link: Link, frame: Frame) -> bool:
        key = self._keys.key_for(link, frame.system_id)
        reason = self._rejection(t_ns, address, link, frame, key)
        if not reason and key is None:
            return True
        counters = self._counters_of(link.name)
        if reason:
            counters.rejected[reason] += 1
            counters.last[reason] = f"system {frame.system_id}/{frame.component_id} at {address[1]}"
        elif frame.signed:
            counters.verified += 1
        return not reason

    def _rejection(self, t_ns: int, address: Address, link: Link, frame: Frame, key: bytes | None) -> str:
        """Return why a frame is rejected; empty if it is accepted, which advances its stream."""
        if frame.message_id == SETUP_SIGNING:
            return "SETUP_SIGNING, which carries a key"
        if key is None or (not frame.signed and frame.message_id in _RADIO):
            return ""
        if not frame.signed:
            return "not signed" if frame.data[0] == MAGIC_V2 else "MAVLink 1, which cannot be signed"
        if not is_signed_by(frame.data, key):
            return "signed with another key"
        self._note_key(address, key)
        timestamp = signing_time(frame)
        now = max(self.timestamp, timestamp_of(t_ns))
        link_id = frame.data[-13]
        stream = _stream_of(link, frame.system_id, frame.component_id, link_id)
        before = self.times.latest_of(stream)
        if before is not None and timestamp <= before:
            self._note_stale_sender(address)
            return "signed before the last one: sent again, or overtaken"
        if before is None and timestamp < now - MAX_STALE_TICKS:
            self._note_stale_sender(address)
            return "signed more than a minute ago"
        if before is None and len(self.times.rows) >= _MAX_STREAMS:
            return "too many senders"
        self.times.advance(stream, timestamp, timestamp_of(t_ns))
        self.timestamp = max(self.timestamp, timestamp)
        if self._verifier is not None:
            number = self._numbers[link.name]
            self._verifier.add(number, frame.system_id, frame.component_id, link_id, stream, key)
        return ""

    def _note_stale_sender(self, address: Address) -> None:
        if len(self._stale_senders) < _MAX_ADDRESSES:
            self._stale_senders[address] = None

    def take_stale_senders(self, t_ns: int) -> list[Address]:
        """Return the addresses to answer: of frames with good signatures that were too old.

        An autopilot without the time of day signs with the time of its last flight. It takes the time from
        the first valid frame that it receives. Such frames may also be replayed: one answer a second to each
        address, and few to all, give nobody a lever.
        """
        stale = list(self._stale_senders)
        self._stale_senders = {}
        recent = {a: at for a, at in self._answered_t_ns.items() if 0 <= t_ns - at < _ANSWER_EVERY_NS}
        due = [address for address in stale if address not in recent][: _MAX_ANSWERS - len(recent)]
        self._answered_t_ns = recent | dict.fromkeys(due, t_ns)
        return due

    # ------------------------------------------------------------ out

    def sign_frames(self, t_ns: int, address: Address, frames: Iterable[Frame]) -> bytes:
        """Return frames for an address: signed where there is a key.

        A frame for all vehicles at an address with several keys is sent once with each.
        """
        if not self._keyed[address[0]]:
            return b"".join(frame.data for frame in frames)
        link = self.links[address[0]]
        out = bytearray()
        for frame in frames:
            keys = self._keys_to(link, address, frame)
            if not keys:
                out += frame.data
            elif frame.data[0] != MAGIC_V2:
                self._counters_of(link.name).rejected["MAVLink 1 for a signed link"] += 1
            for key in keys if frame.data[0] == MAGIC_V2 else ():
                self.timestamp = max(self.timestamp + 1, timestamp_of(t_ns))
                self._counters_of(link.name).signed += 1
                out += signed(frame.data, key, self._ids[link.name], self.timestamp)
        return bytes(out)

    def _counters_of(self, link: str) -> SigningCounters:
        return self.counters.setdefault(link, SigningCounters())

    def _keys_to(self, link: Link, address: Address, frame: Frame) -> tuple[bytes, ...]:
        target = 0 if link.role != "vehicles" else (target_of(frame) or (0, 0))[0]
        if target == 0 and address in self._keys_at:
            return tuple(self._keys_at[address])
        key = self._keys.key_for(link, target)
        return () if key is None else (key,)


def _stream_of(link: Link, system_id: int, component_id: int, link_id: int) -> Stream:
    sender = f"{link.network}/{system_id}/{component_id}/{link_id}"
    return sender if link.role == "vehicles" else f"{link.name} {sender}"
