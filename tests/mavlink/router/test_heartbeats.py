"""Vehicles hear our heartbeats while command is late or gone, and no longer than was set."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.fleet.heartbeat import HEARTBEAT_PERIOD_NS, heartbeat
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.router.heartbeats import HeartbeatKeeper
from gcs.model import NS_PER_S

AIR = ("udpin:0.0.0.0:14550", "10.0.0.1:14555")
OTHER = ("udpin:0.0.0.0:14550", "10.0.0.2:14555")
STEP = NS_PER_S // 20
FAILOVER_S = 10


class Bridge:
    """Command sends four heartbeats a second to some addresses, until it stops; the bridge goes on."""

    def __init__(self) -> None:
        self.keeper = HeartbeatKeeper(FAILOVER_S * NS_PER_S)
        self.t_ns = self.commanded = 0
        self.encoders = {AIR: Encoder(), OTHER: Encoder()}
        self.sent: dict[tuple[str, str], list[tuple[int, bytes]]] = {AIR: [], OTHER: []}

    def command(self, seconds: float, *addresses: tuple[str, str]) -> None:
        due_ns = self.t_ns
        for _ in range(round(seconds * 20)):
            self.t_ns += STEP
            self.keeper.note_command(self.t_ns)
            if self.t_ns >= due_ns:
                due_ns += HEARTBEAT_PERIOD_NS
                for address in addresses:
                    data = self.encoders[address](heartbeat(7))
                    self.keeper.note_sent(self.t_ns, address, data)
                    self.sent[address].append((self.t_ns, data))
                    self.commanded += 1
            self._poll()

    def alone(self, seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            self.t_ns += STEP
            self._poll()

    def _poll(self) -> None:
        for address, data in self.keeper.due(self.t_ns):
            self.sent[address].append((self.t_ns, data))


def test_a_command_in_time_is_left_alone() -> None:
    bridge = Bridge()
    bridge.command(10.0, AIR)
    assert len(bridge.sent[AIR]) == bridge.commanded


@given(st.floats(0.0, 9.0))
def test_no_gap_is_longer_than_half_a_second_while_command_stands(stands_s: float) -> None:
    bridge = Bridge()
    bridge.command(2.0, AIR)
    bridge.alone(stands_s)
    bridge.command(2.0, AIR)
    times = [t_ns for t_ns, _ in bridge.sent[AIR]]
    assert max(later - earlier for earlier, later in pairwise(times)) <= NS_PER_S // 2


def test_the_vehicle_cannot_tell_them_from_commands_and_sees_no_gap_in_the_sequence() -> None:
    bridge = Bridge()
    bridge.command(1.0, AIR)
    bridge.alone(5.0)
    frames = [frame for _, data in bridge.sent[AIR] for frame in scan(data)]
    assert [frame.sequence for frame in frames] == list(range(len(frames)))
    messages = [frame.message() for frame in frames]
    assert all(m is not None and m.type == dialect.MAV_TYPE_GCS and m.custom_mode == 7 for m in messages)


def test_they_end_when_command_is_gone_for_the_time_of_a_failover_and_begin_with_a_new_one() -> None:
    bridge = Bridge()
    bridge.command(1.0, AIR)
    gone_ns = bridge.t_ns
    bridge.alone(60.0)
    last_ns = bridge.sent[AIR][-1][0]
    assert (FAILOVER_S - 1) * NS_PER_S < last_ns - gone_ns <= FAILOVER_S * NS_PER_S
    bridge.command(1.0, AIR)
    bridge.alone(1.0)
    assert bridge.t_ns - bridge.sent[AIR][-1][0] <= NS_PER_S // 2


def test_a_command_that_ends_ends_them_at_once() -> None:
    bridge = Bridge()
    bridge.command(1.0, AIR)
    bridge.keeper.end()
    before = len(bridge.sent[AIR])
    bridge.alone(5.0)
    assert len(bridge.sent[AIR]) == before


def test_an_address_that_command_no_longer_uses_gets_none() -> None:
    bridge = Bridge()
    bridge.command(1.0, AIR, OTHER)
    bridge.command(4.0, AIR)
    assert bridge.t_ns - bridge.sent[OTHER][-1][0] > NS_PER_S
    assert bridge.t_ns - bridge.sent[AIR][-1][0] <= HEARTBEAT_PERIOD_NS


@pytest.mark.parametrize(
    "data", [b"", b"\xfd", bytes(300), b"\xfd\x09\x00\x00\x00\xff\xc3\x00\x00\x00" + bytes(5)]
)
def test_other_bytes_are_no_heartbeat(data: bytes) -> None:
    keeper = HeartbeatKeeper(NS_PER_S)
    keeper.note_command(0)
    keeper.note_sent(0, AIR, data)
    assert not keeper.due(NS_PER_S)
