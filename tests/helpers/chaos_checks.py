"""What must hold after a run of faults, from the recordings of all nodes and what the vehicles were sent."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Iterator
from itertools import chain, groupby, pairwise
from math import inf
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import parse
from gcs.core.engine import Engine
from gcs.core.snapshot import decode_state
from gcs.core.state import flown_routes
from gcs.errors import RecordingError
from gcs.io.cluster.event_log import decode_batch, digest, packed, unpacked
from gcs.io.record_json import decode as decode_record
from gcs.io.recording.reader import Damage, Record, read, read_info
from gcs.mavlink.frames.codec import decode
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Event,
    Notice,
    NoticeCode,
    OrderAnswer,
    Picture,
    Resumed,
    Scan,
    Send,
    Snapshot,
    Truth,
    TruthObject,
)
from helpers.chaos import Flight, Node, recordings_of
from helpers.heartbeat_tap import Sent

_SAME_S: Final = 3.0
"""Between the time at which a node recorded a datagram, and that at which the vehicle was sent it."""
_UNREADABLE_S: Final = 1.5
"""What a recording may lack before a `kill -9`."""


_PICTURE_SCANS: Final = 5
"""Until the picture is right after the end of a fault."""
_AHEAD_S: Final = 0.1
"""Of a clock of sensors before that of a node: half of the time that a busy machine takes to answer."""
_OFF_M: Final = 20.0
"""Of a track from its object."""


class _Kept(NamedTuple):
    node: Node
    folder: Path
    records: list[Record]
    damage: tuple[Damage, ...]

    @property
    def name(self) -> str:
        return self.folder.name


def operational_picture(engine: Engine) -> dict[str, object]:
    """Return what must be the same with and without a restart or a take-over."""
    engine_state = engine.state
    return {
        "target labels": sorted(engine.stages.trackers.targets.confirmation.tracks),
        "statuses": {v: one.perception.status.status for v, one in engine_state.agents.items()},
        "targets of agents": {v: route.target for v, route in flown_routes(engine_state.agents).items()},
        "authorities": {v: one.control.authority.word for v, one in engine_state.agents.items()},
    }


def check(flight: Flight) -> None:
    """Add to `flight.problems` what does not hold."""
    kept = _recordings(flight)
    sent = sorted(flight.tap.sent)
    flight.problems += _two_nodes(flight, kept, sent)
    flight.problems += repeated_missions(sent)
    flight.problems += unverified_missions(sent)
    flight.problems += _repeated_orders(list(_while_they_command(kept)))
    flight.problems += _other_states(flight, kept)
    flight.problems += _lost(kept)
    flight.problems += _wrong_clocks(flight, kept)
    flight.problems += _wrong_pictures(flight)
    for node in flight.nodes:
        said = (flight.folder / f"{node.name}.log").read_text()
        flight.problems += [
            f"{node.name}: {line}"
            for line in said.splitlines()
            if "the state differs" in line or "Traceback" in line
        ]


def _recordings(flight: Flight) -> list[_Kept]:
    """Read all recordings, in order; note those that are not readable to the last second."""
    found = []
    for node in flight.nodes:
        kept = sorted(_readable(flight, node), key=_begin_t_ns)
        begins_s = [_unix_s(flight, _begin_t_ns(one)) for one in kept]
        for one, begin_s, next_s in zip(kept, begins_s, [*begins_s, inf][1:], strict=True):
            ends_s = min((end_s for end_s in node.ends_unix_s if begin_s < end_s < next_s), default=None)
            last_s = _unix_s(flight, one.records[-1].t_ns)
            if ends_s is None:
                flight.problems += [f"recording {one.name}: {damage.problem}" for damage in one.damage]
            elif ends_s - last_s > _UNREADABLE_S:
                flight.problems.append(f"recording {one.name} lacks its last {ends_s - last_s:.1f} s")
        found += kept
    return sorted(found, key=lambda one: one.records[0].t_ns)


def _readable(flight: Flight, node: Node) -> Iterator[_Kept]:
    """Read the recordings of a node that have records; note those that cannot be read."""
    for folder in recordings_of(flight.folder, node):
        try:
            records = list(read(folder))
        except RecordingError as error:
            flight.problems.append(f"recording {folder.name}: {error}")
            continue
        damage = tuple(record.value for record in records if isinstance(record.value, Damage))
        records = [record for record in records if not isinstance(record.value, Damage)]
        if records:
            yield _Kept(node, folder, records, damage)


def _begin_t_ns(kept: _Kept) -> int:
    """Return the time of the first record; a snapshot before it has the time at which it was saved."""
    return next(
        (one.t_ns for one in kept.records if not isinstance(one.value, Snapshot)), kept.records[-1].t_ns
    )


def _while_they_command(kept: list[_Kept]) -> Iterator[_Kept]:
    """Leave out what a command that stood still recorded before it knew that it was replaced."""
    for one, after in pairwise(kept):
        begins = [record.t_ns for record in after.records if isinstance(record.value, Resumed)]
        end_t_ns = begins[0] if begins else one.records[-1].t_ns + 1
        yield one._replace(records=[record for record in one.records if record.t_ns < end_t_ns])
    yield from kept[-1:]


def _unix_s(flight: Flight, t_ns: int) -> float:
    return (flight.epoch_ns + (t_ns - flight.epoch_ns) / flight.speed) / NS_PER_S


def _t_ns(flight: Flight, unix_s: float) -> int:
    return flight.epoch_ns + int((unix_s * NS_PER_S - flight.epoch_ns) * flight.speed)


def _two_nodes(flight: Flight, kept: list[_Kept], sent: list[Sent]) -> Iterator[str]:
    """Datagrams of two nodes must not alternate at one vehicle: each node has one period of time."""
    times = defaultdict[tuple[str, bytes], dict[str, list[float]]](dict)
    for one in kept:
        for record in one.records:
            if isinstance(record.value, Send):
                place = times[record.value.peer, record.value.data]
                place.setdefault(one.name, []).append(_unix_s(flight, record.t_ns))
    owners = defaultdict[str, list[tuple[str, float]]](list)
    for datagram in sent:
        if datagram.is_up:
            continue
        nodes = [
            name
            for name, recorded in times[datagram.peer, datagram.data].items()
            if _is_near(recorded, datagram.unix_s)
        ]
        if len(nodes) == 1:
            owners[datagram.peer].append((nodes[0], datagram.unix_s))
    for peer, one_vehicle in owners.items():
        periods = [name for name, _ in groupby(name for name, _ in one_vehicle)]
        for name, count in Counter(periods).items():
            if count > 1:
                yield f"vehicle at {peer}: {name} reached it {count} times, between other nodes: {periods}"
    if not owners:
        yield "no datagram to a vehicle could be matched with a recording"


def _is_near(times: list[float], at_s: float) -> bool:
    index = bisect_left(times, at_s - _SAME_S)
    return index < len(times) and times[index] < at_s + _SAME_S


def repeated_missions(sent: list[Sent]) -> Iterator[str]:
    """No vehicle is sent a mission that it has taken already."""
    taken: dict[str, dict[int, object]] = {}
    coming: dict[str, dict[int, object]] = {}
    size: dict[str, int] = {}
    for datagram in sent:
        peer = datagram.peer
        for message in decode(datagram.data)[0]:
            if message.get_type() == "MISSION_COUNT" and not datagram.is_up and not message.mission_type:
                coming[peer] = {}
                size[peer] = message.count
            elif message.get_type() == "MISSION_ITEM_INT" and not message.mission_type and peer in coming:
                coming[peer][message.seq] = _place(message)
            elif message.get_type() == "MISSION_ACK" and datagram.is_up and not message.mission_type:
                items = coming.pop(peer, None)
                if items is None or message.type != dialect.MAV_MISSION_ACCEPTED or len(items) != size[peer]:
                    continue
                if taken.get(peer) == items:
                    yield f"vehicle at {peer} was sent an equal mission of {len(items)} items again"
                taken[peer] = items


def unverified_missions(sent: list[Sent]) -> Iterator[str]:
    """No vehicle is told to fly a mission that was not read back whole since its last upload."""
    is_changed: dict[str, bool] = {}
    size: dict[str, int] = {}
    read_back = defaultdict[str, set[int]](set)
    for datagram in sent:
        peer = datagram.peer
        for message in decode(datagram.data)[0]:
            if getattr(message, "mission_type", 0):
                continue
            kind = message.get_type()
            if kind == "MISSION_COUNT" and datagram.is_up:
                size[peer] = message.count
                read_back[peer] = set()
            elif kind == "MISSION_ITEM_INT" and datagram.is_up:
                read_back[peer].add(message.seq)
                if len(read_back[peer]) == size.get(peer):
                    is_changed[peer] = False
            elif kind == "MISSION_COUNT" and not datagram.is_up:
                is_changed[peer] = True
            elif kind == "MISSION_SET_CURRENT" and not datagram.is_up and is_changed.get(peer):
                yield f"vehicle at {peer} was told to fly a mission that was not read back"


def _place(item: dialect.MAVLink_mission_item_int_message) -> tuple[object, ...]:
    parameters = (item.param1, item.param2, item.param3, item.param4)
    return (item.frame, item.command, *map(str, parameters), item.x, item.y, item.z)


def _repeated_orders(kept: list[_Kept]) -> Iterator[str]:
    """Each order has one result for each vehicle, whichever node gave it.

    A node that has lost the lease sends nothing; it may still see what it had ordered. So may the node that
    replaces it, before it has sent anything.
    """
    results = Counter[tuple[str, int]]()
    for one in kept:
        has_lease = True
        commanded = set[int]()
        for record in one.records:
            answer = record.value
            if isinstance(answer, Send):
                commanded |= _set_modes(answer.data)
            elif isinstance(answer, Notice) and answer.code in (
                NoticeCode.LEASE_MISSING,
                NoticeCode.LEASE_AGAIN,
            ):
                has_lease = answer.code is NoticeCode.LEASE_AGAIN
            elif isinstance(answer, OrderAnswer) and answer.vehicle is not None and answer.state == "done":
                results[answer.order_id, answer.vehicle] += has_lease and answer.vehicle in commanded
    for (order, vehicle), count in results.items():
        if count > 1:
            yield f"order {order} was carried out {count} times by vehicle {vehicle}"


def _set_modes(datagram: bytes) -> set[int]:
    """Return the vehicles that a datagram sets to a mode."""
    return {
        message.target_system
        for message in decode(datagram)[0]
        if message.get_type() == "COMMAND_LONG" and message.command == dialect.MAV_CMD_DO_SET_MODE
    }


def _wrong_pictures(flight: Flight) -> Iterator[str]:
    """The picture is right within some scans after the end of each fault."""
    truths = {truth.t_ns: truth for truth in (decode_record("truth", one, Truth) for one in flight.truths)}
    pictures = defaultdict[int, list[Picture]](list)
    for key, payload in flight.pictures:
        picture = decode_record(key, payload, Picture)
        pictures[picture.scan_t_ns].append(picture)
    begun_t_ns = [_t_ns(flight, begun) for begun in flight.begun_unix_s]
    for number, (fault, healed_unix_s) in enumerate(flight.healed, 1):
        next_t_ns = begun_t_ns[number] if number < len(begun_t_ns) else inf
        later = sorted(t_ns for t_ns in truths if _t_ns(flight, healed_unix_s) < t_ns < next_t_ns)
        right = (n for n, t_ns in enumerate(later, 1) if _is_right(truths[t_ns], pictures[t_ns]))
        scans = next(right, None)
        if scans is not None:
            flight.scans_to_picture.append(scans)
        if (len(later) if scans is None else scans) > _PICTURE_SCANS:
            yield f"after {fault} the picture was right after {scans or len(later)} scans"


def _is_right(truth: Truth, pictures: list[Picture]) -> bool:
    """Return True if both kinds have one track at each object and no other."""
    for kind in ("agents", "targets"):
        objects = [one for one in truth.objects if one.kind == kind and one.alive]
        if not any(_shows(one, objects) for one in pictures if one.kind == kind):
            return False
    return True


def _shows(picture: Picture, objects: list[TruthObject]) -> bool:
    tracks = [track.mean[:2] for track in picture.tracks if track.estimated]
    places = [np.array([one.east_m, one.north_m]) for one in objects]
    is_near = (any(np.hypot(*(place - track)) < _OFF_M for track in tracks) for place in places)
    return len(tracks) == len(places) and all(is_near)


def _lost(kept: list[_Kept]) -> Iterator[str]:
    """`deterministic` loses no agent."""
    for one in kept:
        for record in one.records:
            if isinstance(record.value, AgentStatus) and record.value.status in ("lost", "down"):
                yield f"{one.name}: vehicle {record.value.vehicle} {record.value.status}"


def _wrong_clocks(flight: Flight, kept: list[_Kept]) -> Iterator[str]:
    """No node's clock is behind that of the sensors, however often command has changed."""
    for one in kept:
        scans = [record for record in one.records if isinstance(record.value, Scan)]
        ahead_s = [(one.value.measured_t_ns - one.t_ns) / flight.speed / NS_PER_S for one in scans]
        if scans and float(np.median(ahead_s)) > _AHEAD_S:
            yield f"{one.name}: its clock is {np.median(ahead_s):.2f} s behind that of the sensor"


def _other_states(flight: Flight, kept: list[_Kept]) -> Iterator[str]:
    """The state with which a standby takes over is that of the command before it."""
    for before, after in pairwise(kept):
        first = [record.value for record in after.records[:2]]
        if len(first) < 2 or "takes over" not in (flight.folder / f"{after.node.name}.log").read_text():
            continue  # it began with the journal, or clean
        snapshot, resumed = first
        if not isinstance(snapshot, Snapshot) or not isinstance(resumed, Resumed):
            yield f"{after.name} does not begin with a state"
            continue
        expected, last_t_ns = _engine_at(before, flight.events, snapshot.t_ns)
        found = _engine(before.folder)
        found.state = decode_state(after.name, snapshot.data)
        if last_t_ns != snapshot.t_ns:  # neither recorded nor seen by the observer
            flight.uncompared += 1
            continue
        if digest(expected.state) == digest(found.state):
            continue
        parts = operational_picture(found)
        for part, value in operational_picture(expected).items():
            if parts[part] != value:
                yield f"{after.name}: {part} {parts[part]}; of {before.name} {value}"
        yield f"{after.name}: its state differs from that of {before.name} at the same event"


def _engine(folder: Path) -> Engine:
    info = read_info(folder)
    assert info.run is not None
    return Engine(parse(info.config_text, folder.name), info.run.seed)


def _engine_at(kept: _Kept, batches: list[bytes], t_ns: int) -> tuple[Engine, int]:
    """Return the engine after the events of a recording until a time, and the time of the last one.

    What the recording lacks at its end is in the batches.
    """
    engine = _engine(kept.folder)
    values = [record.value for record in kept.records]
    snapshots = [n for n, one in enumerate(values) if isinstance(one, Snapshot) and one.t_ns <= t_ns]
    begin = 0
    if snapshots:
        begin = snapshots[-1]
        snapshot = values[begin]
        assert isinstance(snapshot, Snapshot)
        engine.state = decode_state(kept.name, snapshot.data)
    events = [one for one in values[begin:] if isinstance(one, Event) and not isinstance(one, Truth)]
    last = max((one for one in values[:begin] if isinstance(one, Event)), key=_event_t_ns, default=None)
    for event in chain(events, _later(batches, events[-1] if events else last)):
        if event.t_ns > t_ns:
            break
        engine.step(event)
        last = event
    return engine, last.t_ns if last else 0


def _event_t_ns(event: Event) -> int:
    return event.t_ns


def _later(batches: list[bytes], last: Event | None) -> Iterator[Event]:
    """Return the events of a command after one of its events, as far as no batch is missing.

    By number: events can have equal times, and a node that was replaced may go on sending its own.
    """
    number = None
    wanted = packed(last) if last else None
    for payload in batches:
        batch = decode_batch("events", payload)
        for n, event in enumerate(batch.events, batch.first):
            if n == number:
                yield unpacked(*event)
                number += 1
            elif number is None and event == wanted:
                number = n + 1
