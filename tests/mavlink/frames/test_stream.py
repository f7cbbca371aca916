"""Streams are cut where frames end: however reads fall, no good frame is lost or glued to another."""

from itertools import pairwise

from hypothesis import assume, example, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.frames.stream import FrameStream

ENCODE = Encoder(1, 1)
FRAMES = [
    ENCODE(dialect.MAVLink_heartbeat_message(1, 3, 0, n, 4, 3))
    + ENCODE(dialect.MAVLink_statustext_message(6, b"x" * (n + 1)))
    for n in range(8)
]
PARTS = st.lists(st.one_of(st.sampled_from(FRAMES), st.binary(max_size=40)), max_size=12)


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    places = sorted({cut % (len(data) + 1) for cut in cuts} | {0, len(data)})
    return [data[a:b] for a, b in pairwise(places)]


@given(st.lists(st.sampled_from(FRAMES), max_size=12), st.lists(st.integers(0, 10_000), max_size=20))
def test_a_clean_stream_loses_nothing_however_it_is_read(frames: list[bytes], cuts: list[int]) -> None:
    framer, stream = FrameStream(), b"".join(frames)
    chunks = [framer.add_bytes(piece) for piece in pieces(stream, cuts)]
    assert b"".join(chunks) == stream
    found = [scan(chunk) for chunk in chunks]
    assert sum(len(f.frames) for f in found) == 2 * len(frames)
    assert sum(f.bad_bytes for f in found) == 0


NOISE_OF_UNKNOWN_ID = b"\xfe]"
"""Followed by frames, it claims 101 bytes of an unknown id, up to a byte that looks like a frame's first."""


def test_noise_that_claims_to_be_an_unknown_message_swallows_no_frame() -> None:
    stream = NOISE_OF_UNKNOWN_ID + b"\x00\x00" + b"".join(FRAMES[n] for n in (0, 6, 0)) + FRAMES[0]
    length = 8 + stream[1]
    assert stream[5] not in dialect.mavlink_map
    assert stream[length] == 0xFD  # of a STATUSTEXT's message id
    assert len(scan(stream).frames) == 8
    assert len(scan(stream[:length]).frames) == 5  # it may end with the datagram, too


def test_a_message_of_an_unknown_id_is_still_one() -> None:
    unknown = bytes([0xFD, 6, 0, 0, 7, 1, 1, 0xF0, 0xFF, 0xFE]) + b"\xfd\xfe\xfd" + bytes(5)
    found = scan(unknown + FRAMES[0])
    assert [found.frame(row).data for row in range(found.count) if not found.is_checked(row)] == [unknown]
    assert len(found.frames) == 2


@example(parts=[NOISE_OF_UNKNOWN_ID, b"\x00\x00", FRAMES[0], FRAMES[6], FRAMES[0]], cuts=[])
@given(parts=PARTS, cuts=st.lists(st.integers(0, 10_000), max_size=20))
def test_noise_delays_frames_and_never_swallows_them(parts: list[bytes], cuts: list[int]) -> None:
    noise = b"".join(part for part in parts if part not in FRAMES)
    assume(noise.count(0xFD) + noise.count(0xFE) < 60)  # the number of false starts is bounded
    framer, stream = FrameStream(), b"".join(parts)
    flush = b"\x00" * 300 + FRAMES[0]  # longer than any frame that noise may have claimed
    chunks = [framer.add_bytes(piece) for piece in [*pieces(stream, cuts), flush]]
    assert b"".join(chunks) == stream + flush
    got = sum(len(scan(chunk).frames) for chunk in chunks)
    assert got >= 2 * sum(part in FRAMES for part in parts) + 2


@given(st.lists(st.binary(max_size=600), max_size=10))
def test_hostile_streams_are_held_back_by_less_than_a_frame(reads: list[bytes]) -> None:
    framer, held = FrameStream(), 0
    for data in reads:
        held += len(data) - len(framer.add_bytes(data))
        assert 0 <= held < 280
