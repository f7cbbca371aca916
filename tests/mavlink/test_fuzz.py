"""Anybody on the link could stop the service if one datagram could make it raise."""

import fuzz_link
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.mavlink.frames.codec import decode, scan


@settings(max_examples=100)
@given(
    st.lists(
        st.one_of(st.binary(max_size=60), st.sampled_from([b"\xfd", b"\xfe", b"\xfd\x09\x01"])), max_size=8
    )
)
def test_no_bytes_make_the_scan_raise_and_none_are_counted_twice(parts):
    data = b"".join(parts)
    found = scan(data)
    assert sum(len(frame.data) for frame in found.frames) + found.bad_bytes <= len(data)
    decode(data)


def test_hostile_frames_into_fleet_and_transfers_raise_nothing():
    done, seen = fuzz_link.run(3000, 7, pool=1500)
    assert done == 3000
    assert min(seen[what] for what in ("messages", "sends", "tasks")) > 0
