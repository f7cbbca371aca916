"""Logs of any ground station: what is whole is read, what is damaged is named, whatever the file holds."""

import io
import tracemalloc
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v10 import ardupilotmega as mavlink1
from pymavlink.dialects.v20 import ardupilotmega as mavlink2

from gcs.errors import RecordingError
from gcs.io.recording.tlog import LogFrame, UnreadableBytes, check_log, read_log

T0_US = 1_436_056_003_000_000


def frame(number: int, *, version: int = 2, system_id: int = 1) -> bytes:
    dialect = mavlink1 if version == 1 else mavlink2
    packer = dialect.MAVLink(None, srcSystem=system_id)
    packer.seq = number % 256
    packed: bytes = dialect.MAVLink_attitude_message(number, 0.1, 0.2, 0.3, 0, 0, 0).pack(packer)
    return packed


def unknown_frame(message_id: int = 60_000) -> bytes:
    """A frame of an id that no dialect here has; its checksum cannot be known."""
    return bytes([0xFD, 3, 0, 0, 9, 7, 8]) + message_id.to_bytes(3, "little") + b"abc" + b"\x11\x22"


def entry(data: bytes, at_us: int = T0_US) -> bytes:
    return at_us.to_bytes(8, "big") + data


def parts(data: bytes) -> list[LogFrame | UnreadableBytes]:
    return list(read_log(io.BytesIO(data)))


def frames(found: Sequence[LogFrame | UnreadableBytes]) -> list[bytes]:
    return [part.frame.data for part in found if isinstance(part, LogFrame) and part.validity == "good"]


def damage(found: Sequence[LogFrame | UnreadableBytes]) -> list[UnreadableBytes]:
    return [part for part in found if isinstance(part, UnreadableBytes)]


def test_both_versions_are_read_with_their_times() -> None:
    wanted = [frame(0, version=1), frame(1), frame(2, version=1, system_id=255)]
    found = parts(b"".join(entry(data, T0_US + number) for number, data in enumerate(wanted)))
    assert frames(found) == wanted
    assert [part.t_ns for part in found if isinstance(part, LogFrame)] == [
        (T0_US + number) * 1000 for number in range(3)
    ]
    assert not damage(found)


@given(
    junk=st.binary(min_size=1, max_size=600).map(
        lambda data: data.replace(b"\xfd", b"a").replace(b"\xfe", b"b")
    ),
    before=st.integers(0, 5),
    behind=st.integers(0, 5),
)
def test_damage_costs_nothing_but_itself(junk: bytes, before: int, behind: int) -> None:
    wanted = [frame(number, version=1 + number % 2) for number in range(before + behind)]
    texts = [entry(data) for data in wanted]
    head, tail = b"".join(texts[:before]), b"".join(texts[before:])
    found = parts(head + junk + tail)
    assert frames(found) == wanted
    assert damage(found) == [UnreadableBytes(len(head), len(junk))]


@given(st.binary(max_size=2000))
def test_every_byte_is_accounted_for_whatever_the_file_holds(data: bytes) -> None:
    at = 0
    for part in parts(entry(frame(1)) + data):
        assert part.offset == at
        at += part.length if isinstance(part, UnreadableBytes) else 8 + len(part.frame.data)
    assert at == len(entry(frame(1)) + data)


@pytest.mark.parametrize("cut", range(1, 8 + len(frame(0)), 7))
def test_a_log_cut_off_in_its_last_entry_is_read_up_to_it(cut: int) -> None:
    whole, last = entry(frame(0)) + entry(frame(1)), entry(frame(2))
    found = parts(whole + last[:cut])
    assert frames(found) == [frame(0), frame(1)]
    assert damage(found) == [UnreadableBytes(len(whole), cut)]


def test_a_marker_in_the_damage_does_not_swallow_later_frames() -> None:
    for marker in (b"\xfd\xff", b"\xfe\xff", b"\xfd\x00\x00", b"\xfe\xfe\xfd\xfd"):
        found = parts(entry(frame(0)) + marker + entry(frame(1)) + entry(frame(2)))
        assert frames(found) == [frame(0), frame(1), frame(2)]


def test_a_lost_part_of_a_frame_costs_that_frame() -> None:
    data = b"".join(entry(frame(number)) for number in range(4))
    length = len(entry(frame(0)))
    found = parts(data[: length + 20] + data[length + 25 :])
    assert frames(found) == [frame(0), frame(2), frame(3)]
    assert damage(found) == [UnreadableBytes(length, length - 5)]


def test_frames_of_other_dialects_have_their_place() -> None:
    wrong = bytearray(frame(1))
    wrong[-1] ^= 0xFF
    data = entry(frame(0)) + entry(unknown_frame()) + entry(bytes(wrong)) + entry(frame(2))
    found = [part for part in parts(data) if isinstance(part, LogFrame)]
    assert [part.validity for part in found] == ["good", "unknown id", "bad checksum", "good"]
    unknown = found[1].frame
    assert (unknown.system_id, unknown.component_id, unknown.message_id) == (7, 8, 60_000)
    assert not damage(parts(data))


def test_an_impossible_timestamp_is_refused() -> None:
    found = parts(entry(frame(0)) + entry(frame(1), 2**63) + entry(frame(2), T0_US + 5))
    assert [part.t_ns // 1000 - T0_US for part in found if isinstance(part, LogFrame)] == [0, 0, 5]


def test_a_tlog_is_distinguished_from_other_files() -> None:
    some = [frame(number) for number in range(5)]
    check_log(io.BytesIO(b"".join(map(entry, some))), "x")
    check_log(io.BytesIO(entry(some[0])), "x")
    check_log(io.BytesIO(b"junk" * 100 + b"".join(map(entry, some))), "x")
    for content, problem in (
        (b"".join(some), "without time stamps"),
        (b"junk" * 100 + b"".join(some), "without time stamps"),
        (b"no frames here" * 100, "no MAVLink frame"),
        (b"", "x: is empty"),
    ):
        with pytest.raises(RecordingError, match=problem):
            check_log(io.BytesIO(content), "x")


def test_memory_does_not_grow_with_the_file() -> None:
    class Endless(io.RawIOBase):
        """30 MB: a frame, and then zeros."""

        left = 30

        def read(self, _size: int = -1) -> bytes:
            self.left -= 1
            return entry(frame(self.left)) + bytes(1_000_000) if self.left > 0 else b""

    tracemalloc.start()
    try:
        count = sum(isinstance(part, LogFrame) for part in read_log(Endless()))  # type: ignore[arg-type]
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert count == 29
    assert peak < 8_000_000
