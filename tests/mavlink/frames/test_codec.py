"""A user would lose good frames next to damaged ones, or fly on bytes that were never checked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Encoder, decode, scan

POSITION = dialect.MAVLink_global_position_int_message(
    1234, 471234567, 81234567, 500000, 100000, 1, -2, 3, 4500
)


def frames(count, system_id=7):
    encode = Encoder(system_id, 1)
    return [encode(POSITION) for _ in range(count)]


def test_what_is_encoded_is_decoded_with_sender_and_running_sequence():
    messages, found = decode(b"".join(frames(300)))
    assert [m.lat for m in messages] == [471234567] * 300
    assert [f.sequence for f in found.frames] == [n % 256 for n in range(300)]
    assert {(f.system_id, f.component_id) for f in found.frames} == {(7, 1)}
    assert (found.bad_bytes, found.crc_errors, found.unknown) == (0, 0, 0)


def test_old_mavlink_1_vehicles_are_understood():
    packer = dialect.MAVLink(None, srcSystem=3, srcComponent=1)
    messages, found = decode(POSITION.pack(packer, force_mavlink1=True))
    assert found.frames[0].system_id == 3
    assert messages[0].lon == 81234567


@pytest.mark.parametrize("cut", [1, 5, 9, 12, 20])
def test_a_truncated_frame_costs_none_of_the_good_ones_behind_it(cut):
    first, second, third = frames(3)
    found = scan(first + second[:cut] + third)
    assert [f.sequence for f in found.frames] == [0, 2]
    assert found.bad_bytes == cut


def test_a_frame_with_a_wrong_length_byte_does_not_swallow_its_successor():
    first, second = frames(2)
    broken = bytearray(first)
    broken[1] = 200
    found = scan(bytes(broken) + second * 8)
    assert len(found.frames) == 8


def test_a_datagram_is_read_from_empty_whatever_came_before():
    first, second = frames(2)
    scan(first[:-1])
    assert len(scan(second).frames) == 1


def test_unknown_ids_are_skipped_and_counted():
    good = frames(1)[0]
    unknown = bytes([0xFD, 3, 0, 0, 0, 7, 1, 0xEE, 0xEE, 0xEE, 1, 2, 3, 9, 9])
    found = scan(good + unknown + good)
    assert (len(found.frames), found.unknown, found.bad_bytes) == (2, 1, 0)


def test_flags_that_we_do_not_know_make_a_frame_unreadable():
    broken = bytearray(frames(1)[0])
    broken[2] = 0x02
    assert scan(bytes(broken)).frames == []


def test_the_checksum_counts_whatever_the_dialect_thinks_of_it(monkeypatch):
    monkeypatch.setattr(dialect, "MAVLINK_IGNORE_CRC", 1)
    broken = bytearray(frames(1)[0])
    broken[14] ^= 1
    found = scan(bytes(broken))
    assert (found.frames, found.crc_errors) == ([], 1)


def test_hostile_bytes_buy_little_work(monkeypatch):
    checks = []
    crc = dialect.x25crc
    monkeypatch.setattr(dialect, "x25crc", lambda buf: checks.append(1) or crc(buf))
    found = scan(b"\xfe\x20\x00\x01\x01\x00" * 10_000)
    assert found.frames == []
    assert found.bad_bytes == 60_000
    assert len(checks) <= 64


@given(st.binary(max_size=600))
def test_no_bytes_raise_and_every_byte_is_accounted_for(data):
    messages, found = decode(data)
    assert len(messages) <= len(found.frames)
    assert 0 <= found.bad_bytes <= len(data)


@settings(derandomize=True)  # four or more flips pass a 16-bit checksum once in some 65 000 times
@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(0, 3))
def test_flipped_bits_never_yield_a_message_that_was_not_sent(seed, flips, position):
    rng = np.random.default_rng(seed)
    data = bytearray(b"".join(frames(4)))
    size = len(data) // 4
    for bit in rng.choice(size * 8, size=flips, replace=False):
        data[position * size + bit // 8] ^= 1 << (bit % 8)
    messages, found = decode(bytes(data))
    untouched = [n for n in range(4) if n != position]
    assert [f.sequence for f in found.frames if f.system_id == 7] == untouched
    assert all(m.to_dict() == POSITION.to_dict() for m in messages)


@given(st.sampled_from(sorted(dialect.mavlink_map)), st.binary(max_size=255))
def test_any_payload_under_a_valid_checksum_unpacks_or_is_dropped(message_id, payload):
    head = bytes([len(payload), 0, 0, 0, 1, 1]) + message_id.to_bytes(3, "little")
    crc = dialect.x25crc(head + payload + bytes([dialect.mavlink_map[message_id].crc_extra])).crc
    messages, found = decode(b"\xfd" + head + payload + crc.to_bytes(2, "little"))
    assert len(found.frames) == 1
    assert all(m.get_msgId() == message_id for m in messages)
