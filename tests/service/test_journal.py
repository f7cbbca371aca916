"""A journal that is damaged, hostile or another's must cost no more than a clean start."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcs.config import load
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.errors import JournalError
from gcs.io.records import encode
from gcs.model import (
    AgentStatus,
    NoFlyZone,
    PersistedState,
    PersistedVehicle,
    Resumed,
    Route,
    read_only,
)
from gcs.service.journal import Journal, fingerprint

MINE = fingerprint("name = 'm'", 1)
PERSISTED = PersistedState(
    7,
    4,
    2,
    False,
    (
        PersistedVehicle(
            AgentStatus(5, 1, "active", None, (1.0, 2.0)),
            "hold",
            Route(1, (3, 4), read_only([[1.0, 2.0], [3.0, 4.5]]), 9.0),
            ((16.0, 3.0, 332000000.0, -876000000.0, 100.0, 0.0, 10.0, 0.0, None, 1.0),),
            1,
            False,
        ),
    ),
    MultiSensorTracker(load("prescribed")).persisted(),
    (NoFlyZone("fire", (1.0, 2.0, 3.0)),),
)


@pytest.fixture
def journal(tmp_path: Path) -> Journal:
    return Journal(tmp_path / "runs" / "m.journal", "m", MINE)


def same(a: PersistedState, b: PersistedState) -> bool:
    return encode(Resumed(0, a)) == encode(Resumed(0, b))


def test_what_was_written_is_read_and_nothing_else_lies_about(journal: Journal) -> None:
    assert journal.read() is None
    journal.write(PERSISTED)
    journal.write(PERSISTED)
    persisted = journal.read()
    assert persisted is not None
    assert same(persisted, PERSISTED)
    assert [path.name for path in journal.path.parent.iterdir()] == ["m.journal"]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda d: b"", "damaged"),
        (lambda d: d[: len(d) // 2], "checksum"),
        (lambda d: d[:-3], "checksum"),
        (lambda d: d.replace(b'"hold"', b'"help"'), "checksum"),
        (lambda d: d.replace(b'"journal":3', b'"journal":2'), "version 2"),
        (lambda d: b"[" * 100_000, "damaged"),
        (lambda d: b"\xff\xfe" + d, "damaged"),
    ],
)
def test_damage_is_named(journal: Journal, spoil, words: str) -> None:
    journal.write(PERSISTED)
    journal.path.write_bytes(spoil(journal.path.read_bytes()))
    with pytest.raises(JournalError, match=words):
        journal.read()


def test_a_journal_with_a_right_checksum_may_still_make_no_sense(journal: Journal) -> None:
    import hashlib

    body = json.dumps({"t_ns": 1, "memory": {"t_ns": "late"}}).encode()
    head = {"journal": 3, "mission": "m", "fingerprint": MINE, "checksum": hashlib.sha256(body).hexdigest()}
    journal.path.parent.mkdir()
    journal.path.write_bytes(json.dumps(head).encode() + b"\n" + body + b"\n")
    with pytest.raises(JournalError, match="makes no sense"):
        journal.read()


def test_another_mission_file_or_seed_is_reported(journal: Journal) -> None:
    journal.write(PERSISTED)
    other = Journal(journal.path, "m", fingerprint("name = 'm'", 2))
    with pytest.raises(JournalError, match="another mission file or seed"):
        other.read()


def test_a_journal_that_cannot_be_written_is_an_error_and_the_old_one_stays(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(JournalError, match="cannot be written"):
        Journal(tmp_path / "file" / "m.journal", "m", MINE).write(PERSISTED)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.binary(min_size=1, max_size=8))
def test_any_change_of_bytes_is_an_error_of_ours_or_changes_nothing(
    journal: Journal, place: int, junk: bytes
) -> None:
    journal.write(PERSISTED)
    data = journal.path.read_bytes()
    place %= len(data)
    journal.path.write_bytes(data[:place] + junk + data[place + len(junk) :])
    try:
        persisted = journal.read()
    except JournalError:
        return
    assert persisted is not None
    assert same(persisted, PERSISTED)
