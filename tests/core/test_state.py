"""A restart, a replay from the middle or a standby would go on with another state than the flight had."""

from __future__ import annotations

import itertools
import random
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.recorded_state import CACHES, events_of

from gcs.core.engine import Engine
from gcs.core.snapshot import decode_state, encode_state
from gcs.errors import WireError
from gcs.io.record_json import encode

RECORDINGS = sorted((Path(__file__).parents[1] / "recordings").glob("*.mcap"))
MAX_DEPTH = 12


def attributes(thing: Any) -> Iterator[tuple[str, Any]]:
    """Yield the attributes of an object of ours."""
    names = {name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ())}
    names |= set(getattr(thing, "__dict__", ()))
    for name in sorted(names - {"__dict__", "__weakref__"}):
        if hasattr(thing, name):
            yield name, getattr(thing, name)


def is_frozen(thing: Any) -> bool:
    parameters = getattr(type(thing), "__dataclass_params__", None)
    return (
        parameters is not None and parameters.frozen and not type(thing).__module__.startswith("gcs.config")
    )


def state_objects(engine: Engine) -> set[int]:
    """Return the ids of the records and containers in the state tree."""
    found: set[int] = set()

    def walk(thing: Any) -> None:
        if id(thing) in found or isinstance(thing, int | float | str | bytes | None):
            return
        found.add(id(thing))
        if isinstance(thing, Mapping):
            for value in thing.values():
                walk(value)
        elif isinstance(thing, list | tuple | set | frozenset):
            for value in thing:
                walk(value)
        elif type(thing).__module__.startswith("gcs"):
            for _, value in attributes(thing):
                walk(value)

    walk(engine.state)
    return found


def values(engine: Engine) -> dict[str, str]:
    """Return every attribute of the stages outside the state, by class and name, as text."""
    in_state, found, seen = state_objects(engine), dict[str, str](), set[int]()

    def text(thing: Any, owner: str, depth: int) -> str:
        if isinstance(thing, int | float | str | bytes | np.generic | None):
            return repr(thing)
        if is_frozen(thing):  # a value: equal wherever it is
            return str([text(value, owner, depth + 1) for _, value in attributes(thing)])
        if id(thing) in in_state:
            return type(thing).__name__
        if isinstance(thing, np.ndarray):
            return "view" if id(thing.base) in in_state else str(hash(thing.tobytes()))
        if depth > MAX_DEPTH:
            return "..."
        if isinstance(thing, Mapping):
            return str([(repr(key), text(value, owner, depth + 1)) for key, value in thing.items()])
        if isinstance(thing, list | tuple | set | frozenset) or type(thing).__name__ == "deque":
            return str([text(value, owner, depth + 1) for value in thing])
        kind = type(thing)
        if not kind.__module__.startswith("gcs") or kind.__module__.startswith(("gcs.config", "gcs.jit")):
            return kind.__name__
        if id(thing) not in seen:
            seen.add(id(thing))
            for name, value in attributes(thing):
                key = f"{kind.__module__}.{kind.__name__}.{name}"
                if key not in CACHES:
                    found[key] = found.get(key, "") + text(value, key, depth + 1)
        return kind.__name__

    for name, value in attributes(engine.stages):
        if name != "state":
            found[f"Stages.{name}"] = text(value, name, 0)
    return found


def changed_outside(path: Path) -> set[str]:
    config, seed, events = events_of(path)
    engine = Engine(config, seed)
    before, changed = values(engine), set[str]()
    for number, event in enumerate(events):
        engine.step(event)
        if number % 50 == 0:
            now = values(engine)
            changed |= {key for key in now if now[key] != before.get(key, "")}
    return changed


def test_no_stage_keeps_state_of_its_own() -> None:
    changed = set().union(*(changed_outside(path) for path in RECORDINGS))
    assert sorted(changed - CACHES) == []


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.stem)
def test_a_snapshot_continues_like_the_flight_itself(path: Path) -> None:
    config, seed, events = events_of(path)
    flown = Engine(config, seed)
    expected, snapshots = [], {}
    for number, event in enumerate(events):
        expected.append([encode(effect) for effect in flown.step(event)])
        if number % (len(events) // 12) == 7:
            snapshots[number] = encode_state(flown.state)
    for number, data in snapshots.items():
        engine = Engine(config, seed, decode_state("test", data))
        for later, event in enumerate(itertools.islice(events, number + 1, number + 1 + len(events) // 6)):
            effects = [encode(effect) for effect in engine.step(event)]
            assert effects == expected[number + 1 + later], f"event {number + 1 + later} after {number}"
    assert len(snapshots) >= 12


def test_a_snapshot_is_the_same_after_another_round() -> None:
    config, seed, events = events_of(RECORDINGS[0])
    engine = Engine(config, seed)
    for event in events:
        engine.step(event)
    data = encode_state(engine.state)
    assert encode_state(decode_state("test", data)) == data


def test_a_snapshot_with_changed_bytes_is_refused_or_restored() -> None:
    """Compiled kernels do not check the indices of arrays: nothing else may come through."""
    config, seed, events = events_of(RECORDINGS[-1])
    engine = Engine(config, seed)
    for event in events[: len(events) // 2]:
        engine.step(event)
    data, rng = encode_state(engine.state), random.Random(3)
    refused = 0
    for _ in range(40):
        changed = bytearray(data)
        for _ in range(rng.choice((1, 2, 8))):
            changed[rng.randrange(len(changed))] = rng.randrange(256)
        try:
            engine.state = decode_state("test", bytes(changed))
        except (WireError, ValueError):
            refused += 1
    assert refused > 10


if __name__ == "__main__":  # the attributes that are not in the state yet
    print(*sorted(changed_outside(Path(sys.argv[1])) - CACHES), sep="\n")
