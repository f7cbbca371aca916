"""MAVLink 2 message signing: who may speak on a link (https://mavlink.io/en/guide/message_signing.html).

A signed frame has bit 0 of its incompatibility flags set and 13 bytes behind its checksum::

    link id (1)   timestamp (6, little endian, 10 us since 2015-01-01 UTC)   signature (6)

the signature being the first 48 bits of SHA-256(secret key (32), the frame up to and with the timestamp). The
flag is under the checksum. A CRC is linear, so setting one bit changes it by what depends on the frame's
length alone: frames of messages that we do not know can be signed as well.

What is checked of a frame for which there is a key: that it is signed, by that key, and later than any frame
before it of the same (system, component, link id); the first frame of such a stream may be at most a minute
behind our time. Our own time never goes back and follows the latest that was validly signed. A stream's time
is moved by valid frames only, else a forger could silence a vehicle. RADIO_STATUS is let in unsigned, as the
specification asks: the radios themselves send it. SETUP_SIGNING is let in by nobody and sent on to nobody: it
carries a key, and what is let in is recorded.

Pure: frames and times in, frames out. Nothing here raises on any frame, and no key is in any text.
"""

from __future__ import annotations

import hashlib
import hmac
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link
from gcs.mavlink.fleet.vehicle import Address
from gcs.mavlink.frames.codec import Frame, scan, target_of
from gcs.model import NS_PER_S, network_of, vehicle_id

if TYPE_CHECKING:
    from gcs.mavlink.frames.fast_verify import Verified, Verifier

KEY_BYTES: Final = 32
EPOCH_S: Final = 1_420_070_400
"""2015-01-01T00:00:00Z."""
MIN_SIGNED_LATER_NS: Final = 2 * NS_PER_S
"""A vehicle's frames from a new address that are signed this much later than those from the old one show
that the old ones are not its own: they were recorded, and are sent again."""
TICKS_PER_S: Final = 100_000
MAX_STALE_TICKS: Final = 60 * TICKS_PER_S

Stream: TypeAlias = str
"""Who is told apart by time: "network/system/component/link id"; on a guests' endpoint, its name before."""

NS_PER_TICK: Final = 10_000
_V2: Final = 0xFD
_SIGNED: Final = 0x01
_BLOCK: Final = 13
_SETUP_SIGNING: Final[int] = dialect.MAVLINK_MSG_ID_SETUP_SIGNING
_MAYBE_SETUP: Final = re.compile(b"\xfd.{6}" + re.escape(_SETUP_SIGNING.to_bytes(3, "little")), re.DOTALL)
_RADIO: Final = (dialect.MAVLINK_MSG_ID_RADIO_STATUS, dialect.MAVLINK_MSG_ID_RADIO)
_MAX_STREAMS: Final = 16_384
_MAX_AHEAD: Final = TICKS_PER_S // 5
"""How far a stream may run ahead of its saved time: less than a service needs to start again."""
_MAX_ADDRESSES: Final = 1024


def _flag_changes() -> tuple[int, ...]:
    """What the signed flag changes in the checksum, by the payload's length."""
    changes = []
    crc = dialect.x25crc(None)
    crc.crc = 0
    crc.accumulate(bytes((_SIGNED, *[0] * 8)))  # the flag, seven bytes of header, the definition's byte
    for _ in range(256):
        changes.append(crc.crc)
        crc.accumulate(b"\0")
    return tuple(changes)


_FLAG_CHANGES: Final = _flag_changes()


def timestamp_of(t_ns: int) -> int:
    """Signing time of a Unix time in nanoseconds."""
    return max(0, t_ns // NS_PER_TICK - EPOCH_S * TICKS_PER_S)


def passphrase_key(passphrase: str) -> bytes:
    """Key of a passphrase as Mission Planner and MAVProxy make it: its SHA-256."""
    return hashlib.sha256(passphrase.encode()).digest()


def fingerprint(key: bytes) -> str:
    """Name a key without giving it away: 8 hex digits."""
    return hashlib.sha256(b"fingerprint" + key).hexdigest()[:8]


def signed(frame: bytes, key: bytes, link_id: int, timestamp: int) -> bytes:
    """Return a MAVLink 2 frame signed; a signature that it has is replaced."""
    body = bytearray(frame[: 12 + frame[1]])
    if not body[2] & _SIGNED:
        body[2] |= _SIGNED
        change = _FLAG_CHANGES[body[1]]
        body[-2] ^= change & 0xFF
        body[-1] ^= change >> 8
    body.append(link_id)
    body += timestamp.to_bytes(6, "little")
    return bytes(body + hashlib.sha256(key + body).digest()[:6])


def is_signed_by(frame: bytes, key: bytes) -> bool:
    """Whether the signature of a signed frame is this key's."""
    return hmac.compare_digest(hashlib.sha256(key + frame[:-6]).digest()[:6], frame[-6:])


def signed_t_ns(frame: Frame) -> int | None:
    """Return the Unix time in a frame's signature in nanoseconds; None when it is not signed."""
    return signing_time(frame) * NS_PER_TICK + EPOCH_S * NS_PER_S if frame.signed else None


def signing_time(frame: Frame) -> int:
    """Timestamp in a frame's signature; 0 when it is not signed."""
    return int.from_bytes(frame.data[-12:-6], "little") if frame.signed else 0


@dataclass(frozen=True, slots=True)
class Keys:
    """Which key is whose: a vehicle's own, else its link's, else the one for all vehicles."""

    vehicles: Mapping[int, bytes] = field(default_factory=dict, repr=False)
    """By `gcs.model.vehicle_id`."""
    links: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    """By the endpoint's canonical form; the only keys for other ground stations."""
    default: bytes | None = field(default=None, repr=False)

    def of(self, link: Link, system_id: int) -> bytes | None:
        """Key of somebody who speaks on a link; None when nothing has to be signed."""
        if link.role != "vehicles":
            return self.links.get(link.name)
        own = self.vehicles.get(vehicle_id(link.network, system_id))
        return own or self.links.get(link.name) or self.default

    def any_on(self, link: Link) -> bool:
        """Whether anybody's frames are signed on a link."""
        if link.name in self.links:
            return True
        here = any(network_of(vehicle) == link.network for vehicle in self.vehicles)
        return link.role == "vehicles" and (self.default is not None or here)


@dataclass(slots=True)
class GateCounters:
    """What one link's gate did."""

    verified: int = 0
    """Signed frames let in."""
    signed: int = 0
    """Frames that we signed."""
    rejected: Counter[str] = field(default_factory=Counter)
    """Frames kept out, by reason."""
    last: dict[str, str] = field(default_factory=dict)
    """Who sent the last of these, in words."""


class Gate:
    """Every link's signing, in and out.

    Parameters
    ----------
    keys : Keys
    links : iterable of Link
        In the order of the mission file: a link's number there is the link id of what we sign.
    timestamp : int
        Signing time that an earlier run had reached.
    streams : mapping
        Latest signing time of each stream then.
    kernel : bool
        Whether datagrams that are in order are checked the fast way (`gcs.mavlink.frames.fast_verify`).
    """

    def __init__(
        self,
        keys: Keys,
        links: Iterable[Link],
        timestamp: int = 0,
        streams: Mapping[Stream, int] | None = None,
        *,
        kernel: bool = False,
    ) -> None:
        self.timestamp = timestamp
        self.streams: dict[Stream, int] = dict(streams or {})
        self.counters: dict[str, GateCounters] = {}
        self._keys = keys
        self.links = {link.name: link for link in links}
        self._ids = {name: number % 256 for number, name in enumerate(self.links)}
        self._keyed = {name: keys.any_on(link) for name, link in self.links.items()}
        self._heard: dict[Address, dict[bytes, None]] = {}
        """Keys by which frames from an address were verified."""
        self._behind: dict[Address, None] = {}
        self._leads: dict[Stream, int] = {}
        """Most that a stream was ahead of our clock since times were saved; it may be negative."""
        self._saved: tuple[int, Mapping[Stream, int]] = 0, {}
        """Signing time when times were saved, and the streams' then."""
        self.runs_ahead = False
        """True if a stream is ahead of its saved time: after a crash now, its frames could be replayed."""
        self._verifier: Verifier | None = None
        if kernel and any(self._keyed.values()):
            from gcs.mavlink.frames.fast_verify import Verifier

            self._verifier = Verifier(keys.of, _stream_of, self.streams)

    def is_keyed(self, link: str, system_id: int | None = None) -> bool:
        """Whether somebody's frames on a link must be signed; without a system id: anybody's."""
        if system_id is None:
            return self._keyed.get(link, False)
        return link in self.links and self._keys.of(self.links[link], system_id) is not None

    # ------------------------------------------------------------ in

    def admit(self, t_ns: int, address: Address, data: bytes) -> bytes:
        """Return what may come in of a datagram: all of it as it came, unless a frame is kept out."""
        has_setup = _MAYBE_SETUP.search(data) is not None
        if not (has_setup or self._keyed[address[0]]):
            return data
        link = self.links[address[0]]
        if self._verifier is not None and not has_setup:
            verified = self._verifier.check(link, address[0], data)
            if verified is not None:
                self._note(t_ns, address, verified)
                return data
        found = scan(data)
        frames = sorted((*found.frames, *found.unchecked), key=signing_time)
        kept = [frame.data for frame in frames if self._is_admitted(t_ns, address, link, frame)]
        hides = found.bad_bytes and has_setup  # a damaged frame may hold most of a key
        return data if len(kept) == len(frames) and not hides else b"".join(kept)

    def _note(self, t_ns: int, address: Address, verified: Verified) -> None:
        """Take in what a whole datagram of good frames says."""
        self._count(address[0]).verified += verified.frames
        for key in verified.keys:
            self._hear(address, key)
        for stream, timestamp in verified.times.items():
            self._advance(stream, timestamp, timestamp_of(t_ns))

    def _advance(self, stream: Stream, timestamp: int, now: int) -> None:
        """Move a stream's time, and ours with it."""
        self.streams[stream] = timestamp
        self.timestamp = max(self.timestamp, timestamp)
        lead = timestamp - now
        self._leads[stream] = max(lead, self._leads.get(stream, lead))
        then, saved = self._saved
        if stream not in saved or timestamp > saved[stream] + now - then + _MAX_AHEAD:
            self.runs_ahead = True

    def times_to_save(self, t_ns: int) -> dict[Stream, int]:
        """Return the time of each stream, ahead of every frame that it may send until `t_ns`.

        A stream runs on with the clock. So a time that is saved, and moved on by the time since, is not
        behind any frame accepted meanwhile, and behind those that the stream sends from then on.
        """
        now = timestamp_of(t_ns)
        times = {s: max(time, now + self._leads.get(s, time - now)) for s, time in self.streams.items()}
        self._leads.clear()
        self._saved = now, times
        self.runs_ahead = False
        return times

    def _hear(self, address: Address, key: bytes) -> None:
        if len(self._heard) < _MAX_ADDRESSES or address in self._heard:
            self._heard.setdefault(address, {})[key] = None

    def _is_admitted(self, t_ns: int, address: Address, link: Link, frame: Frame) -> bool:
        key = self._keys.of(link, frame.system_id)
        reason = self._reason(t_ns, address, link, frame, key)
        if not reason and key is None:
            return True
        counters = self._count(link.name)
        if reason:
            counters.rejected[reason] += 1
            counters.last[reason] = f"system {frame.system_id}/{frame.component_id} at {address[1]}"
        elif frame.signed:
            counters.verified += 1
        return not reason

    def _reason(self, t_ns: int, address: Address, link: Link, frame: Frame, key: bytes | None) -> str:
        """Say why a frame is kept out; empty when it is let in, and then it counts."""
        if frame.message_id == _SETUP_SIGNING:
            return "SETUP_SIGNING, which carries a key"
        if key is None or (not frame.signed and frame.message_id in _RADIO):
            return ""
        if not frame.signed:
            return "not signed" if frame.data[0] == _V2 else "MAVLink 1, which cannot be signed"
        if not is_signed_by(frame.data, key):
            return "signed with another key"
        self._hear(address, key)
        timestamp, now = signing_time(frame), max(self.timestamp, timestamp_of(t_ns))
        stream = _stream(link, frame)
        before = self.streams.get(stream)
        if before is not None and timestamp <= before:
            self._note_behind(address)
            return "signed before the last one: sent again, or overtaken"
        if before is None and timestamp < now - MAX_STALE_TICKS:
            self._note_behind(address)
            return "signed more than a minute ago"
        if before is None and len(self.streams) >= _MAX_STREAMS:
            return "too many senders"
        self._advance(stream, timestamp, timestamp_of(t_ns))
        return ""

    def _note_behind(self, address: Address) -> None:
        if len(self._behind) < _MAX_ADDRESSES:
            self._behind[address] = None

    def take_stale_senders(self) -> list[Address]:
        """Return, once, where frames with good signatures came from that were too old.

        An autopilot without the time of day signs with the time of its last flight, and takes the time from
        the first valid frame that it hears: it needs to hear one.
        """
        behind, self._behind = list(self._behind), {}
        return behind

    # ------------------------------------------------------------ out

    def sign_frames(self, t_ns: int, address: Address, data: bytes) -> bytes:
        """Return frames as they are to go out: signed where there is a key, as they came where there is none.

        What is for all vehicles at an address where several keys are in use goes out once with each.
        """
        if not self._keyed[address[0]]:
            return data
        link = self.links[address[0]]
        found, out = scan(data), bytearray()
        for frame in (*found.frames, *found.unchecked):
            keys = self._keys_to(link, address, frame)
            if not keys:
                out += frame.data
            elif frame.data[0] != _V2:
                self._count(link.name).rejected["MAVLink 1 for a signed link"] += 1
            for key in keys if frame.data[0] == _V2 else ():
                self.timestamp = max(self.timestamp + 1, timestamp_of(t_ns))
                self._count(link.name).signed += 1
                out += signed(frame.data, key, self._ids[link.name], self.timestamp)
        return bytes(out)

    def _count(self, link: str) -> GateCounters:
        return self.counters.setdefault(link, GateCounters())

    def _keys_to(self, link: Link, address: Address, frame: Frame) -> tuple[bytes, ...]:
        target = 0 if link.role != "vehicles" else (target_of(frame) or (0, 0))[0]
        if target == 0 and address in self._heard:
            return tuple(self._heard[address])
        key = self._keys.of(link, target)
        return () if key is None else (key,)


def _stream(link: Link, frame: Frame) -> Stream:
    return _stream_of(link, frame.system_id, frame.component_id, frame.data[-13])


def _stream_of(link: Link, system_id: int, component_id: int, link_id: int) -> Stream:
    who = f"{link.network}/{system_id}/{component_id}/{link_id}"
    return who if link.role == "vehicles" else f"{link.name} {who}"
