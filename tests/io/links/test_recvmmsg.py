"""A flooded socket is read at a few system calls: what comes out is what was sent."""

import asyncio
import socket
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.io.links import recvmmsg
from gcs.io.links.recvmmsg import FLOOD, BatchReader, SingleReader, SocketReader, reader
from gcs.mavlink.frames.codec import Encoder, scan


def bound() -> socket.socket:
    fresh = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    fresh.setblocking(False)
    fresh.bind(("127.0.0.1", 0))
    return fresh


@pytest.mark.parametrize("kind", [SingleReader, BatchReader])
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


def heard_across(pauses: list[tuple[float, int]]) -> list[bytes]:
    """Let a loop stand still, again and again, while datagrams come; return what it heard in the end."""

    async def run() -> list[bytes]:
        heard: list[bytes] = []
        with bound() as ours, bound() as theirs:
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 64 * 1024)  # some 150 datagrams
            source = SocketReader(asyncio.get_running_loop(), ours, lambda _, data: heard.append(data), print)
            number = 0
            for pause_s, count in pauses:
                for _ in range(count):
                    theirs.sendto(f"{number}".encode(), ours.getsockname())
                    number += 1
                    time.sleep(pause_s / count)  # the loop is busy
            await asyncio.sleep(0.05)
            source.close()
        return heard

    return asyncio.run(run())


def test_a_busy_loop_loses_no_datagrams_beyond_the_receive_buffer():
    assert heard_across([(0.6, 400)]) == [f"{number}".encode() for number in range(400)]


@pytest.mark.real_time
def test_datagrams_that_waited_too_long_are_not_taken_for_new():
    heard = heard_across([(1.0, 10), (2.1, 10)])
    assert heard[-1] == b"19"
    assert b"0" not in heard


def test_a_read_that_fails_is_reported_and_retried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recvmmsg, "_RETRY_MS", 20)
    reads = [OSError("no memory")]
    plain = SingleReader()

    class Failing:
        def read(self, source: socket.socket):
            if reads:
                raise reads.pop()
            return plain.read(source)

    monkeypatch.setattr(recvmmsg, "reader", Failing)

    async def run() -> tuple[list[bytes], list[str]]:
        heard: list[bytes] = []
        reasons: list[str] = []
        with bound() as ours, bound() as theirs:
            loop = asyncio.get_running_loop()
            source = SocketReader(loop, ours, lambda _, data: heard.append(data), reasons.append)
            theirs.sendto(b"x", ours.getsockname())
            async with asyncio.timeout(5.0):
                while not heard:
                    await asyncio.sleep(0.01)
            source.close()
        return heard, reasons

    assert asyncio.run(run()) == ([b"x"], ["no memory"])
