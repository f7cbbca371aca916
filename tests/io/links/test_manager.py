"""Endpoints on real sockets and a real pseudo-terminal: frames arrive whole, and what is lost comes back."""

from __future__ import annotations

import asyncio
import os
import socket
import tty
from pathlib import Path

import pytest
from helpers.link_handler import RecordingHandler, beat, run
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link, parse_endpoint
from gcs.errors import LinkError
from gcs.geo import LocalFrame
from gcs.io.links.manager import Links
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.model import NoticeCode, Picture, Track, read_only

FRAME = LocalFrame(33.2, -87.6, 70.0)
S = 1_000_000_000


def arm(target: int) -> bytes:
    message = dialect.MAVLink_command_long_message(target, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    return Encoder(254, 190)(message)


def opened(*links: Link) -> Links:
    return Links(links, [1, 2], FRAME)


def link(text: str, **settings) -> Link:
    return Link(parse_endpoint(text), **settings)


def free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_udp_out_sends_first_and_receives_the_answers():
    async def scenario() -> None:
        handler = RecordingHandler(S)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            vehicle.bind(("127.0.0.1", 0))
            vehicle.setblocking(False)
            name = f"udpout:127.0.0.1:{vehicle.getsockname()[1]}"
            links = opened(link(name))
            links.start(asyncio.get_running_loop(), handler)
            loop = asyncio.get_running_loop()
            hearing = asyncio.create_task(loop.sock_recvfrom(vehicle, 1000))
            while not hearing.done():
                links.send(name, name.removeprefix("udpout:"), b"hello")
                await asyncio.sleep(0.01)
            data, back = hearing.result()
            assert data == b"hello"
            vehicle.sendto(beat(1), back)
            await handler.until(lambda: handler.heard, "nothing came back")
            assert handler.heard[0] == (name, name.removeprefix("udpout:"), beat(1))
            links.close()

    run(scenario())


def test_a_name_that_is_found_later_ends_the_warning():
    async def scenario() -> None:
        loop, handler = asyncio.get_running_loop(), RecordingHandler(S)
        find = loop.getaddrinfo

        async def not_at_first(*args, **kwargs):
            if not handler.count(NoticeCode.LINK_FAILED):
                raise socket.gaierror(-2, "Name or service not known")
            return await find(*args, **kwargs)

        loop.getaddrinfo = not_at_first
        links = opened(link(f"udpout:localhost:{free_port(socket.SOCK_DGRAM)}"))
        links.start(loop, handler)
        await handler.until(lambda: handler.count(NoticeCode.LINK_OPEN), "the name was not found")
        assert handler.count(NoticeCode.LINK_FAILED) == 1
        links.close()

    run(scenario())


def test_tcp_is_tried_until_it_is_accepted_and_again_when_it_is_lost():
    async def scenario() -> None:
        handler, port = RecordingHandler(S), free_port(socket.SOCK_STREAM)
        name = f"tcp:127.0.0.1:{port}"
        links = opened(link(name))
        links.start(asyncio.get_running_loop(), handler)
        await handler.until(lambda: handler.count(NoticeCode.LINK_FAILED), "the refusal was not reported")
        assert handler.notices[0].parameters["problem"] == "not connected (Connection refused)"
        for turn in (1, 2):
            writers = []
            accepted = asyncio.Event()

            def accept(_reader, writer, writers=writers, accepted=accepted) -> None:
                writers.append(writer)
                accepted.set()

            server = await asyncio.start_server(accept, "127.0.0.1", port)
            await accepted.wait()
            half = len(beat(1)) // 2
            writers[0].write(beat(1) + beat(2)[:half])
            await handler.until(lambda n=turn: handler.frames() == 2 * n - 1, "the first frame")
            writers[0].write(beat(2)[half:])
            await handler.until(lambda n=turn: handler.frames() == 2 * n, "the frame in two reads")
            writers[0].close()
            server.close()
            await handler.until(lambda n=turn: handler.count(NoticeCode.LINK_FAILED) == 1 + n, "the loss")
        assert {peer for _, peer, _ in handler.heard} == {f"127.0.0.1:{port}"}
        links.close()

    run(scenario())


def test_a_tcp_client_is_heard_and_answered_and_one_that_never_reads_blocks_no_other():
    async def scenario() -> None:
        handler, links = RecordingHandler(S), opened(link("tcpin:127.0.0.1:0"))
        links.start(asyncio.get_running_loop(), handler)
        reader, writer = await asyncio.open_connection("127.0.0.1", links.port)
        writer.write(beat(1))
        await handler.until(lambda: handler.heard, "nothing heard")
        peer = handler.heard[0][1]
        links.send("tcpin:127.0.0.1:0", peer, b"answer")
        assert await reader.readexactly(6) == b"answer"
        for _ in range(2000):
            links.send("tcpin:127.0.0.1:0", peer, bytes(10_000))
        assert links.unsent()["tcpin:127.0.0.1:0"] > 0
        writer.transport.abort()
        await handler.until(lambda: handler.count(NoticeCode.PEER_GONE), "the end was not reported")
        links.close()

    run(scenario())


def test_a_serial_port_that_is_unplugged_is_opened_again(tmp_path: Path):
    async def scenario() -> None:
        handler, device = RecordingHandler(S), tmp_path / "radio"
        name = f"serial:{device}:57600"
        links = opened(link(name))
        links.start(asyncio.get_running_loop(), handler)
        await handler.until(
            lambda: handler.count(NoticeCode.LINK_FAILED), "the missing port was not reported"
        )
        assert handler.notices[0].parameters["problem"] == "cannot be opened (No such file or directory)"
        for turn in (1, 2):
            ours, theirs = os.openpty()
            tty.setraw(theirs)
            device.unlink(missing_ok=True)
            device.symlink_to(os.ttyname(theirs))
            await handler.until(lambda n=turn: handler.count(NoticeCode.LINK_OPEN) == n, "it was not opened")
            os.write(ours, b"\xfdnoise" + beat(1)[:7])
            os.write(ours, beat(1)[7:] + b"\x00" * 300)
            await handler.until(lambda n=turn: handler.frames() == n, "the frame did not come")
            links.send(name, str(device), beat(255, 190))
            assert os.read(ours, 100) == beat(255, 190)
            os.close(ours)
            os.close(theirs)
            await handler.until(
                lambda n=turn: handler.count(NoticeCode.LINK_FAILED) == 1 + n, "the loss was not reported"
            )
        links.close()

    run(scenario())


def test_another_station_sees_vehicles_and_targets_and_its_word_reaches_one_vehicle():
    async def scenario() -> None:
        handler = RecordingHandler(S)
        links = opened(
            link("udpin:127.0.0.1:0"),
            link("tcpin:127.0.0.1:0", role="full", adsb=True),
            link("udpin:localhost:0", role="read-only"),
        )
        ports = list(links.ports().values())
        loop = asyncio.get_running_loop()
        links.start(loop, handler)
        vehicles = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        for number, vehicle in enumerate(vehicles, 1):
            vehicle.setblocking(False)
            vehicle.sendto(beat(number), ("127.0.0.1", ports[0]))
        await handler.until(lambda: handler.frames() == 2, "the vehicles were not heard")
        reader, writer = await asyncio.open_connection("127.0.0.1", ports[1])
        writer.write(beat(254, 190, ground=True) + arm(2))
        assert await loop.sock_recv(vehicles[1], 1000) == arm(2)
        with pytest.raises(BlockingIOError):
            vehicles[0].recv(1000)
        await handler.until(lambda: handler.frames() == 3, "central command was not reported")
        assert handler.heard[-1][2] == arm(2)

        vehicles[0].sendto(beat(1), ("127.0.0.1", ports[0]))
        assert await reader.readexactly(len(beat(1))) == beat(1)
        mean = read_only([100.0, 200.0, 3.0, 4.0])
        track = Track((12, 3), mean, read_only([[1.0] * 4] * 4), 0.99, estimated=True)
        unsure = Track((13, 0), mean, track.cov, 0.3)
        links.picture(Picture(S, S, "targets", (track, unsure), read_only([0.1, 0.9])))
        links.tick(handler.t_ns)
        links.tick(handler.t_ns + S // 2)
        (found,) = scan(await reader.read(1000)).frames
        message = found.message()
        assert (found.system_id, found.component_id) == (1, dialect.MAV_COMP_ID_ADSB)
        assert (message.get_type(), message.callsign) == ("ADSB_VEHICLE", "T12.3")
        assert (message.hor_velocity, message.heading) == (500, 3687)
        lat_deg, lon_deg = FRAME.to_geodetic(100.0, 200.0)
        assert (message.lat, message.lon) == (round(lat_deg * 1e7), round(lon_deg * 1e7))
        for vehicle in vehicles:
            vehicle.close()
        writer.close()
        links.close()

    run(scenario())


def test_a_port_that_is_taken_is_named_and_the_others_are_let_go():
    first = opened(link("udpin:127.0.0.1:0"))
    port = free_port(socket.SOCK_STREAM)
    with pytest.raises(LinkError, match="Address already in use; end the program that has it"):
        opened(link(f"tcpin:127.0.0.1:{port}"), link(f"udpin:127.0.0.1:{first.port}"))
    opened(link(f"tcpin:127.0.0.1:{port}")).close()
    first.close()


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
@pytest.mark.parametrize(
    ("host", "problem"),
    [("192.0.2.1", "this machine does not have this address"), ("no-such-host.invalid", "correct the host")],
)
def test_an_address_of_another_machine_is_no_other_ground_station(kind, host, problem):
    """Before, "is another ground station running?"."""
    with pytest.raises(LinkError, match=problem):
        opened(link(f"{kind}:{host}:{free_port(socket.SOCK_STREAM)}"))
