"""A flooded socket is read at a few system calls: what comes out is what was sent."""

import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.edge.batches import FLOOD, ManyAtOnce, OneByOne, reader
from gcs.mavlink.codec import Encoder, scan


def bound() -> socket.socket:
    fresh = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    fresh.setblocking(False)
    fresh.bind(("127.0.0.1", 0))
    return fresh


@pytest.mark.parametrize("kind", [OneByOne, ManyAtOnce])
@pytest.mark.parametrize("count", [1, FLOOD - 1, 100])
def test_each_sender_is_heard_in_its_order(kind, count):
    beat = dialect.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)
    with bound() as ours, bound() as one, bound() as other:
        senders = {f"127.0.0.1:{s.getsockname()[1]}": (s, Encoder(n, 1)) for n, s in enumerate((one, other))}
        sent = dict.fromkeys(senders, b"")
        for _ in range(count):
            for peer, (sender, encode) in senders.items():
                sent[peer] += (data := encode(beat))
                sender.sendto(data, ours.getsockname())
        read, heard = kind().read(ours)
        assert read == 2 * count
        assert {peer: b"".join(d for p, d in heard if p == peer) for peer in senders} == sent
        assert sum(len(scan(data).frames) for _, data in heard) == 2 * count
        assert kind().read(ours) == (0, [])


def test_the_largest_datagram_comes_whole_and_an_empty_one_ends_nothing():
    with bound() as ours, bound() as theirs:
        for data in (b"", b"x" * 65_507, b"y"):
            theirs.sendto(data, ours.getsockname())
        _, heard = reader().read(ours)
        assert [data for _, data in heard] == [b"", b"x" * 65_507, b"y"]
