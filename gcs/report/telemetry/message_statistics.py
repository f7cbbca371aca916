"""Message statistics of a stream of MAVLink frames (`gcs info`): senders, firmware, rates, loss.

Loss is read from the sequence number, which a sender counts modulo 256
(https://mavlink.io/en/guide/packet_loss.html). After a gap of more than 255 frames it is a lower bound. A
ground station may count per vehicle, so it has no loss. A step backwards is a reordered or duplicate frame.

Memory grows with the number of senders and message types only.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Frame, Message
from gcs.model import NS_PER_S
from gcs.safe_text import printable

GAP_NS: Final = 5 * NS_PER_S
"""Time without frames of a sender that counts as a gap."""
_MAX_LISTED: Final = 1000
_MAX_SENDERS: Final = 4096
_GROUND_COMPONENTS: Final = (GCS_COMPONENT_ID, 190)
_READ: Final = frozenset(
    {
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
        dialect.MAVLINK_MSG_ID_STATUSTEXT,
        dialect.MAVLINK_MSG_ID_MISSION_COUNT,
        dialect.MAVLINK_MSG_ID_MISSION_ITEM,
        dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT,
        dialect.MAVLINK_MSG_ID_MISSION_ACK,
    }
)
_FIRMWARE_TEXT: Final = re.compile(r"(?:Ardu|APM:|PX4)\w* V?\d[\w.-]*")
_RELEASE: Final = {0: "-dev", 64: "-alpha", 128: "-beta", 192: "-rc"}


@dataclass(slots=True)
class _Kind:
    count: int
    first_t_ns: int
    last_t_ns: int


@dataclass(slots=True)
class _Sender:
    first_t_ns: int
    last_t_ns: int
    frames: int = 0
    version_1: int = 0
    signed: int = 0
    lost: int = 0
    sequence: int = -1
    type: str = ""
    autopilot: str = ""
    firmware: str = ""
    kinds: dict[int, _Kind] = field(default_factory=dict)
    gaps: list[tuple[int, int]] = field(default_factory=list)
    """(start, duration)."""
    gap_count: int = 0


@dataclass(slots=True)
class _Transfer:
    t_ns: int
    giver: int
    taker: int
    items: int
    mission_type: int
    seen: set[int] = field(default_factory=set)
    result: str = ""


class Traffic:
    """Counts frames; `summary` returns plain data."""

    def __init__(self) -> None:
        self.frames = 0
        self.unknown_ids: Counter[int] = Counter()
        self.bad_checksums: Counter[tuple[int, int, int]] = Counter()
        self._senders: dict[tuple[int, int], _Sender] = {}
        self._transfers: list[_Transfer] = []
        self._under_way: dict[tuple[int, int], _Transfer] = {}
        self._more_transfers = 0

    def add_frame(self, t_ns: int, frame: Frame) -> None:
        """Count a frame with a valid checksum."""
        self.frames += 1
        key = (frame.system_id, frame.component_id)
        sender = self._senders.get(key)
        if sender is None:
            if len(self._senders) >= _MAX_SENDERS:
                return
            sender = self._senders[key] = _Sender(t_ns, t_ns)
        silent_ns = t_ns - sender.last_t_ns
        if silent_ns > GAP_NS:
            sender.gap_count += 1
            if len(sender.gaps) < _MAX_LISTED:
                sender.gaps.append((sender.last_t_ns, silent_ns))
        sender.last_t_ns = max(t_ns, sender.last_t_ns)
        sender.frames += 1
        sender.version_1 += frame.data[0] == 0xFE
        sender.signed += frame.signed
        if sender.sequence >= 0:
            step = (frame.sequence - sender.sequence) & 0xFF
            sender.lost += step - 1 if 0 < step < 128 else 0
        sender.sequence = frame.sequence
        kind = sender.kinds.get(frame.message_id)
        if kind is None:
            sender.kinds[frame.message_id] = _Kind(1, t_ns, t_ns)
        else:
            kind.count += 1
            kind.last_t_ns = t_ns
        if frame.message_id in _READ and (message := frame.message()) is not None:
            self._read(t_ns, frame, sender, message)

    def add_unknown_frame(self, frame: Frame) -> None:
        """Count a frame with a message id that the dialect does not have."""
        if len(self.unknown_ids) < _MAX_LISTED or frame.message_id in self.unknown_ids:
            self.unknown_ids[frame.message_id] += 1

    def add_bad_frame(self, frame: Frame) -> None:
        """Count a frame with a wrong checksum."""
        key = (frame.system_id, frame.component_id, frame.message_id)
        if len(self.bad_checksums) < _MAX_LISTED or key in self.bad_checksums:
            self.bad_checksums[key] += 1

    def _read(self, t_ns: int, frame: Frame, sender: _Sender, message: Message) -> None:
        match message.get_type():
            case "HEARTBEAT":
                sender.type = _enum("MAV_TYPE", message.type)
                sender.autopilot = _enum("MAV_AUTOPILOT", message.autopilot)
            case "AUTOPILOT_VERSION":
                sender.firmware = _version(message.flight_sw_version) or sender.firmware
            case "STATUSTEXT":
                found = _FIRMWARE_TEXT.search(printable(str(message.text)))
                if found and len(found[0]) > len(sender.firmware):
                    sender.firmware = found[0]
            case "MISSION_ACK":
                pair = message.target_system, frame.system_id
                transfer = self._under_way.get(pair)
                if transfer is not None:
                    transfer.result = _enum("MAV_MISSION", message.type, "MAV_MISSION_RESULT")
                    if message.type != dialect.MAV_MISSION_INVALID_SEQUENCE:  # ArduPilot continues then
                        del self._under_way[pair]
            case "MISSION_COUNT":
                self._begin(t_ns, frame.system_id, message)
            case _:
                transfer = self._under_way.get((frame.system_id, message.target_system))
                if transfer is not None:
                    transfer.seen.add(message.seq)

    def _begin(self, t_ns: int, giver: int, message: Message) -> None:
        taker = message.target_system
        items = message.count
        mission_type = getattr(message, "mission_type", 0)
        known = self._under_way.get((giver, taker))
        if (
            known is not None
            and not known.seen
            and (known.items, known.mission_type) == (items, mission_type)
        ):
            return  # Repeated.
        transfer = _Transfer(t_ns, giver, taker, items, mission_type)
        self._under_way[giver, taker] = transfer
        if len(self._transfers) < _MAX_LISTED:
            self._transfers.append(transfer)
        else:
            self._more_transfers += 1

    def summary(self) -> dict[str, Any]:
        """Return the counts; times in nanoseconds, as given."""
        senders = [
            (key, sender, _is_ground_station(*key, sender)) for key, sender in sorted(self._senders.items())
        ]
        return {
            "frames": self.frames,
            "vehicles": [_sender(*key, sender) for key, sender, ground in senders if not ground],
            "ground_stations": [_sender(*key, sender) for key, sender, ground in senders if ground],
            "missions": [
                {
                    "t_ns": transfer.t_ns,
                    "from": transfer.giver,
                    "to": transfer.taker,
                    "kind": _enum("MAV_MISSION_TYPE", transfer.mission_type).lower(),
                    "items": transfer.items,
                    "items_seen": len(transfer.seen),
                    "result": transfer.result or "no acknowledgement seen",
                }
                for transfer in self._transfers
            ],
            "more_missions": self._more_transfers,
            "unknown_ids": {str(key): count for key, count in sorted(self.unknown_ids.items())},
            "bad_checksums": [
                {"system": system, "component": component, "message_id": message_id, "count": count}
                for (system, component, message_id), count in sorted(self.bad_checksums.items())
            ],
        }


def rate_hz(count: int, first_t_ns: int, last_t_ns: int) -> float | None:
    """Return the mean rate of `count` events between first and last; None if undefined."""
    return (count - 1) * NS_PER_S / (last_t_ns - first_t_ns) if last_t_ns > first_t_ns else None


def _sender(system_id: int, component_id: int, sender: _Sender) -> dict[str, Any]:
    ground = _is_ground_station(system_id, component_id, sender)
    version = "1" if sender.version_1 else "2"
    if 0 < sender.version_1 < sender.frames:
        version = "1 and 2"
    return {
        "system": system_id,
        "component": component_id,
        "type": sender.type.lower(),
        "autopilot": sender.autopilot.lower(),
        "firmware": sender.firmware,
        "mavlink": version,
        "signed": sender.signed,
        "frames": sender.frames,
        "rate_hz": rate_hz(sender.frames, sender.first_t_ns, sender.last_t_ns),
        "lost": None if ground else sender.lost,
        "first_t_ns": sender.first_t_ns,
        "last_t_ns": sender.last_t_ns,
        "gaps": [{"t_ns": t_ns, "seconds": length_ns / NS_PER_S} for t_ns, length_ns in sender.gaps],
        "gap_count": sender.gap_count,
        "messages": {
            _name(message_id): {
                "count": kind.count,
                "rate_hz": rate_hz(kind.count, kind.first_t_ns, kind.last_t_ns),
            }
            for message_id, kind in sorted(sender.kinds.items())
        },
    }


def _is_ground_station(system_id: int, component_id: int, sender: _Sender) -> bool:
    return sender.type == "GCS" or (
        not sender.type and (system_id == GCS_SYSTEM_ID or component_id in _GROUND_COMPONENTS)
    )


def _name(message_id: int) -> str:
    definition = dialect.mavlink_map.get(message_id)
    return str(message_id) if definition is None else str(definition.msgname)


def _enum(prefix: str, value: int, enum: str = "") -> str:
    entry = dialect.enums[enum or prefix].get(value)
    return str(value) if entry is None else str(entry.name).removeprefix(prefix + "_")


def _version(packed: int) -> str:
    if packed == 0:
        return ""
    major, minor, patch, release = packed.to_bytes(4, "big")
    return f"{major}.{minor}.{patch}{_RELEASE.get(release, '')}"
