"""The file is the MCAP library's own writer's, byte for byte: whoever reads theirs, reads ours."""

from __future__ import annotations

import io
from itertools import groupby
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.io.recording.mcap_writer import McapWriter
from gcs.io.recording.packing import Packer
from gcs.io.recording.tlog import tlog_entries
from gcs.io.zenoh.messages import encode
from gcs.model import Datagram, Notice, Send, Tick

TYPES = (Datagram, Send, Tick, Notice)
CHANNELS: dict[type | str, int] = {record_type: number for number, record_type in enumerate(TYPES, 1)}

packer = mavlink.MAVLink(None, srcSystem=7)
FRAMES = (
    mavlink.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0, 0, 0).pack(packer),
    mavlink.MAVLink_statustext_message(4, b"on the way").pack(packer),
    mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3).pack(packer, force_mavlink1=True),
)
DATA = st.one_of(
    st.lists(st.sampled_from(FRAMES), max_size=3).map(b"".join),
    st.binary(max_size=100),
    st.sampled_from(FRAMES).map(lambda frame: frame[:-1]),
)
TIMES_NS = st.one_of(st.integers(0, 2**63 - 1), st.integers(-(10**10), 10**10), st.integers(0, 12))
WORDS = st.one_of(st.sampled_from(["udp", "127.0.0.1:5000"]), st.text(max_size=8))
RECORDS = st.one_of(
    st.builds(Datagram, TIMES_NS, WORDS, WORDS, DATA),
    st.builds(Send, WORDS, WORDS, DATA),
    st.builds(Tick, TIMES_NS),
    st.builds(Notice, TIMES_NS, st.just("info"), WORDS),
)
STEPS = st.lists(
    st.one_of(st.tuples(RECORDS, TIMES_NS), st.sampled_from(["flush", "attach"])),
    max_size=60,
)


def timed(step: tuple[Any, int]) -> tuple[Any, int]:
    """A record and its own time; a `Send` has none, and is recorded at a time that it is given."""
    record, t_ns = step
    return record, getattr(record, "t_ns", t_ns)


def written_by_the_library(steps: list[Any]) -> tuple[bytes, bytes]:
    file, log = io.BytesIO(), b""
    writer = Writer(file, chunk_size=10**9, compression=CompressionType.ZSTD)
    writer.start("profile", "library")
    writer.add_attachment(0, 0, "mission.toml", "application/toml", b"text")
    writer.add_metadata("versions", {"numpy": "2", "python": "3"})
    schema = writer.register_schema("gcs.Plan", "jsonschema", b"{}")
    for topic in ("/a", "/b", "/c", "/d"):
        writer.register_channel(topic, "json", schema)
    for number, step in enumerate(steps):
        if step == "flush":
            writer.flush()
        elif step == "attach":
            writer.add_attachment(0, 0, "more", "text/plain", b"more")
        else:
            record, t_ns = timed(step)
            t_ns = max(t_ns, 0)
            writer.add_message(CHANNELS[type(record)], t_ns, encode(record), t_ns, number)
            if isinstance(record, Datagram | Send):
                log += tlog_entries(t_ns, record.data)
    writer.finish()
    return file.getvalue(), log


def written(steps: list[Any], chunk_bytes: int = 10**9) -> tuple[bytes, bytes]:
    file, log, number = io.BytesIO(), b"", 0
    writer, records = McapWriter(file, chunk_bytes, 3), Packer(CHANNELS)
    writer.start("profile", "library")
    writer.add_attachment("mission.toml", "application/toml", b"text")
    writer.add_metadata("versions", {"numpy": "2", "python": "3"})
    schema = writer.register_schema("gcs.Plan", "jsonschema", b"{}")
    for topic in ("/a", "/b", "/c", "/d"):
        writer.register_channel(topic, "json", schema)
    for kind, some in groupby(steps, lambda step: step if isinstance(step, str) else "records"):
        group = list(some)
        if kind == "records":
            for piece in records.pack([(*timed(step), b"") for step in group], number):
                writer.add_messages(piece.messages, piece.channels, piece.places)
                log += piece.log
        for _ in group:
            if kind == "flush":
                writer.flush()
            elif kind == "attach":
                writer.add_attachment("more", "text/plain", b"more")
        number += len(group)
    writer.finish()
    return file.getvalue(), log


@settings(max_examples=100, deadline=None)
@given(STEPS)
def test_the_same_records_give_the_same_bytes(steps: list[Any]) -> None:
    assert written(steps) == written_by_the_library(steps)


def test_many_peers_and_large_records_are_written_as_few_and_small_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("gcs.io.recording.packing._MOST_FORMS", 1000)  # fewer than there are peers
    many = [(Datagram(t, "udp", f"10.0.{t // 256}.{t % 256}:1", FRAMES[t % 3]), t) for t in range(1500)]
    large = [(Send("udp", "x", bytes(60_000)), t) for t in range(20)]
    for records in (many, large):
        assert written(records[:600]) == written_by_the_library(records[:600])
        assert written([*records, "flush", *records]) == written_by_the_library([*records, "flush", *records])


def test_it_is_read_by_its_index() -> None:
    steps = [
        (Tick(10 * number) if number % 3 else Send("udp", "x", b"y"), 10 * number) for number in range(50)
    ]
    reader = make_reader(io.BytesIO(written(steps)[0]), validate_crcs=True)
    found = [message.log_time for _, _, message in reader.iter_messages(topics=["/b"], starting_at=100)]
    assert found == [t_ns for record, t_ns in steps if isinstance(record, Send) and t_ns >= 100]


def test_a_full_chunk_ends() -> None:
    steps: list[Any] = []
    for number in range(20):
        steps += [(Send("udp", "x", bytes(90_000)), number)] * 8
    file, _ = written(steps, 1_000_000)
    summary = make_reader(io.BytesIO(file)).get_summary()
    assert summary is not None
    assert max(chunk.uncompressed_size for chunk in summary.chunk_indexes) < 2_000_000
    assert len(summary.chunk_indexes) > 5
