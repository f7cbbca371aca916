"""The compiled path must see what the simple one sees, or a vehicle would be somewhere else for it."""

from dataclasses import asdict

import numpy as np
import pytest
from helpers.frame_bytes import BYTES, GOOD, frame
from helpers.noticed import noticed
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.snapshot import decode_state, encode_state
from gcs.core.state import State
from gcs.endpoints import Link, parse_endpoint
from gcs.geo import LocalFrame
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.fleet_state import FleetState
from gcs.mavlink.fleet.telemetry_table import new_table
from gcs.mavlink.frames.codec import scan
from gcs.mavlink.frames.fast_scan import Scanner
from gcs.model import NS_PER_S, Datagram, NoticeCode, vehicle_id

FRAME = LocalFrame(33.2, -87.6, 70.0)
LINKS = [Link(parse_endpoint(f"udpin:0.0.0.0:1455{network}"), network) for network in (0, 1)]
QUIET = ("GLOBAL_POSITION_INT", "GPS_RAW_INT", "SYS_STATUS")


def agree(data, scanner):
    simple, fast = scan(data), scanner(data)
    assert fast.data is data
    assert (fast.rows.dtype, fast.rows.tolist()) == (simple.rows.dtype, simple.rows.tolist())
    counters = (fast.bad_bytes, fast.crc_errors, fast.unknown)
    assert counters == (simple.bad_bytes, simple.crc_errors, simple.unknown)
    assert sum(map(len, (frame.data for frame in fast))) + fast.bad_bytes == len(data)
    return fast


@settings(max_examples=300)
@given(st.lists(BYTES, min_size=1, max_size=3))
def test_the_kernel_finds_the_frames_of_the_scan_in_any_bytes(datagrams):
    scanner = Scanner()
    found = [agree(data, scanner) for data in datagrams]
    for data, frames in zip(datagrams, found, strict=True):  # later scans left them as they were
        assert list(frames) == list(scan(data))


def test_hostile_bytes_and_large_datagrams_are_framed_the_same():
    for data in (b"", b"\xfd", b"\xfe\x20\x00\x01\x01\x00" * 10_000, frame(0, bytes(9)) * 3000):
        agree(data, Scanner())


@settings(max_examples=300)
@given(GOOD)
def test_a_message_equals_that_of_pymavlink(data):
    for found in scan(data).frames:
        ours, theirs = found.message(), found._decode_any()
        assert (ours is None) == (theirs is None)
        if ours is not None:
            assert repr(ours.to_dict()) == repr(theirs.to_dict())  # NaN is NaN
            assert (ours.get_seq(), ours.get_crc()) == (theirs.get_seq(), theirs.get_crc())
            assert ours.get_header().pack() == theirs.get_header().pack()


class Swarm:
    """Vehicles of two networks as they really talk, and as they do not."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.sequences = {}
        self.boot_ms = {}

    def pick(self, *things):
        return things[self.rng.integers(len(things))]

    def is_rare(self, one_in=30):
        return self.rng.integers(one_in) == 0

    def message(self, vehicle):
        boot_ms = (self.boot_ms.get(vehicle, 0) + int(self.rng.integers(1, 300))) % 2**32
        if self.is_rare(300):
            boot_ms = self.pick(0, 50, 2**32 - 200)
        self.boot_ms[vehicle] = boot_ms
        late_ms = self.pick(20, 200, 6000) if self.is_rare() else 0
        lat, lon = (int(v) for v in self.rng.normal((332_000_000, -876_000_000), 90_000))
        if self.is_rare():
            lat, lon = self.pick(
                (0, 0), (10_000, -10_000), (9_999, 5), (341_000_000, -876_000_000), (2**31 - 1, 7)
            )
        alt = self.pick(-1_000_000, 50_000_000, -999_999) if self.is_rare() else 400_000
        v = [int(x) for x in self.rng.integers(-3000, 3000, 2)] if self.rng.integers(3) else [0, -1]
        return self.pick(
            *[dialect.MAVLink_global_position_int_message(
                max(0, boot_ms - late_ms) % 2**32, lat, lon, alt, 0, *v, 0, self.pick(9000, 65535)
            )] * 6,
            dialect.MAVLink_heartbeat_message(1, self.pick(3, 3, 3, 8), 128, self.pick(10, 12), 4, 3),
            dialect.MAVLink_gps_raw_int_message(0, self.pick(3, 3, 3, 3, 6, 1), 1, 2, 3, 4, 5, 6, 7, 8),
            dialect.MAVLink_sys_status_message(1, 1, 1, 0, 0, 0, self.pick(-1, 0, 77, 101), 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_mission_current_message(int(self.rng.integers(4))),
            dialect.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_command_ack_message(511, self.pick(0, 3, 4), target_system=255),
        )  # fmt: skip

    def datagram(self, t_ns):
        network = self.pick(0, 1)
        data = b""
        for _ in range(self.rng.integers(1, 8)):
            system = int(self.rng.integers(1, 5))  # 4 is an unknown system
            component = self.pick(1, 1, 1, 1, 1, 154) if self.is_rare(10) else 1
            pen = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
            sequence = self.sequences.get((network, system), 0) + self.pick(1, 1, 1, 1, 1, 3, 255, 200)
            pen.seq = self.sequences[network, system] = sequence % 256
            if self.is_rare():
                pen.signing.secret_key, pen.signing.sign_outgoing = bytes(32), True
            packed = self.message((network, system)).pack(pen, force_mavlink1=self.is_rare(5))
            if self.is_rare():
                packed = self.pick(packed[:-3], packed + b"\xfd\x01", packed[:9] + b"\x55" + packed[10:])
            data += packed
        peer = "10.0.0.66:6" if self.is_rare() else f"10.0.0.{network}:1"
        return Datagram(t_ns, LINKS[network].name, peer, data)


class News:
    """What is not quiet in what a fleet gives out: no numbers, no heartbeat like the one before."""

    def __init__(self):
        self.beats = {}

    def of(self, accepted):
        return [(v, m.to_dict()) for v, m in accepted if m.get_type() not in QUIET and self.is_news(v, m)]

    def is_news(self, vehicle, message):
        if message.get_type() != "HEARTBEAT":
            return True
        before, self.beats[vehicle] = self.beats.get(vehicle), message.to_dict()
        return before != self.beats[vehicle]


def fleet_state(fleet):
    return (
        fleet.states(),
        fleet.health(),
        asdict(fleet.counters),
        {name: asdict(counters) for name, counters in fleet.links.items()},
        fleet.notices(),
        fleet.unknown_systems(),
    )


MORE_SEEDS = [pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 20)]


@pytest.mark.parametrize("seed", [0, 1, 2, *MORE_SEEDS])
def test_a_fleet_knows_the_same_with_and_without_the_kernel(seed):
    expected = [vehicle_id(network, system) for network in (0, 1) for system in (1, 2, 3)]
    fast, simple = (Fleet(expected, FRAME, links=LINKS, kernel=kernel) for kernel in (True, False))
    fast_news, simple_news = News(), News()
    swarm = Swarm(seed)
    t_ns = 1_700_000_000 * NS_PER_S
    folded, notices = 0, []
    for step in range(1200):
        t_ns += int(swarm.pick(1, 20, 20, 90) * 1e6) + (8 * NS_PER_S if step % 300 == 299 else 0)
        datagram = swarm.datagram(t_ns)
        heard, all_of_it = fast.receive(datagram), simple.receive(datagram)
        folded += len(all_of_it) - len(heard)
        assert fast_news.of(heard) == simple_news.of(all_of_it)
        assert (fast._state.table == simple._state.table).all()
        if step % 5 == 0:
            assert fast.poll(t_ns) == simple.poll(t_ns)
            known = fleet_state(fast)
            assert known == fleet_state(simple)
            notices += known[4]
    assert noticed(notices, NoticeCode.SIGNS)
    refused = set().union(*(one.refused for one in fast.health()))
    assert folded > 400
    assert {"late", "no fix", "null", "far", "range", "jump"} <= refused
    assert sum(one.boots for one in fast.health()) > 0
    assert fast.counters.conflicts > 0


def test_a_fleet_continues_from_snapshots_as_if_it_never_stopped():
    links = [*LINKS, Link(parse_endpoint("udpout:10.0.0.9:14550"))]
    expected = [vehicle_id(network, system) for network in (0, 1) for system in (1, 2, 3)]
    state, swarm, t_ns = State.initial(expected), Swarm(0), 1_700_000_000 * NS_PER_S
    fleet, resumed = (Fleet(expected, FRAME, links=links) for _ in range(2))
    for step in range(1200):
        if step % 11 == 0:
            if step:
                state = decode_state("test", encode_state(state))
            known = {vehicle: agent.link for vehicle, agent in state.agents.items()}
            resumed = Fleet(expected, FRAME, links=links, state=state.fleet, vehicle_links=known)
        t_ns += int(swarm.pick(1, 20, 20, 90) * 1e6) + (8 * NS_PER_S if step % 300 == 299 else 0)
        datagram = swarm.datagram(t_ns)
        heard, again = ([(v, m.to_dict()) for v, m in f.receive(datagram)] for f in (fleet, resumed))
        assert heard == again
        if step % 5 == 0:
            assert fleet.poll(t_ns) == resumed.poll(t_ns)
            message = dialect.MAVLink_ping_message(0, step, 1, 1)
            assert fleet.encoder(expected[0])(message) == resumed.encoder(expected[0])(message)
        assert fleet_state(fleet) == fleet_state(resumed)
    assert sum(one.boots for one in fleet.health()) > 0
    assert fleet.counters.conflicts > 0


def test_a_snapshot_of_other_vehicles_never_reaches_the_kernel():
    for table in (new_table(2), new_table(3)[:, :-1]):
        with pytest.raises(ValueError, match="telemetry table"):
            Fleet([1, 2, 3], FRAME, state=FleetState(table))


def test_an_unchanged_heartbeat_reaches_its_listeners():
    fleet = Fleet([1], FRAME)
    pen = dialect.MAVLink(None, srcSystem=1, srcComponent=1)

    def beat(mode=10):
        pen.seq = (pen.seq + 1) % 256
        message = dialect.MAVLink_heartbeat_message(1, 3, 217, mode, 4, 3)
        return [m.custom_mode for _, m in fleet.receive(Datagram(NS_PER_S, "udp", "a", message.pack(pen)))]

    assert beat() == [10]
    assert beat() == []
    fleet.forward_next_heartbeat(1)
    assert beat() == [10]
    assert beat() == []
    assert beat(mode=12) == [12]
    assert fleet.health()[0].frames == 5
