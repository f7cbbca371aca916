"""Signed links over real sockets, and their files: a user's keys stay secret, and signing time goes on."""

from __future__ import annotations

import asyncio
import errno
import socket
from pathlib import Path

import pytest
from helpers.link_handler import RecordingHandler, beat, run
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link, parse_endpoint
from gcs.errors import ConfigError
from gcs.geo import LocalFrame
from gcs.io.links.manager import Links
from gcs.io.signing.keystore import KeyFile, TimeFile, read_keys
from gcs.io.signing.link_signing import LinkSigning
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.frames.signing import signing_time
from gcs.model import NoticeCode
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

S = 1_000_000_000
NOW = 1_767_225_600 * S
KEY, OTHER = bytes(range(32)), bytes(range(1, 33))
FRAME = LocalFrame(33.2, -87.6, 70.0)


def key_file(tmp_path: Path, **entries) -> Path:
    path = tmp_path / "keys.toml"
    KeyFile(path, **entries).save()
    return path


# ---------------------------------------------------------------- the files


def test_a_key_file_comes_back_as_it_was_and_is_its_owners_alone(tmp_path):
    path = key_file(
        tmp_path,
        default=KEY,
        links={"serial:/dev/ttyUSB0:57600": OTHER},
        vehicles={3: OTHER, 2 << 8 | 4: KEY},
        pending={3: KEY},
    )
    assert path.stat().st_mode & 0o777 == 0o600
    found = read_keys(path)
    assert (found.default, found.links) == (KEY, {"serial:/dev/ttyUSB0:57600": OTHER})
    assert (found.vehicles, found.pending) == ({3: OTHER, 2 << 8 | 4: KEY}, {3: KEY})
    assert KEY.hex() not in repr(found)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644])
def test_a_key_file_that_others_may_read_is_refused_with_the_remedy(tmp_path, mode):
    path = key_file(tmp_path, default=KEY)
    path.chmod(mode)
    with pytest.raises(ConfigError, match="chmod 600"):
        read_keys(path)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ('default = "zz"', "default"),
        (f'default = "{"00" * 32}"', "default"),
        (f'[vehicles]\n1 = "{KEY.hex()[:-2]}"', "vehicles.1"),
        (f'[vehicles]\n"x" = "{KEY.hex()}"', "vehicles.x"),
        (f'[vehicles]\n251 = "{KEY.hex()}"', "vehicles.251"),
        (f'[links]\n"nowhere" = "{KEY.hex()}"', "links.nowhere"),
        (f'defualt = "{KEY.hex()}"', ""),
        (f'default = "{KEY.hex()}', ""),
    ],
)
def test_mistakes_in_a_key_file_name_the_place_and_never_the_key(tmp_path, text, where):
    path = tmp_path / "keys.toml"
    path.touch(0o600)
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_keys(path)
    assert caught.value.key == where
    assert KEY.hex()[:16] not in str(caught.value)


def test_a_missing_key_file_is_refused_with_the_remedy(tmp_path):
    with pytest.raises(ConfigError, match="gcs keys new"):
        read_keys(tmp_path / "none.toml")


def test_signing_time_goes_on_after_a_crash_and_after_the_clock_went_back(tmp_path):
    link = Link(parse_endpoint("udpin:127.0.0.1:0"))
    keys, address = key_file(tmp_path, default=KEY), (link.name, "127.0.0.1:1")

    def time_of(signing: LinkSigning, t_ns: int) -> int:
        out = signing.gate.sign_frames(t_ns, address, scan(beat(255, ground=True)))
        return signing_time(scan(out).frames[0])

    first = LinkSigning([link], keys)
    first.tick(NOW)
    first.wait_until_saved()
    before = time_of(first, NOW)
    first.tick(NOW + 11 * S)
    first.wait_until_saved()
    last = time_of(first, NOW + 19 * S)  # and now it is killed
    crashed = LinkSigning([link], keys)
    assert time_of(crashed, NOW - 3600 * S) > last > before
    crashed.close()
    assert TimeFile(keys).path.stat().st_mode & 0o777 == 0o600
    assert time_of(LinkSigning([link], keys), NOW - 3600 * S) == crashed.gate.timestamp + 1


def test_a_time_file_that_cannot_be_written_is_told_until_it_can(tmp_path, monkeypatch):
    link = Link(parse_endpoint("udpin:127.0.0.1:0"))
    signing = LinkSigning([link], key_file(tmp_path, default=KEY))
    write = TimeFile.write

    def full(*_args):
        raise OSError(errno.ENOSPC, "No space left on device")

    def told(t_s: int) -> list[NoticeCode]:
        signing.tick(NOW + t_s * S)  # begins a save
        signing.wait_until_saved()
        return [code for _, (code, _) in signing.tick(NOW + t_s * S)]

    monkeypatch.setattr(TimeFile, "write", full)
    assert told(0) == [NoticeCode.SIGNING_TIME_UNWRITTEN]
    monkeypatch.setattr(TimeFile, "write", write)
    assert told(11) == [NoticeCode.SIGNING_TIME_WRITTEN]
    assert told(22) == []


def test_a_damaged_time_file_is_reported_and_not_skipped(tmp_path):
    keys = key_file(tmp_path, default=KEY)
    TimeFile(keys).path.write_bytes(b"{")
    with pytest.raises(ConfigError, match="damaged"):
        LinkSigning([], keys)


def test_a_key_for_an_endpoint_that_is_not_there_is_a_mistake(tmp_path):
    with pytest.raises(ConfigError, match="no such endpoint"):
        LinkSigning([], key_file(tmp_path, links={"udpin:0.0.0.0:1": KEY}))


# ---------------------------------------------------------------- over sockets


def vehicle(key: bytes | None, *, airborne: bool = True) -> SimVehicle:
    spec = VehicleSpec(1, 0.0, 0.0, 0.0, 100.0, 15.0, airborne=airborne)
    return SimVehicle(spec, FRAME, NOW, key)


def test_a_signed_vehicle_is_heard_and_obeys_while_an_impostor_is_kept_out(tmp_path):
    link = Link(parse_endpoint("udpin:127.0.0.1:0"))
    stations = Link(parse_endpoint("udpin:localhost:0"), role="full")

    async def scenario() -> None:
        loop, handler, plane = asyncio.get_running_loop(), RecordingHandler(NOW), vehicle(KEY)
        links = Links(
            [link, stations], [1], FRAME, LinkSigning([link, stations], key_file(tmp_path, vehicles={1: KEY}))
        )
        links.start(loop, handler)
        to = ("127.0.0.1", links.ports()[link.name])
        with (
            socket.socket(type=socket.SOCK_DGRAM) as radio,
            socket.socket(type=socket.SOCK_DGRAM) as foe,
            socket.socket(type=socket.SOCK_DGRAM) as station,
        ):
            for one in (radio, foe, station):
                one.setblocking(False)
                one.bind(("127.0.0.1", 0))
            (first, *_) = plane.datagrams_to_send(NOW)
            radio.sendto(first, to)
            await handler.until(lambda: handler.heard, "nothing was heard")
            peer = handler.heard[0][1]
            assert handler.heard[0][2] == first, "as it came: a recording can show it"
            foe.sendto(beat(1), to)
            counters = links.signing.gate.counters[link.name]
            await handler.until(lambda: counters.rejected, "it was let in")
            links.tick(NOW)
            assert len(handler.heard) == 1
            rejected = handler.notices[-1]
            assert (rejected.code, rejected.parameters["reason"]) == (
                NoticeCode.FRAMES_REJECTED,
                "not signed",
            )
            assert rejected.parameters["sender"] == f"system 1/1 at 127.0.0.1:{foe.getsockname()[1]}"
            # A ground station without a key commands it through central command, which signs.
            request = dialect.MAVLink_command_long_message(1, 1, 20, 0, 0, 0, 0, 0, 0, 0, 0)
            station.sendto(Encoder(254, 190)(request), ("127.0.0.1", links.ports()[stations.name]))
            data = await asyncio.wait_for(loop.sock_recv(radio, 2000), 5.0)
            assert peer == f"127.0.0.1:{radio.getsockname()[1]}"
            plane.receive_datagram(data, NOW)
            assert plane.autopilot.mode.name == "RTL"
        links.close()

    run(scenario())


def test_the_simulated_vehicle_takes_orders_by_its_key_alone():
    plane = vehicle(KEY)
    home = Encoder()(dialect.MAVLink_command_long_message(1, 1, 20, 0, 0, 0, 0, 0, 0, 0, 0))
    plane.receive_datagram(home, NOW)
    assert plane.autopilot.mode.name == "LOITER"
    unsigned = vehicle(None)
    unsigned.receive_datagram(home, NOW)
    assert unsigned.autopilot.mode.name == "RTL"


def test_the_simulated_vehicle_takes_a_key_on_the_ground_only():
    setup = Encoder()(dialect.MAVLink_setup_signing_message(1, 1, list(KEY), 0))
    for airborne in (False, True):
        plane = vehicle(None, airborne=airborne)
        plane.datagrams_to_send(NOW + S)
        plane.receive_datagram(setup, NOW + S)
        frames = [f for data in plane.datagrams_to_send(NOW + 3 * S) for f in scan(data).frames]
        assert all(frame.signed for frame in frames) is not airborne
