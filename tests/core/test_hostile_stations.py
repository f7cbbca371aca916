"""No bytes of another ground station or of a vehicle's link raise an exception in routes or engine."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.authority.external_uploads import ExternalUploads
from gcs.core.state import State
from gcs.endpoints import Link, parse_endpoint
from gcs.mavlink.frames.codec import scan
from gcs.mavlink.router.router import Router
from gcs.model import Authority, Datagram

AIR, SEAT = "udpin:0.0.0.0:1", "udpin:0.0.0.0:2"
LINKS = [Link(parse_endpoint(AIR)), Link(parse_endpoint(SEAT), role="full")]
IDS = sorted(dialect.mavlink_map)
UNKNOWN = (0xEEEEEE, 60_000)


def whole(message_id: int, system: int, component: int, payload: bytes) -> bytes:
    """A frame whose checksum holds, whatever its payload; of an unknown id, any checksum will do."""
    head = bytes([len(payload), 0, 0, 0, system, component]) + message_id.to_bytes(3, "little")
    known = dialect.mavlink_map.get(message_id)
    crc = dialect.x25crc(head + payload + bytes([known.crc_extra if known else 0])).crc
    return b"\xfd" + head + payload + crc.to_bytes(2, "little")


FRAMES = st.builds(
    whole,
    st.sampled_from(IDS) | st.sampled_from([39, 41, 44, 45, 47, 73, 75, 76]) | st.sampled_from(UNKNOWN),
    st.sampled_from([1, 2, 77, 254, 255]),
    st.sampled_from([0, 1, 190, 195]),
    st.binary(max_size=60)
    | st.binary(min_size=1, max_size=40).map(lambda b: b.translate(bytes([1, 2] * 128))),
)
HOSTILE = st.lists(st.binary(max_size=50) | FRAMES, max_size=12).map(b"".join)


@settings(max_examples=80)
@given(st.lists(st.tuples(st.booleans(), HOSTILE), max_size=12))
def test_no_bytes_make_routes_or_the_watch_over_other_stations_fail(reads: list[tuple[bool, bytes]]) -> None:
    state = State.initial((1, 2))
    router, stations = Router(LINKS, [1, 2]), ExternalUploads(LINKS, state.agents, state.authority)
    for number, (is_station, data) in enumerate(reads):
        address = (SEAT if is_station else AIR, "10.0.0.1:9")
        found = scan(data)
        for frame in found:
            assert address not in router.route_frame(number, address, frame).to
            message = frame.message() if not is_station else None
            if message is not None:
                stations.receive_reply(1, message, number)
        if is_station:
            stations.receive(Datagram(number, SEAT, "10.0.0.1:9", data), found)
    allowed = {Authority.OTHER_STATION, Authority.COMMANDED}
    assert all(one.control.claims.keys() <= allowed for one in state.agents.values())
