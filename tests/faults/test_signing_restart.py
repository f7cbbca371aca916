"""A service is killed and started again: recorded frames stay old, and vehicles are heard at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.noticed import noticed
from helpers.wall_clock import WallClock
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link, parse_endpoint
from gcs.geo import LocalFrame
from gcs.io.signing.keystore import KeyFile
from gcs.io.signing.link_signing import LinkSigning
from gcs.mavlink.fleet.fleet import Fleet, FleetSettings
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.frames.signing import signed, timestamp_of
from gcs.mavlink.router.router import Router
from gcs.model import NS_PER_S, Datagram, NoticeCode

NOW = 1_767_225_600 * NS_PER_S
KEY = bytes(range(32))
LINK = Link(parse_endpoint("udpin:0.0.0.0:14550"))
GROUND = Link(parse_endpoint("udpin:0.0.0.0:14551"), role="full")
HOME, FOE = (LINK.name, "10.0.0.1:5000"), (LINK.name, "66.6.6.6:666")
FRAME = LocalFrame(33.2, -87.6, 70.0)


@pytest.fixture
def unix(wall: WallClock) -> WallClock:
    wall.t_ns = NOW
    return wall


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    path = tmp_path / "keys.toml"
    KeyFile(path, default=KEY).save()
    return path


class SignedPlane:
    """Signs heartbeats with its clock, which is `lead_s` ahead of ours."""

    def __init__(self, lead_s: float = 0.0, system_id: int = 1) -> None:
        self._encode = Encoder(system_id, 1)
        self._lead_ns = int(lead_s * NS_PER_S)

    def beat(self, t_ns: int) -> bytes:
        frame = self._encode(dialect.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3))
        return signed(frame, KEY, 0, timestamp_of(t_ns + self._lead_ns))


def fly(
    signing: LinkSigning, unix: WallClock, planes: list[SignedPlane], from_s: float, to_s: float
) -> list[bytes]:
    """Have planes send ten times a second; return the frames, all of them accepted."""
    frames = []
    for tenth in range(round(from_s * 10), round(to_s * 10)):
        unix.t_ns = t_ns = NOW + tenth * NS_PER_S // 10
        frames += [plane.beat(t_ns) for plane in planes]
        assert all(signing.gate.accept_frames(t_ns, HOME, scan(frame)) for frame in frames[-len(planes) :])
        signing.tick(t_ns)
        signing.wait_until_saved()
    return frames


def accepted(signing: LinkSigning, t_ns: int, frames: list[bytes]) -> int:
    return sum(bool(signing.gate.accept_frames(t_ns, FOE, scan(frame))) for frame in frames)


@pytest.mark.parametrize("killed_s", [0.5, 3.0, 9.9, 10.3, 19.9, 64.0])
@pytest.mark.parametrize("lead_s", [0.0, -20.0, 35.0])
def test_frames_recorded_before_a_crash_are_refused_and_newer_ones_heard_at_once(
    unix, keys, killed_s, lead_s
):
    planes = [SignedPlane(lead_s, system_id) for system_id in (1, 2)]
    recorded = fly(LinkSigning([LINK], keys), unix, planes, 0.0, killed_s)
    unix.t_ns = t_ns = NOW + int((killed_s + 2.0) * NS_PER_S)
    again = LinkSigning([LINK], keys)
    assert accepted(again, t_ns, recorded) == 0
    later_ns = t_ns + NS_PER_S // 10
    assert all(again.gate.accept_frames(later_ns, HOME, scan(p.beat(later_ns))) for p in planes)


def test_a_vehicle_that_jumps_ahead_just_before_the_crash_cannot_be_replayed(unix, keys):
    first, plane = LinkSigning([LINK], keys), SignedPlane()
    fly(first, unix, [plane], 0.0, 12.0)
    ahead = SignedPlane(31.0)
    recorded = fly(first, unix, [ahead], 12.0, 13.0)
    unix.t_ns = t_ns = NOW + 15 * NS_PER_S
    again = LinkSigning([LINK], keys)
    assert accepted(again, t_ns, recorded) == 0
    assert again.gate.accept_frames(t_ns + 1, HOME, scan(ahead.beat(t_ns + NS_PER_S // 10)))


@pytest.mark.parametrize("off_s", [3600, -3600, 86_400 * 365])
def test_a_clock_that_is_set_while_the_service_is_down_locks_no_vehicle_out(unix, keys, off_s):
    recorded = fly(LinkSigning([LINK], keys), unix, [SignedPlane()], 0.0, 9.0)
    unix.t_ns = NOW + (11 + off_s) * NS_PER_S
    again = LinkSigning([LINK], keys)
    assert accepted(again, unix.t_ns, recorded) == 0
    plane = SignedPlane()
    late = plane.beat(NOW + 11 * NS_PER_S)
    if not again.gate.accept_frames(
        unix.t_ns, HOME, scan(late)
    ):  # then it gets the time, and is heard with its next frame
        assert HOME in again.gate.take_stale_senders(unix.t_ns)
        answer = again.gate.sign_frames(
            unix.t_ns, HOME, scan(Encoder()(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
        )
        sent_time = int.from_bytes(answer[-12:-6], "little")
        frame = signed(
            Encoder(1, 1)(dialect.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)), KEY, 0, sent_time + 1
        )
        assert again.gate.accept_frames(unix.t_ns, HOME, scan(frame))
    late = plane.beat(NOW + (11 + max(off_s, 0) + 31) * NS_PER_S)
    assert again.gate.accept_frames(unix.t_ns, HOME, scan(late))


def test_a_run_that_ends_in_order_keeps_the_exact_times(unix, keys):
    first = LinkSigning([LINK], keys)
    recorded = fly(first, unix, [SignedPlane()], 0.0, 5.0)
    first.close()
    unix.t_ns += 3600 * NS_PER_S
    again = LinkSigning([LINK], keys)
    assert accepted(again, unix.t_ns, recorded) == 0
    assert again.gate.accept_frames(unix.t_ns, HOME, scan(SignedPlane().beat(NOW + 5 * NS_PER_S)))


def test_streams_that_fly_on_are_saved_every_ten_seconds_and_not_more_often(unix, keys, monkeypatch):
    signing, saved = LinkSigning([LINK], keys), []
    monkeypatch.setattr(type(signing._time), "write", lambda *_: saved.append(unix.t_ns))
    fly(signing, unix, [SignedPlane()], 0.0, 60.0)
    assert 6 <= len(saved) <= 9


# ---------------------------------------------------------------- the address


def heard_at(fleet: Fleet) -> str:
    (health,) = fleet.health()
    return health.address[1] if health.address else ""


@pytest.mark.parametrize("kernel", [False, True])
def test_the_address_follows_the_latest_signed_time(kernel):
    """Replayed frames came first: the vehicle's own take it back at once, for good."""
    fleet = Fleet([1], FRAME, FleetSettings(checks_signatures=True), links=[LINK], kernel=kernel)
    plane, old = SignedPlane(), SignedPlane()
    for tenth in range(5):
        t_ns = NOW + tenth * NS_PER_S // 10
        fleet.receive(Datagram(t_ns, *FOE, old.beat(t_ns - 8 * NS_PER_S)))
    assert heard_at(fleet) == FOE[1]
    fleet.receive(Datagram(NOW + NS_PER_S, *HOME, plane.beat(NOW + NS_PER_S)))
    assert heard_at(fleet) == HOME[1]
    assert noticed(fleet.notices(), NoticeCode.RECORDED_FRAMES)
    fleet.receive(Datagram(NOW + NS_PER_S, *FOE, old.beat(NOW - 7 * NS_PER_S)))
    assert heard_at(fleet) == HOME[1]


def test_the_address_stays_where_two_links_are_signed_alike():
    fleet = Fleet([1], FRAME, FleetSettings(checks_signatures=True), links=[LINK], kernel=False)
    plane = SignedPlane()
    for tenth in range(60):
        t_ns = NOW + tenth * NS_PER_S // 10
        fleet.receive(Datagram(t_ns, *HOME, plane.beat(t_ns)))
        fleet.receive(Datagram(t_ns, *FOE, plane.beat(t_ns)))
        assert heard_at(fleet) == HOME[1]


def test_an_invented_signature_moves_no_vehicle_where_signatures_are_not_checked():
    fleet, plane = Fleet([1], FRAME, links=[LINK], kernel=False), SignedPlane()
    fleet.receive(Datagram(NOW, *HOME, plane.beat(NOW)))
    fleet.receive(Datagram(NOW + 1, *FOE, plane.beat(NOW + 3600 * NS_PER_S)))
    assert heard_at(fleet) == HOME[1]


@pytest.mark.parametrize("is_keyed", [True, False])
def test_other_ground_stations_commands_go_where_the_vehicle_signs_latest(is_keyed):
    from gcs.mavlink.frames.codec import scan

    router = Router([LINK, GROUND], [1], is_keyed=lambda *_: is_keyed)
    plane, old = SignedPlane(), SignedPlane()
    command = scan(Encoder(254, 190)(dialect.MAVLink_command_long_message(1, 1, 20, 0, *[0] * 7))).frames[0]
    router.route_frame(NOW, FOE, scan(old.beat(NOW - 8 * NS_PER_S)).frames[0])
    router.route_frame(NOW + 1, HOME, scan(plane.beat(NOW)).frames[0])
    to = router.route_frame(NOW + 2, (GROUND.name, "10.0.0.9:1"), command).to
    assert to == ((HOME,) if is_keyed else (FOE,))


def test_our_missions_and_other_stations_commands_take_one_of_two_paths():
    """The path in use pauses for three seconds: too short for a timeout."""
    from gcs.mavlink.frames.codec import scan

    fleet = Fleet([1], FRAME, FleetSettings(checks_signatures=True), links=[LINK], kernel=False)
    router = Router([LINK, GROUND], [1], is_keyed=lambda *_: True)
    plane = SignedPlane()
    command = scan(Encoder(254, 190)(dialect.MAVLink_command_long_message(1, 1, 20, 0, *[0] * 7))).frames[0]
    for after_s, path in ((0, HOME), (3, FOE)):
        t_ns = NOW + after_s * NS_PER_S
        data = plane.beat(t_ns)
        fleet.receive(Datagram(t_ns, *path, data))
        router.route_frame(t_ns, path, scan(data).frames[0])
    assert heard_at(fleet) == HOME[1]
    assert router.route_frame(t_ns, (GROUND.name, "10.0.0.9:1"), command).to == (HOME,)
