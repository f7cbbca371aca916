"""The fast check must let in what the simple one lets in, or a forger would fly a vehicle."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link, parse_endpoint
from gcs.mavlink.frames import fast_verify
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.frames.signing import Keys, SigningGate, signed, timestamp_of
from gcs.model import vehicle_id

S = 1_000_000_000
NOW = 1_767_225_600 * S
KEY, OTHER, WRONG = bytes(range(32)), bytes(range(1, 33)), bytes(32)
LINKS = [Link(parse_endpoint(f"udpin:0.0.0.0:1455{network}"), network) for network in (0, 1)]
KEYS = Keys({vehicle_id(0, 2): OTHER}, {LINKS[1].name: OTHER}, KEY)
BEAT = dialect.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)
RIGHT = {(0, 1): KEY, (0, 2): OTHER, (1, 1): OTHER, (1, 2): OTHER}


class Air:
    """Vehicles that sign, and a forger who repeats, alters and strips what they send."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.pens = {}
        self.stamp = timestamp_of(NOW)
        self.said = []

    def is_rare(self, one_in=40):
        return self.rng.integers(one_in) == 0

    def frame(self, network):
        system, component = int(self.rng.integers(1, 3)), 154 if self.is_rare(10) else 1
        pen = self.pens.setdefault((network, system, component), Encoder(system, component))
        plain = pen(dialect.MAVLink_heartbeat_message(1, 3, 0, int(self.rng.integers(9)), 4, 3))
        self.stamp += int(self.rng.integers(1, 9))
        stamp = self.stamp - int(self.rng.integers(9_000_000) if self.is_rare() else 0)
        key = WRONG if self.is_rare() else RIGHT[network, system]
        frame = plain if self.is_rare() else signed(plain, key, int(self.is_rare(20)), stamp)
        self.said.append(frame)
        if self.is_rare():
            return self.said[self.rng.integers(len(self.said))]
        if self.is_rare():
            return frame[:-1] + bytes([frame[-1] ^ 1])
        if self.is_rare():
            return frame[: self.rng.integers(len(frame))]
        return frame + bytes([0xFE] * int(self.is_rare(60)))

    def datagram(self, network):
        frames = [self.frame(network) for _ in range(self.rng.integers(0, 6))]
        if self.is_rare(15):
            self.rng.shuffle(frames)
        return b"".join(frames)


def known(gate):
    heard = [(address, list(keys)) for address, keys in gate._keys_at.items()]
    return gate.timestamp, gate.times.latest(), gate.counters, heard, gate.take_stale_senders(0)


@pytest.mark.parametrize("seed", range(4))
def test_both_ways_of_checking_let_in_the_same_and_remember_the_same(seed):
    fast, simple = SigningGate(KEYS, LINKS), SigningGate(KEYS, LINKS)
    simple._verifier = None
    air, whole = Air(seed), 0
    slow_checks = []
    fast._is_accepted = lambda *args: slow_checks.append(1) or SigningGate._is_accepted(fast, *args)
    for step in range(1500):
        network = int(air.rng.integers(2))
        data = air.datagram(network)
        t_ns, address = NOW + step * S // 100, (LINKS[network].name, f"10.0.0.{air.rng.integers(3)}:1")
        let_in = fast.accept_frames(t_ns, address, scan(data))
        assert let_in == simple.accept_frames(t_ns, address, scan(data))
        whole += let_in == data
        assert known(fast) == known(simple)
    reasons = {reason for link in fast.counters.values() for reason in link.rejected}
    assert len(reasons) >= 3, "not signed, another key, sent again"
    assert whole > 700
    assert len(slow_checks) < sum(link.verified for link in fast.counters.values()), "few need the slow check"


def test_signatures_of_frames_of_all_lengths_are_checked():
    gate, vehicle, now = SigningGate(KEYS, LINKS), Encoder(1, 1), timestamp_of(NOW)
    address = (LINKS[0].name, "10.0.0.1:1")
    gate.accept_frames(NOW, address, scan(signed(vehicle(BEAT), KEY, 0, now)))
    gate._is_accepted = None  # the gate decides on none
    for length in range(254):
        data = [1 + k % 255 for k in range(length)] + [0] * (253 - length)
        frame = signed(vehicle(dialect.MAVLink_encapsulated_data_message(1, data)), KEY, 0, now + 1 + length)
        assert gate.accept_frames(NOW, address, scan(frame)) == frame
    assert gate.counters[LINKS[0].name].verified == 255


def test_more_senders_than_the_table_has_room_for_are_told_apart():
    gate, pens = SigningGate(KEYS, LINKS), {system: Encoder(system, 1) for system in range(1, 251)}
    address, now = (LINKS[0].name, "10.0.0.1:1"), timestamp_of(NOW)
    for number in range(3):
        frames = [
            signed(pen(BEAT), OTHER if system == 2 else KEY, system % 3, now + number)
            for system, pen in pens.items()
        ]
        for frame in frames:
            assert gate.accept_frames(NOW, address, scan(frame)) == frame
            assert gate.accept_frames(NOW, address, scan(frame)) == b"", "sent again"
    assert set(gate.times.latest().values()) == {now + 2}
    assert len(gate._verifier._known) == 250


def test_without_functions_of_openssl_the_gate_decides_on_all(monkeypatch):
    monkeypatch.setattr(fast_verify.ctypes, "CDLL", lambda _: object())
    gate, vehicle, now = SigningGate(KEYS, LINKS), Encoder(1, 1), timestamp_of(NOW)
    for number in range(3):
        frame = signed(vehicle(BEAT), KEY, 0, now + number)
        assert gate.accept_frames(NOW, (LINKS[0].name, "10.0.0.1:1"), scan(frame)) == frame
