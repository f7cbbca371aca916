"""The file is the MCAP library's own writer's, byte for byte: whoever reads theirs, reads ours."""

from __future__ import annotations

import io
from itertools import groupby
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from gcs.edge.mcap_writer import McapWriter

STEPS = st.lists(
    st.one_of(
        st.tuples(st.integers(1, 3), st.integers(0, 2**64 - 1), st.binary(max_size=300)),
        st.sampled_from(["flush", "attach"]),
    ),
    max_size=60,
)


def written_by_the_library(steps: list[Any], chunk_bytes: int) -> bytes:
    file = io.BytesIO()
    writer = Writer(file, chunk_size=chunk_bytes, compression=CompressionType.ZSTD)
    writer.start("profile", "library")
    writer.add_attachment(0, 0, "mission.toml", "application/toml", b"text")
    writer.add_metadata("versions", {"numpy": "2", "python": "3"})
    schema = writer.register_schema("gcs.Plan", "jsonschema", b"{}")
    for topic in ("/a", "/b", "/c"):
        writer.register_channel(topic, "json", schema)
    for number, step in enumerate(steps):
        if step == "flush":
            writer.flush()
        elif step == "attach":
            writer.add_attachment(0, 0, "more", "text/plain", b"more")
        else:
            channel, t_ns, data = step
            writer.add_message(channel, t_ns, data, t_ns, number)
    writer.finish()
    return file.getvalue()


def written(steps: list[Any], chunk_bytes: int) -> bytes:
    file = io.BytesIO()
    writer = McapWriter(file, chunk_bytes, 3)
    writer.start("profile", "library")
    writer.add_attachment("mission.toml", "application/toml", b"text")
    writer.add_metadata("versions", {"numpy": "2", "python": "3"})
    schema = writer.register_schema("gcs.Plan", "jsonschema", b"{}")
    for topic in ("/a", "/b", "/c"):
        writer.register_channel(topic, "json", schema)
    number = 0
    for is_message, some in groupby(steps, lambda step: isinstance(step, tuple)):
        group = list(some)
        if is_message:
            channels, times_ns, payloads = zip(*group, strict=True)
            writer.add_messages(channels, np.array(times_ns, np.uint64), payloads, number)
        else:
            for step in group:
                if step == "flush":
                    writer.flush()
                else:
                    writer.add_attachment("more", "text/plain", b"more")
        number += len(group)
    writer.finish()
    return file.getvalue()


@settings(max_examples=60, deadline=None)
@given(STEPS, st.sampled_from([1, 500, 10**6]))
def test_the_same_steps_give_the_same_bytes(steps: list[Any], chunk_bytes: int) -> None:
    assert written(steps, chunk_bytes) == written_by_the_library(steps, chunk_bytes)


def test_it_is_read_by_its_index() -> None:
    steps = [(1 + number % 3, 10 * number, bytes([number])) for number in range(50)]
    reader = make_reader(io.BytesIO(written(steps, 200)), validate_crcs=True)
    found = [message.data for _, _, message in reader.iter_messages(topics=["/b"], starting_at=100)]
    assert found == [data for channel, t_ns, data in steps if channel == 2 and t_ns >= 100]
