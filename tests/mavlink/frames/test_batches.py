"""A flood is put together: no frame may be lost, changed or overtaken by a later one of its sender."""

import numpy as np
from helpers.frame_bytes import BYTES, frame
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.mavlink.frames.batches import MAX_BYTES, DatagramBatcher
from gcs.mavlink.frames.codec import scan

POSITION = st.builds(lambda n: frame(33, bytes([7] * 28), seq=n), st.integers(0, 255))
DATAGRAMS = st.lists(
    st.tuples(st.integers(0, 3), st.one_of(POSITION, POSITION, POSITION, BYTES)), min_size=1, max_size=80
)
GATHERER = DatagramBatcher(256)


def gathered(datagrams):
    """Sender and data of each group; senders look like socket addresses."""
    slots = np.zeros((256, 8192), np.uint8)
    for slot, (_, data) in zip(slots, datagrams, strict=False):
        slot[: len(data)] = np.frombuffer(data, np.uint8)
    senders = np.array([sender * 0x0100_0000_0000 + 0x7F00_2328_0002 for sender, _ in datagrams], np.int64)
    lengths = np.array([len(data) for _, data in datagrams], np.int64)
    return [(datagrams[i][0], data) for i, data in GATHERER.gather(slots, lengths, senders)]


def counted(parts):
    found = [scan(data) for data in parts]
    frames = [frame for one in found for frame in one.frames]
    return (
        frames,
        sum(f.bad_bytes for f in found),
        sum(f.crc_errors for f in found),
        sum(f.unknown for f in found),
    )


@settings(max_examples=150)
@given(DATAGRAMS)
def test_of_each_sender_the_same_is_found_in_the_same_order(datagrams):
    groups = gathered(datagrams)
    for sender in range(4):
        parts = [data for s, data in datagrams if s == sender]
        whole = [data for s, data in groups if s == sender]
        assert b"".join(whole) == b"".join(parts)
        assert counted(whole) == counted(parts)
    for _, data in groups:
        assert len(data) <= MAX_BYTES or data in [d for _, d in datagrams]


def test_clean_datagrams_of_a_sender_become_few_and_a_damaged_one_stays_alone():
    good = frame(33, bytes([7] * 28))
    damaged = b"\xfd\x09" + good
    groups = gathered([(k % 2, good) for k in range(40)] + [(0, damaged), (0, good), (1, good)])
    assert [(sender, len(data)) for sender, data in groups] == [
        (0, 20 * 40),
        (1, 21 * 40),
        (0, len(damaged)),
        (0, 40),
    ]
