"""Frames with and without damage, as bytes."""

from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

IDS = sorted(dialect.mavlink_map)


def frame(message_id, payload, *, seq=0, system=1, component=1, version=2, flags=0):
    """A frame whose checksum holds, of any id."""
    known = dialect.mavlink_map.get(message_id)
    if version == 1 and message_id < 256:
        head, magic = bytes([len(payload), seq, system, component, message_id]), b"\xfe"
    else:
        head = bytes([len(payload), flags, 0, seq, system, component]) + message_id.to_bytes(3, "little")
        magic = b"\xfd"
    extra = 0 if known is None else known.crc_extra
    crc = dialect.x25crc(head + payload + bytes([extra])).crc
    return magic + head + payload + crc.to_bytes(2, "little") + (bytes(13) if flags & 1 else b"")


GOOD = st.builds(
    frame,
    st.one_of(st.sampled_from(IDS), st.sampled_from([0, 1, 24, 33, 42]), st.integers(0, 2**24 - 1)),
    st.binary(max_size=255),
    seq=st.integers(0, 255),
    version=st.sampled_from([1, 2]),
    flags=st.sampled_from([0, 0, 0, 1, 2]),
)


@st.composite
def damaged(draw):
    data = bytearray(draw(GOOD))
    if draw(st.booleans()):
        data[draw(st.integers(0, len(data) - 1))] ^= 1 << draw(st.integers(0, 7))
    return bytes(data[: draw(st.integers(0, len(data)))])


BYTES = st.lists(
    st.one_of(
        GOOD, GOOD, damaged(), st.binary(max_size=30), st.sampled_from([b"\xfd", b"\xfe", b"\xfe\x00"])
    ),
    max_size=12,
).map(b"".join)
