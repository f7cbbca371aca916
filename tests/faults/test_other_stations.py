"""Other ground stations cannot lock each other out, do more than they may, or end a flight unnoticed."""

from __future__ import annotations

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.authority.external_uploads import ExternalUploads
from gcs.core.state import State
from gcs.endpoints import Link, parse_endpoint
from gcs.io.links import tcp
from gcs.io.links.tcp import TcpIn
from gcs.mavlink.frames.codec import Encoder, Frame, scan
from gcs.mavlink.router.router import Router
from gcs.model import NS_PER_S, Datagram, Notice, NoticeCode, Parameter

AIR = Link(parse_endpoint("udpin:0.0.0.0:1"))
READ_ONLY = Link(parse_endpoint("udpin:0.0.0.0:2"), role="read-only")
WORK = Link(parse_endpoint("udpin:0.0.0.0:3"), role="full")
PLANES = [(AIR.name, "10.0.0.1:50"), (AIR.name, "10.0.0.2:50")]
BEAT = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def frame(message, system: int = 254, component: int = 190) -> Frame:
    (found,) = scan(Encoder(system, component)(message)).frames
    return found


def command(number: int, target: int = 1, *parameters: float) -> dialect.MAVLink_command_long_message:
    values = [*parameters, *[0.0] * (7 - len(parameters))]
    return dialect.MAVLink_command_long_message(target, 1, number, 0, *values)


def routes(t_ns: int = 0) -> Router:
    router = Router([AIR, READ_ONLY, WORK], [1, 2])
    keep(router, t_ns)
    return router


def keep(router: Router, t_ns: int) -> None:
    """Have the vehicles heard."""
    for number, plane in enumerate(PLANES, 1):
        router.route_frame(t_ns, plane, frame(dialect.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3), number, 1))


def telemetry(router: Router, t_ns: int) -> tuple[tuple[str, str], ...]:
    keep(router, t_ns)
    return router.route_frame(t_ns, PLANES[0], frame(dialect.MAVLink_attitude_message(0, *[0] * 6), 1, 1)).to


# ---------------------------------------------------------------- what they may send


@pytest.mark.parametrize(
    "make",
    [
        lambda to: dialect.MAVLink_param_request_list_message(to, 1),
        lambda to: dialect.MAVLink_param_request_read_message(to, 1, b"X", -1),
        lambda to: command(512, to, 148),
        lambda to: command(401, to),
    ],
)
def test_a_read_only_station_may_ask_one_vehicle_and_not_all_of_them_at_once(make):
    router = routes()
    assert router.route_frame(1, (READ_ONLY.name, "10.0.1.1:1"), frame(make(1))).to == (PLANES[0],)
    refused = router.route_frame(1, (READ_ONLY.name, "10.0.1.1:1"), frame(make(0)))
    assert refused.to == ()
    assert "read-only" in refused.refusal
    assert set(router.route_frame(1, (WORK.name, "10.0.1.1:1"), frame(make(0))).to) == set(PLANES)


DANGERS = [
    command(185, 1, 1),
    command(208, 1, 2),
    command(246, 1, 1),
    command(400, 1, 0, 21196),
    dialect.MAVLink_command_int_message(1, 1, 0, 185, 0, 0, 1, 0, 0, 0, 0, 0, 0),
    dialect.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8),
    dialect.MAVLink_manual_control_message(1, 0, 0, 0, 0, 0),
    command(185, 0, 1),
    dialect.MAVLink_rc_channels_override_message(0, 0, *[1500] * 8),
]


@pytest.mark.parametrize("message", DANGERS, ids=lambda m: f"{m.get_type()}-{getattr(m, 'command', '')}")
def test_commands_that_end_a_flight_or_steer_by_hand_are_an_alarm(message):
    state = State.initial((1, 2))
    stations = ExternalUploads([AIR, WORK], state.agents, state.authority)
    data = frame(message).data
    (notice,) = stations.receive(Datagram(NS_PER_S, WORK.name, "10.0.1.1:1", data), scan(data))[0]
    assert isinstance(notice, Notice)
    assert notice.level == "alarm"
    assert "10.0.1.1:1" in notice.parameters["station"]
    assert stations.receive(Datagram(2 * NS_PER_S, WORK.name, "10.0.1.1:1", data), scan(data))[0] == []


def test_arming_is_a_warning_and_a_mode_is_information():
    state = State.initial((1, 2))
    stations = ExternalUploads([AIR, WORK], state.agents, state.authority)
    for message, level in (
        (command(400, 1, 1), "warning"),
        (command(400, 1, 0), "warning"),
        (command(20), "info"),
    ):
        data = frame(message, 250).data
        found = stations.receive(Datagram(NS_PER_S, WORK.name, "10.0.1.1:1", data), scan(data))[0]
        assert [n.level for n in found if isinstance(n, Notice)] in ([level], [])


# ---------------------------------------------------------------- limits for stations


def test_one_datagram_with_an_invented_sender_gets_no_telemetry():
    router = routes()
    victim = (READ_ONLY.name, "198.51.100.7:53")
    for millisecond in range(100):
        router.route_frame(millisecond * 1_000_000, victim, frame(BEAT))
    assert telemetry(router, NS_PER_S // 4) == ()
    router.route_frame(NS_PER_S, victim, frame(BEAT))
    assert telemetry(router, NS_PER_S) == (victim,)
    assert telemetry(router, 12 * NS_PER_S) == ()


def test_invented_stations_do_not_lock_out_one_that_stays():
    """A flood of 500 senders a second, none of which is heard twice, and one that sends heartbeats."""
    router, station = routes(), (READ_ONLY.name, "10.0.1.1:14550")
    for number in range(2000):
        t_ns = number * NS_PER_S // 500
        router.route_frame(t_ns, (READ_ONLY.name, f"66.6.{number // 250}.{number % 250}:6"), frame(BEAT))
        if number % 500 == 250:
            router.route_frame(t_ns, station, frame(BEAT, 255))
    assert telemetry(router, 4 * NS_PER_S) == (station,)


def test_a_host_with_many_stations_does_not_lock_out_another_host():
    router, station = routes(), (READ_ONLY.name, "10.0.1.1:14550")
    for second in range(4):
        for port in range(60):
            router.route_frame(second * NS_PER_S, (READ_ONLY.name, f"66.6.6.6:{port}"), frame(BEAT))
        router.route_frame(second * NS_PER_S, station, frame(BEAT, 255))
    heard = telemetry(router, 3 * NS_PER_S)
    assert station in heard
    assert len(heard) == 32


def test_a_station_that_fell_silent_gives_its_place_to_another():
    router = routes()
    for t_ns in (0, NS_PER_S):
        for number in range(32):
            router.route_frame(t_ns, (READ_ONLY.name, f"10.0.2.{number}:1"), frame(BEAT))
    late = (READ_ONLY.name, "10.0.1.1:1")
    for t_ns in (2 * NS_PER_S, 3 * NS_PER_S):
        router.route_frame(t_ns, late, frame(BEAT))
    assert late not in telemetry(router, 3 * NS_PER_S)
    router.route_frame(7 * NS_PER_S, late, frame(BEAT))
    assert late in telemetry(router, 7 * NS_PER_S)


class Heard:
    """A listener."""

    def __init__(self) -> None:
        self.peers: set[str] = set()
        self.there: set[str] = set()
        self.codes: list[NoticeCode] = []

    def heard(self, peer: str, data: bytes) -> None:
        self.peers.add(peer)

    def connected(self, peer: str) -> None:
        self.there.add(peer)

    def disconnected(self, peer: str) -> None:
        self.there.discard(peer)

    def notify(self, code: NoticeCode, /, **_parameters: Parameter) -> None:
        self.codes.append(code)


async def connected(port: int, data: bytes = b"") -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(data)
    return reader, writer


async def until(condition) -> None:
    for _ in range(1000):
        if condition():
            return
        await asyncio.sleep(0.005)
    raise AssertionError(condition)


def test_idle_connections_do_not_lock_out_a_ground_station():
    async def scenario() -> None:
        listener, port = Heard(), TcpIn(parse_endpoint("tcpin:127.0.0.1:0"))
        port.start(asyncio.get_running_loop(), listener)
        station = await connected(port.port, frame(BEAT).data)
        await until(lambda: listener.peers)
        (first,) = listener.peers
        idle = [await connected(port.port, bytes(number)) for number in range(60)]
        await until(lambda: len(listener.there) == 32)
        late = await connected(port.port, frame(BEAT, 253).data)
        await until(lambda: len(listener.peers - {first}) and len(listener.codes) >= 3)
        assert first in listener.there
        port.send(first, b"hello")
        assert await station[0].readexactly(5) == b"hello"
        assert listener.codes.count(NoticeCode.CONNECTIONS_CLOSED) == 1
        for _, writer in (station, late, *idle):
            writer.transport.abort()
        port.close()

    asyncio.run(asyncio.wait_for(scenario(), 20.0))


def test_a_connection_that_never_sends_a_valid_frame_is_closed(monkeypatch):
    monkeypatch.setattr(tcp, "_FIRST_FRAME_WITHIN_S", 0.1, raising=False)

    async def scenario() -> None:
        listener, port = Heard(), TcpIn(parse_endpoint("tcpin:127.0.0.1:0"))
        port.start(asyncio.get_running_loop(), listener)
        quiet, noisy = await connected(port.port), await connected(port.port, b"\xfd\xfe" * 500)
        good = await connected(port.port, frame(BEAT).data)
        await until(lambda: len(listener.there) == 3)
        for reader, _ in (quiet, noisy):
            with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
                await asyncio.wait_for(reader.readexactly(1), 3.0)
        assert len(listener.there) == 1
        for _, writer in (quiet, noisy, good):
            writer.transport.abort()
        port.close()

    asyncio.run(asyncio.wait_for(scenario(), 20.0))
