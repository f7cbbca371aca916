"""A recording opens as it is in the tools that people already use."""

import json
from pathlib import Path

import pytest
from helpers.recorded import T0_NS, frames
from mcap.reader import make_reader
from pymavlink import mavutil

from gcs.io.recording.tlog import split_frames
from gcs.io.recording.topics import TOPICS, Recordable


def test_other_mcap_tools_read_it_by_its_index(recording: tuple[Path, list[Recordable]]) -> None:
    folder, values = recording
    with (folder / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics.message_count == len(values)
        topics = {channel.topic for channel in summary.channels.values()}
        assert {"/event/tick", "/effect/picture/agents", "/effect/picture/targets", "/truth"} <= topics
        for _, channel, message in reader.iter_messages(topics=["/event/datagram"]):
            assert channel.message_encoding == "json"
            assert json.loads(message.data)["t_ns"] == message.log_time


def foxglove_accepts(schema: dict) -> bool:
    """What Foxglove's reader of JSON schemas insists on, for each property of an object."""
    if schema["type"] == "array":
        schema = schema["items"]
        if (
            schema["type"] not in ("boolean", "number", "integer", "string", "object")
            or "contentEncoding" in schema
        ):
            return False
    if schema["type"] == "object":
        return all(foxglove_accepts(one) for one in schema["properties"].values())
    return schema["type"] in ("boolean", "number", "integer", "string")


def test_viewers_accept_every_schema(recording: tuple[Path, list[Recordable]]) -> None:
    with (recording[0] / "run.mcap").open("rb") as file:
        schemas = make_reader(file).get_summary().schemas.values()
    assert len(schemas) == len(TOPICS)
    for schema in schemas:
        content = json.loads(schema.data)
        assert schema.encoding == "jsonschema"
        assert content["type"] == "object"
        assert foxglove_accepts(content), schema.name


def test_the_tlog_holds_every_frame_of_both_directions_with_its_time(
    recording: tuple[Path, list[Recordable]],
) -> None:
    folder, _ = recording
    log = mavutil.mavlink_connection(str(folder / "link.tlog"))
    heard = []
    while (message := log.recv_match()) is not None:
        heard.append((message.get_srcSystem(), message.time_boot_ms, message._timestamp))
    log.close()
    expected = []
    for second in range(20):
        t_s = T0_NS / 1e9 + second
        expected += [(1, second + k, pytest.approx(t_s, abs=1e-4)) for k in range(3)]
        expected += [(255, second, pytest.approx(t_s, abs=1e-4))]
    assert heard == expected


def test_only_frames_get_into_the_tlog() -> None:
    good = frames(1, 1)
    assert split_frames(good + good) == [good, good]
    assert split_frames(b"") == []
    assert split_frames(b"\x00garbage" + good + b"\xfd\xfe") == [good]
    assert split_frames(good[:-1]) == []
