"""A journal that somebody changed would end the service in flight: its values are checked on load."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.other_station import AIR, SEAT, Stage
from helpers.recorded_state import events_of
from msgspec.msgpack import decode, encode
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.engine import Engine
from gcs.core.snapshot import decode_state, encode_state
from gcs.core.tasking.tasking_state import OnboardMission
from gcs.errors import WireError
from gcs.mavlink.mission.items import Item
from gcs.model import NS_PER_S, Event, Resumed, Route, Tick, read_only

RECORDING = Path(__file__).parents[1] / "recordings" / "orders.mcap"
Place = tuple[str | int, ...]


class Flight:
    """A recorded flight up to an upload after the given part of its events."""

    def __init__(self, part: float) -> None:
        self.config, self.seed, events = events_of(RECORDING)
        engine, begin = Engine(self.config, self.seed), int(part * len(events))
        for number, event in enumerate(events):
            engine.step(event)
            if number >= begin and engine.state.tasking.uploads:
                break
        self.t_ns, self.later = event.t_ns, events[number + 1 :]
        self.data = encode_state(engine.state)
        self.plain = decode(self.data, strict=False)

    def changed(self, place: Place, value: object) -> bytes:
        return encode(put(self.plain, place, value))

    def goes_on(self, data: bytes, events: int) -> bool:
        """Return True if an engine continues from a state; False if it refuses it with a reason."""
        engine = Engine(self.config, self.seed)
        try:
            engine.state = decode_state("test", data)
        except (WireError, ValueError):
            return False
        following: list[Event] = [Resumed(self.t_ns, self.t_ns - NS_PER_S), *self.later[:events]]
        for event in following:
            engine.step(event)
        encode_state(engine.state)
        return True


@pytest.fixture(scope="module")
def flight() -> Flight:
    return Flight(0.2)


def put(root: Any, place: Place, value: object) -> Any:
    """Return a copy with another value at a place."""
    if not place:
        return value
    copy = dict(root) if isinstance(root, dict) else list(root)
    copy[place[0]] = put(root[place[0]], place[1:], value)
    return copy


def is_array(value: object) -> bool:
    return isinstance(value, list) and len(value) == 3 and isinstance(value[2], bytes)


def leaves(value: Any, place: Place = (), name: tuple[str, ...] = ()) -> Iterator[tuple[str, Place, Any]]:
    """Yield name, place and value of each scalar and array; entries of one container share a name."""
    if isinstance(value, dict):
        for key, one in value.items():
            yield from leaves(one, (*place, key), (*name, key if isinstance(key, str) else "*"))
    elif isinstance(value, list) and not is_array(value):
        for number, one in enumerate(value):
            yield from leaves(one, (*place, number), (*name, "#"))
    else:
        yield f"{'/'.join(name)} {type(value).__name__}", place, value


def arrays_instead(dtype: str, shape: list[int], data: bytes) -> Iterator[object]:
    array = np.frombuffer(data, np.dtype(dtype)).reshape(shape)
    yield [dtype, [0] * max(1, len(shape)), b""]
    yield [dtype, [array.size], data]
    yield [dtype, [-1], data]
    yield ["<i4" if dtype != "<i4" else "<f8", shape, data]
    if array.size:
        longer = np.concatenate([array, array[-1:]])
        for one in (array[:-1], longer):
            yield [dtype, list(one.shape), one.tobytes()]
        wrong = {"f": [math.nan, math.inf, -1e300, 1e300], "i": [-1, 2**62, -(2**62)]}
        values = wrong.get(array.dtype.kind, [])
        for one, at in ((one, at) for one in values for at in (0, -1)):
            spoilt = array.copy()
            spoilt.flat[at] = one
            yield [dtype, shape, spoilt.tobytes()]


def others(value: Any) -> Iterator[object]:
    """Yield values that could stand in the place of one."""
    if is_array(value):
        yield from arrays_instead(*value)
    elif isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield from (one for one in (0, -1, 1, 2**31, 2**62, -(2**62), 2**63 - 1) if one != value)
    elif isinstance(value, float):
        yield from (0.0, -1.0, 1e300, -1e300, math.inf, -math.inf, math.nan)
    elif isinstance(value, str):
        yield from ("", "x" * 300)
    yield None if value is not None else 0


def changes(flight: Flight) -> list[tuple[str, Place, object]]:
    """Return all changes: of one entry of each container, of each scalar, of each array."""
    first = {name: (place, value) for name, place, value in reversed(list(leaves(flight.plain)))}
    return [(name, place, other) for name, (place, value) in sorted(first.items()) for other in others(value)]


def test_the_state_itself_goes_on(flight: Flight) -> None:
    assert flight.goes_on(flight.data, 100)


NOTHING = math.nan
ODD = {
    "parameter": (AIR, dialect.MAVLink_param_value_message(b"BARO1_GND_PRESS", NOTHING, 9, 10, 1)),
    "great parameter": (AIR, dialect.MAVLink_param_value_message(b"RTL_ALTITUDE", 3e38, 9, 10, 1)),
    "return height": (AIR, dialect.MAVLink_param_value_message(b"RTL_ALTITUDE", NOTHING, 9, 10, 1)),
    "parameter of a station": (SEAT, dialect.MAVLink_param_set_message(1, 1, b"X", NOTHING, 9)),
    "wind": (AIR, dialect.MAVLink_wind_message(0.0, 1e30, 0.0)),
    "height of an item": (
        AIR,
        dialect.MAVLink_mission_item_int_message(255, 190, 0, 3, 16, 0, 1, *[NOTHING] * 4, 0, 0, NOTHING),
    ),
}


@pytest.mark.parametrize(("link", "message"), ODD.values(), ids=ODD)
def test_a_service_goes_on_whatever_numbers_were_received(link: str, message: Any) -> None:
    """One parameter that was no number, and no snapshot was accepted any more."""
    stage = Stage()
    route = Route(1, (0, 0), read_only([[0.0, 500.0]]), 1.0)
    onboard = OnboardMission(route, (Item(16, 3, 0, 0, 100.0),), 1)
    stage.engine.stages.onboard_audit.begin(onboard, stage.t_ns, known_t_ns=stage.t_ns)
    stage.wait(0.1)
    stage.say(AIR, dialect.MAVLink_mission_count_message(255, 190, 2, 0), 1, 1)
    stage.say(link, message, *(1, 1) if link == AIR else ())
    after = Engine(stage.engine.config, stage.engine.seed)
    after.state = decode_state("test", encode_state(stage.engine.state))
    after.step(Resumed(stage.t_ns + NS_PER_S, stage.t_ns))
    for seconds in range(2, 5):
        after.step(Tick(stage.t_ns + seconds * NS_PER_S))


def test_every_array_of_a_route_is_checked(flight: Flight) -> None:
    """One of the wrong shape ended the service when the vehicle had flown a while."""
    found = [(place, value) for name, place, value in leaves(flight.plain) if "points_m" in name]
    assert len(found) >= 4
    for place, value in found:
        for other in arrays_instead(*value):
            flight.goes_on(flight.changed(place, other), 150)
        for spoilt in ([value[0], [math.prod(value[1])], value[2]], [value[0], [0, 2], b""]):
            assert not flight.goes_on(flight.changed(place, spoilt), 0)


def test_changes_here_and_there_are_refused_or_harmless(flight: Flight) -> None:
    """A sample; the slow test makes all changes."""
    found = changes(flight)
    assert len(found) > 1500
    results = [flight.goes_on(flight.changed(place, other), 20) for _, place, other in found[3::29]]
    assert 10 < sum(results) < len(results) - 10


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("part", [0.1, 0.5])
def test_every_change_of_a_value_is_refused_or_harmless(part: float) -> None:
    flight, failed = Flight(part), []
    for name, place, other in changes(flight):
        try:
            flight.goes_on(flight.changed(place, other), 250)
        except Exception as error:
            failed.append(f"{name} = {str(other)[:40]}: {error!r}")
    assert failed == []
