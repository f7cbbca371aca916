"""A run is an asset: what was recorded comes back exactly, whatever happened to the process or the file."""

import json
import shutil
import signal
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.edge.reader import Damage, Record, about, mcap_paths, read, recording_bytes
from gcs.edge.recorder import Recorder, Run
from gcs.edge.tlog import Logged, read_log, split_frames
from gcs.edge.wire import TOPICS, Recordable, encode
from gcs.errors import RecordingError
from gcs.model import (
    NS_PER_S,
    BadInput,
    Datagram,
    Fate,
    KeepOut,
    LinkNews,
    Memory,
    MissionEnded,
    Notice,
    Order,
    OrderAnswer,
    Picture,
    Plan,
    Proposal,
    Resumed,
    Route,
    Scan,
    Send,
    Sensor,
    Tick,
    Track,
    Truth,
    TruthObject,
    Upload,
    UploadAnswer,
    UploadReport,
    VehicleMemory,
    read_only,
)

T0_NS = 1_767_225_600 * NS_PER_S
CONFIG = 'name = "demo"  # ünïcode\n'
VERSIONS = {"swarm-gcs": "0.1.0", "numpy": "2.0"}
EVENTS = (Datagram, Scan, Tick, BadInput, LinkNews, Order, UploadAnswer, Resumed)


def frames(system_id: int, count: int, first: int = 0) -> bytes:
    packer = mavlink.MAVLink(None, srcSystem=system_id)
    data = b""
    for number in range(first, first + count):
        packer.seq = number % 256
        data += mavlink.MAVLink_attitude_message(number, 0.1, 0.2, 0.3, 0, 0, 0).pack(packer)
    return data


def a_run(seconds: int) -> Iterator[tuple[int, Recordable]]:
    """Every kind of record, in an order that times alone would not give back."""
    rng = np.random.default_rng(7)
    sensor = Sensor("radar", 0.98, 5e-6, read_only(np.eye(2) * 10), (0.0, 0.0, 2000.0, 2000.0))
    for second in range(seconds):
        t_ns = T0_NS + second * NS_PER_S
        yield t_ns, Tick(t_ns)
        yield t_ns - 5, Datagram(t_ns - 5, "udp", "127.0.0.1:5000", frames(1, 3, second))
        yield t_ns, BadInput(t_ns, "udp", 'not "MAVLink"')
        yield t_ns, LinkNews(t_ns, "tcp:10.0.0.1:5760", "warning", "connection lost")
        yield t_ns, Truth(t_ns, (TruthObject("agents", 1, float(second), 0.1, second % 2 == 0),))
        yield t_ns, Scan(t_ns, t_ns - 9, sensor, read_only(rng.normal(size=(second % 4, 2))))
        for kind in ("agents", "targets"):
            track = Track((0, second), read_only(rng.normal(size=4)), read_only(rng.normal(size=(4, 4))), 0.9)
            yield t_ns, Picture(t_ns, t_ns, kind, (track,), read_only(rng.dirichlet([1, 1])))
        yield (
            t_ns,
            Plan(t_ns, t_ns, (Route(1, (0, 1), read_only([[1.0, 2.0]]), 3.0),), (2,), ((0, 3),), "why", (1,)),
        )
        yield t_ns, Send("udp", "127.0.0.1:5000", frames(255, 1, second))
        yield t_ns, UploadReport(t_ns, 1, 4, 9, True, "verified", 0.25, 1)
        yield t_ns, Upload(1, 4, frames(255, 2, second))
        yield t_ns, UploadAnswer(t_ns, 1, 4, False, True, "timed out")
        yield t_ns, Notice(t_ns, "warning", "älarm", None)
        area = KeepOut("fire", None, ((0.0, 0.1), (1.0, 0.0), (1.0, 1.0)))
        yield t_ns, Order(t_ns, f"o-{second}", "keep-out", None, None, area, "somebody")
        memory = VehicleMemory(Fate(t_ns, 1, "flying"), "hold", None, ((16.0, None),), 1, False)
        yield t_ns, Resumed(t_ns, Memory(t_ns, 3, second, False, (memory,), (), (area,)))
        yield t_ns, OrderAnswer(t_ns, f"o-{second}", "keep-out", "done", "so it is", None, ())
        yield t_ns, Proposal(t_ns, second + 1, (Route(1, (0, 1), read_only([[1.0, 2.0]]), 3.0),), "why")
        yield t_ns, Fate(t_ns, 1, "dead", None, (1.0, 2.0))
    yield t_ns, MissionEnded(t_ns, (1,), (2,))


def record(recorder: Recorder, run: Iterator[tuple[int, Recordable]]) -> list[Recordable]:
    values = []
    for t_ns, value in run:
        if isinstance(value, EVENTS):
            recorder.event(value)
        elif isinstance(value, Truth):
            recorder.truth(value)
        else:
            recorder.effect(t_ns, value)
        values.append(value)
        if isinstance(value, Fate):
            recorder.flush()
    return values


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Recordable]]:
    folder = tmp_path_factory.mktemp("runs") / "a" / "run"
    with Recorder(folder, CONFIG, VERSIONS) as recorder:
        values = record(recorder, a_run(20))
    return folder, values


def texts(values: list[Recordable]) -> list[bytes]:
    """Records hold arrays, which `==` cannot compare; their JSON is exact."""
    return [encode(value) for value in values]


def whole(records: list[Record]) -> list[Recordable]:
    return [r.value for r in records if not isinstance(r.value, Damage)]


def test_everything_comes_back_in_the_order_of_consumption(recording: tuple[Path, list[Recordable]]) -> None:
    folder, values = recording
    records = list(read(folder))
    assert [type(r.value) for r in records] == [type(value) for value in values]
    assert texts(whole(records)) == texts(values)
    assert [r.sequence for r in records] == list(range(len(values)))
    assert {type(value) for value in values} == set(TOPICS)
    scan = next(value for value in whole(records) if isinstance(value, Scan))
    assert scan.z_m.shape == (0, 2)
    assert not scan.z_m.flags.writeable


def test_the_mcap_file_alone_is_enough(recording: tuple[Path, list[Recordable]]) -> None:
    folder, values = recording
    assert len(list(read(folder / "run.mcap"))) == len(values)
    assert about(folder / "run.mcap").config_text == CONFIG


def test_the_folder_says_how_it_was_made(recording: tuple[Path, list[Recordable]]) -> None:
    folder, _ = recording
    assert (folder / "mission.toml").read_text(encoding="utf-8") == CONFIG
    assert json.loads((folder / "versions.json").read_text()) == VERSIONS
    assert (about(folder).config_text, about(folder).versions) == (CONFIG, VERSIONS)


def test_the_seed_is_part_of_the_recording(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run", CONFIG, VERSIONS, Run("demo", 2**40)):
        pass
    assert about(tmp_path / "run").run == Run("demo", 2**40)


def test_a_recording_that_does_not_know_its_seed_says_none(recording: tuple[Path, list[Recordable]]) -> None:
    assert about(recording[0]).run is None


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


def test_a_flight_is_never_overwritten(recording: tuple[Path, list[Recordable]]) -> None:
    folder, values = recording
    with pytest.raises(RecordingError, match="holds a recording already"):
        Recorder(folder, CONFIG, VERSIONS)
    assert len(list(read(folder))) == len(values)


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="cannot be written"):
        Recorder(tmp_path / "file" / "run", CONFIG, VERSIONS)


@pytest.mark.parametrize("step", [1, 997])
def test_a_truncated_recording_is_read_up_to_the_break(
    recording: tuple[Path, list[Recordable]], tmp_path: Path, step: int
) -> None:
    folder, values = recording
    data = (folder / "run.mcap").read_bytes()
    cuts = (
        range(0, 600, 7) if step == 1 else [*range(600, len(data), step), *range(len(data) - 30, len(data))]
    )
    expected = texts(values)
    path = tmp_path / "run.mcap"
    most = 0
    for cut in cuts:
        path.write_bytes(data[:cut])
        *records, last = list(read(path))
        assert isinstance(last.value, Damage), cut
        assert last.value.records == len(records)
        assert "cut off" in last.value.problem
        assert texts(whole(records)) == expected[: len(records)]
        assert len(records) >= most
        most = len(records)
        about(path)
    if step > 1:
        assert most == len(values)


def test_a_damaged_recording_gives_true_records_up_to_the_damage_and_says_so(
    recording: tuple[Path, list[Recordable]], tmp_path: Path
) -> None:
    folder, values = recording
    data = (folder / "run.mcap").read_bytes()
    expected = texts(values)
    rng = np.random.default_rng(3)
    path = tmp_path / "run.mcap"
    told = 0
    for _ in range(150):
        hurt = bytearray(data)
        at = int(rng.integers(8, len(data)))
        hurt[at : at + 4] = rng.bytes(4)
        path.write_bytes(hurt)
        records = list(read(path))
        about(path)
        values_read = whole(records)
        assert texts(values_read) == expected[: len(values_read)]
        told += isinstance(records[-1].value, Damage)
        assert len(values_read) == len(values) or isinstance(records[-1].value, Damage)
    assert told > 30


def test_a_missing_piece_in_the_middle_is_noticed(
    recording: tuple[Path, list[Recordable]], tmp_path: Path
) -> None:
    folder, values = recording
    data = (folder / "run.mcap").read_bytes()
    with (folder / "run.mcap").open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    gone = chunks[10]
    path = tmp_path / "run.mcap"
    path.write_bytes(data[: gone.chunk_start_offset] + data[gone.chunk_start_offset + gone.chunk_length :])
    *records, last = list(read(path))
    assert isinstance(last.value, Damage)
    assert "records are missing" in last.value.problem
    assert 0 < len(records) < len(values)


def test_a_length_that_lies_costs_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + b"\x06" + (2**62).to_bytes(8, "little") + bytes(100))
    (only,) = list(read(path))
    assert isinstance(only.value, Damage)


@pytest.mark.parametrize("content", [b"PK\x03\x04 a zip file", b"hello"])
def test_what_is_no_recording_is_said_to_be_none(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "flight.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="is no recording"):
        list(read(path))
    with pytest.raises(RecordingError, match="holds no recording"):
        list(read(tmp_path))


CHILD = """
import sys, time
from pathlib import Path
from gcs.edge.recorder import Recorder, Run
from gcs.model import Datagram, Tick
recorder = Recorder(Path(sys.argv[1]), "name = 'x'", {}, None, int(sys.argv[2]))
for number in range(100_000):
    recorder.event(Tick(number))
    if number % 500 == 499:
        recorder.flush()
        print(number + 1, flush=True)
        time.sleep(0.002)
"""


@pytest.mark.parametrize("rotate_bytes", [10_000, 500_000_000])
def test_after_sigkill_everything_flushed_is_there(tmp_path: Path, rotate_bytes: int) -> None:
    folder = tmp_path / "run"
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(folder), str(rotate_bytes)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    assert child.stdout is not None
    promised = [int(child.stdout.readline()) for _ in range(7)][-1]
    child.send_signal(signal.SIGKILL)
    rest = child.stdout.read().split()
    child.wait()
    child.stdout.close()
    promised = int(rest[-1]) if rest else promised
    *records, last = list(read(folder))
    assert isinstance(last.value, Damage)
    assert "cut off" in last.value.problem
    assert len(records) >= promised
    assert [r.value for r in records] == [Tick(number) for number in range(len(records))]


def in_parts(folder: Path, seconds: int, rotate_bytes: int) -> list[Recordable]:
    with Recorder(folder, CONFIG, VERSIONS, Run("demo", 5), rotate_bytes) as recorder:
        return record(recorder, a_run(seconds))


def test_a_long_run_is_split_and_read_as_one(tmp_path: Path) -> None:
    values = in_parts(tmp_path / "run", 60, 30_000)
    parts = mcap_paths(tmp_path / "run")
    assert [path.name for path in parts[:3]] == ["run.mcap", "run-002.mcap", "run-003.mcap"]
    records = list(read(tmp_path / "run"))
    assert texts(whole(records)) == texts(values)
    assert [r.sequence for r in records] == list(range(len(values)))
    assert recording_bytes(tmp_path / "run") == sum(path.stat().st_size for path in parts)


def test_each_part_is_whole_in_itself(tmp_path: Path) -> None:
    values = in_parts(tmp_path / "run", 60, 30_000)
    total = 0
    for path in mcap_paths(tmp_path / "run"):
        alone = list(read(path))
        assert not any(isinstance(r.value, Damage) for r in alone)
        assert isinstance(alone[0].value, EVENTS)
        assert about(path) == about(tmp_path / "run")
        with path.open("rb") as file:
            summary = make_reader(file, validate_crcs=True).get_summary()
        assert summary is not None
        assert summary.statistics.message_count == len(alone)
        total += len(alone)
    assert total == len(values)
    logs = sorted((tmp_path / "run").glob("link*.tlog"))
    assert len(logs) == len(mcap_paths(tmp_path / "run")) > 2
    frames_logged = sum(isinstance(part, Logged) for log in logs for part in read_log(log.open("rb")))
    assert frames_logged == 60 * 4


def test_a_part_that_is_missing_or_damaged_ends_the_reading_and_is_named(tmp_path: Path) -> None:
    values = in_parts(tmp_path / "run", 60, 30_000)
    parts = mcap_paths(tmp_path / "run")
    second = len(list(read(parts[0])))
    data = parts[1].read_bytes()
    parts[1].write_bytes(data[: len(data) // 2])
    *records, last = list(read(tmp_path / "run"))
    assert isinstance(last.value, Damage)
    assert last.value.file == "run-002.mcap"
    assert "run-002.mcap, part 2 of" in last.value.problem
    assert second < len(records) < len(values)
    parts[1].unlink()
    *records, last = list(read(tmp_path / "run"))
    assert isinstance(last.value, Damage)
    assert "records are missing" in last.value.problem
    assert len(records) == second
    parts[0].unlink()
    with pytest.raises(RecordingError, match=r"run\.mcap: cannot be read"):
        list(read(tmp_path / "run"))
    with pytest.raises(RecordingError, match="holds a recording already"):
        Recorder(tmp_path / "run", CONFIG, VERSIONS)


FULL = """
import resource, sys
from pathlib import Path
from gcs.edge.recorder import Recorder, Run
from gcs.errors import RecordingError
from gcs.model import Notice
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
try:
    with Recorder(Path(sys.argv[1]), "name = 'x'", {}) as recorder:
        number = 0
        while True:
            recorder.effect(number, Notice(number, "info", str(hash(str(number)))))
            number += 1
            if number % 100 == 0:
                recorder.flush()
                print(number, flush=True)
except RecordingError as error:
    print(error)
"""


def test_on_a_full_disk_the_run_is_told_and_what_was_flushed_stays(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(folder)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        check=True,
    )
    *promised, error = done.stdout.splitlines()
    assert "cannot be written any further" in error
    assert done.stderr == ""
    *records, last = list(read(folder))
    assert isinstance(last.value, Damage)
    assert len(records) >= int(promised[-1]) > 0


SMALL_DISK = """
import sys
from pathlib import Path
from gcs.edge.recorder import Recorder
from gcs.errors import RecordingError
from gcs.model import Tick
try:
    with Recorder(Path(sys.argv[1]), "name = 'x'", {}, None, 40_000) as recorder:
        for number in range(10_000_000):
            recorder.event(Tick(hash(str(number)) % 2**60))
            if number % 500 == 499:
                recorder.flush()
                print(number + 1, flush=True)
except RecordingError as error:
    print(error)
"""


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    mount = ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", str(tmp_path)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("may not mount a small disk here")
    yield tmp_path
    subprocess.run(["umount", str(tmp_path)], check=True)


def test_a_disk_that_fills_while_parts_are_written_keeps_what_was_flushed(small_disk: Path) -> None:
    command = [sys.executable, "-c", SMALL_DISK, str(small_disk / "run")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[2], check=True)
    *promised, error = done.stdout.splitlines()
    assert "No space left on device" in error
    assert len(mcap_paths(small_disk / "run")) > 2
    *records, last = list(read(small_disk / "run"))
    assert isinstance(last.value, Damage)
    assert len(records) >= int(promised[-1]) > 0


def test_memory_does_not_grow_with_the_run(tmp_path: Path) -> None:
    """A forgotten flush must not gather the run in memory: chunks are written when they are full."""
    with Recorder(tmp_path / "run", CONFIG, VERSIONS) as recorder:
        tracemalloc.start()
        for number in range(6000):
            recorder.effect(number, Notice(number, "info", "x" * 10_000))
        _, peak_bytes = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak_bytes < 20_000_000  # 60 MB went through


def test_a_closed_recorder_takes_nothing_more(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run", CONFIG, VERSIONS)
    recorder.close()
    recorder.close()
    recorder.flush()
    with pytest.raises(RecordingError, match="is closed"):
        recorder.event(Tick(1))
    assert list(read(tmp_path / "run")) == []


def test_times_outside_the_format_do_not_stop_the_recording(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run", CONFIG, VERSIONS) as recorder:
        recorder.event(Datagram(-5, "udp", "x", frames(1, 1)))
    (only,) = list(read(tmp_path / "run"))
    assert only.value == Datagram(-5, "udp", "x", frames(1, 1))
