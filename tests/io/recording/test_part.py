"""Whatever comes over a link is recorded byte for byte, in order, and found by its index."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.io.record_json import encode
from gcs.io.recording.folder import Run
from gcs.io.recording.part import RecordingPart
from gcs.io.recording.reader import read
from gcs.io.recording.recorder import Recorder
from gcs.io.recording.tlog import tlog_entries
from gcs.model import Datagram, Event, Notice, NoticeCode, Send, Tick

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
NAMES = st.one_of(st.sampled_from(["udp", "127.0.0.1:5000"]), st.text(max_size=8))
RECORDS = st.one_of(
    st.builds(Datagram, TIMES_NS, NAMES, NAMES, DATA),
    st.builds(Send, NAMES, NAMES, DATA),
    st.builds(Tick, TIMES_NS),
    st.builds(Notice, TIMES_NS, st.sampled_from(NoticeCode), NAMES, st.dictionaries(NAMES, NAMES)),
)
STEPS = st.lists(st.one_of(st.tuples(RECORDS, TIMES_NS, st.booleans()), st.just("flush")), max_size=60)


@settings(max_examples=50)
@given(STEPS)
def test_every_record_comes_back_as_it_was_in_the_order_of_consumption(steps: list[Any]) -> None:
    expected, log = [], b""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        recorder = Recorder(folder, "", {}, Run("x", 1))
        recorder.record_event(Tick(0))
        for step in steps:
            if step == "flush":
                recorder.flush()
                continue
            record, t_ns, is_encoded = step
            if isinstance(record, Event):
                t_ns = record.t_ns
                recorder.record_event(record)
            else:
                recorder.record_effect(t_ns, record, encode(record) if is_encoded else b"")
            expected.append((record, max(t_ns, 0)))
            if isinstance(record, Datagram | Send):
                log += tlog_entries(max(t_ns, 0), record.data)
        recorder.close()
        first, *records = read(folder)
        assert first.value == Tick(0)
        assert [(record.value, record.t_ns) for record in records] == expected
        assert (folder / "link.tlog").read_bytes() == log


def test_messages_are_found_by_topic_and_time(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run", "", {}) as recorder:
        for number in range(50):
            recorder.record_event(Tick(10 * number))
            recorder.record_effect(10 * number, Send("udp", "x", b"y"))
    with (tmp_path / "run" / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = [
            message.log_time
            for _, _, message in reader.iter_messages(topics=["/effect/send"], starting_at=100)
        ]
    assert found == [10 * number for number in range(10, 50)]


def test_chunks_are_compressed_and_small_enough_for_viewers(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run", "", {}) as recorder:
        for number in range(160):
            recorder.record_effect(number, Send("udp", "x", bytes(90_000)))
    with (tmp_path / "run" / "run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
    assert max(chunk.uncompressed_size for chunk in summary.chunk_indexes) < 2_000_000
    assert len(summary.chunk_indexes) > 5


def test_a_run_of_more_records_than_the_format_can_count_goes_on(tmp_path: Path) -> None:
    part = RecordingPart(tmp_path / "run.mcap", tmp_path / "link.tlog")
    part.begin("", {}, None)
    part.add([(Tick(number), number, b"") for number in range(4)], 2**32 - 2)
    part.finish()
    records = list(read(tmp_path / "run.mcap"))
    assert [record.value for record in records] == [Tick(number) for number in range(4)]
    assert [record.sequence for record in records] == [2**32 - 2, 2**32 - 1, 0, 1]
