"""A user would lose a vehicle to any sender of datagrams: frames are checked against their keys.

The peer is pymavlink's own signing.
"""

from __future__ import annotations

import hashlib

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link, parse_endpoint
from gcs.mavlink.frames import signing
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.frames.signing import (
    TICKS_PER_S,
    Keys,
    SigningGate,
    fingerprint,
    is_signed_by,
    passphrase_key,
    signed,
    signing_time,
    timestamp_of,
)
from gcs.model import vehicle_id

S = 1_000_000_000
NOW = 1_767_225_600 * S
KEY, OTHER = bytes(range(32)), bytes(range(1, 33))
VEHICLES = Link(parse_endpoint("udpin:0.0.0.0:14550"))
STATIONS = Link(parse_endpoint("udpin:0.0.0.0:14560"), role="full")
HERE = (VEHICLES.name, "10.0.0.1:5000")


def beat(kind=1):
    return dialect.MAVLink_heartbeat_message(kind, 3, 0, 0, 4, 3)


class Peer:
    """A vehicle that signs and checks with pymavlink's code."""

    def __init__(self, system_id=1, key=KEY, link_id=0, t_ns=NOW):
        self.mav = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
        self.mav.signing.secret_key, self.mav.signing.sign_outgoing = key, True
        self.mav.signing.link_id, self.mav.signing.timestamp = link_id, timestamp_of(t_ns)

    def send(self, message=None):
        return bytes((message or beat()).pack(self.mav))

    def takes(self, frame):
        try:
            self.mav.decode(bytearray(frame))
        except dialect.MAVError:
            return False
        return True


def gate(keys=None, **state):
    return SigningGate(keys or Keys(default=KEY), [VEHICLES, STATIONS], **state)


def rejected(gate, link=VEHICLES):
    return dict(gate.counters[link.name].rejected)


def test_the_signing_time_counts_from_2015():
    assert timestamp_of(1_420_070_400 * S) == 0
    assert timestamp_of(1_420_070_401 * S) == TICKS_PER_S
    assert timestamp_of(0) == 0


@given(st.sampled_from(sorted(dialect.mavlink_map)), st.binary(max_size=255), st.integers(0, 255))
@settings(max_examples=150)
def test_any_frame_can_be_signed_and_pymavlink_agrees(message_id, payload, link_id):
    extra = dialect.mavlink_map[message_id].crc_extra
    body = bytes((len(payload), 0, 0, 7, 3, 1)) + message_id.to_bytes(3, "little") + payload
    crc = dialect.x25crc(body + bytes((extra,))).crc
    frame = signed(b"\xfd" + body + crc.to_bytes(2, "little"), KEY, link_id, timestamp_of(NOW))
    (found,) = scan(frame).frames  # its checksum holds
    assert found.signed
    assert signing_time(found) == timestamp_of(NOW)
    assert is_signed_by(frame, KEY)
    assert not is_signed_by(frame, OTHER)
    assert Peer().mav.check_signature(bytearray(frame), 3, 1)
    again = signed(frame, OTHER, 0, 5)  # a signature is replaced, not added
    assert len(again) == len(frame)
    assert is_signed_by(again, OTHER)


def test_passphrases_make_the_keys_that_mission_planner_makes():
    assert passphrase_key("swarm") == hashlib.sha256(b"swarm").digest()
    assert KEY.hex() not in fingerprint(KEY)
    assert fingerprint(KEY) != fingerprint(OTHER)
    assert KEY.hex() not in repr(Keys({1: KEY}, {"x": KEY}, KEY))
    assert repr(KEY) not in repr(Keys(default=KEY))


def test_what_pymavlink_signs_is_let_in_as_it_came():
    subject, peer = gate(), Peer()
    data = peer.send() + peer.send() + b"noise"
    assert subject.accept_frames(NOW, HERE, scan(data)) == data
    assert subject.counters[VEHICLES.name].verified == 2


def test_unsigned_frames_are_refused_and_signed_ones_next_to_them_accepted():
    subject, peer = gate(), Peer()
    good, unsigned = peer.send(), Encoder(1, 1)(beat())
    old = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    mavlink1 = bytes(beat().pack(old, force_mavlink1=True))
    forged = Peer(key=OTHER).send()
    assert subject.accept_frames(NOW, HERE, scan(unsigned + good + mavlink1 + forged)) == good
    assert rejected(subject) == {
        "not signed": 1,
        "MAVLink 1, which cannot be signed": 1,
        "signed with another key": 1,
    }


def test_one_changed_byte_is_a_wrong_signature():
    frame = bytearray(Peer().send())
    frame[-1] ^= 1
    assert gate().accept_frames(NOW, HERE, scan(bytes(frame))) == b""


def test_a_frame_sent_again_is_kept_out_from_any_address():
    subject = gate()
    frame = Peer().send()
    assert subject.accept_frames(NOW, HERE, scan(frame))
    assert subject.accept_frames(NOW, (VEHICLES.name, "10.9.9.9:1"), scan(frame)) == b""
    assert subject.accept_frames(NOW, HERE, scan(frame)) == b""


def test_time_is_checked_for_each_sender_and_link_id_by_itself():
    subject = gate()
    for peer in (Peer(1), Peer(2), Peer(1, link_id=1)):
        assert subject.accept_frames(NOW, HERE, scan(peer.send()))


def test_a_new_sender_may_be_a_minute_behind_and_no_more():
    assert gate().accept_frames(NOW, HERE, scan(Peer(t_ns=NOW - 59 * S).send()))
    assert gate().accept_frames(NOW, HERE, scan(Peer(t_ns=NOW - 61 * S).send())) == b""


def test_replayed_frames_are_not_answered_one_for_one():
    """Half a minute of twenty replayed frames a second, then from a thousand addresses."""
    subject, peer = gate(), Peer()
    recorded = [peer.send() for _ in range(20)]
    for frame in recorded:
        subject.accept_frames(NOW, HERE, scan(frame))
    answers = []
    for step in range(600):
        t_ns = NOW + step * S // 20
        assert subject.accept_frames(t_ns, HERE, scan(recorded[step % 20])) == b""
        answers += subject.take_stale_senders(t_ns)
    assert len(answers) == 30
    for number in range(1000):
        address = (VEHICLES.name, f"10.6.{number // 250}.{number % 250}:1")
        subject.accept_frames(NOW + 40 * S, address, scan(recorded[0]))
    assert len(subject.take_stale_senders(NOW + 40 * S)) <= 16
    assert subject.take_stale_senders(NOW + 40 * S) == []


def test_a_vehicle_without_the_time_gets_it_and_is_heard_then():
    subject, peer = gate(), Peer(t_ns=NOW - 86_400 * S)
    assert subject.accept_frames(NOW, HERE, scan(peer.send())) == b""
    assert subject.take_stale_senders(NOW) == [HERE]
    assert subject.take_stale_senders(NOW) == []
    assert peer.takes(subject.sign_frames(NOW, HERE, scan(Encoder()(beat(6)))))
    assert subject.accept_frames(NOW, HERE, scan(peer.send()))


def test_a_forger_cannot_move_a_vehicles_time():
    subject = gate()
    assert subject.accept_frames(NOW, HERE, scan(Peer(key=OTHER, t_ns=NOW + 3600 * S).send())) == b""
    assert subject.accept_frames(NOW, HERE, scan(Peer().send()))


def test_after_a_restart_frames_from_before_it_are_still_old():
    first, peer = gate(), Peer()
    frame = peer.send()
    assert first.accept_frames(NOW, HERE, scan(frame))
    second = gate(timestamp=first.timestamp, streams=first.times.latest())
    assert second.accept_frames(NOW, HERE, scan(frame)) == b""
    assert second.accept_frames(NOW, HERE, scan(peer.send()))


def test_our_time_never_goes_back_when_the_clock_does():
    subject, peer = gate(timestamp=timestamp_of(NOW)), Peer(t_ns=NOW - 86_400 * S)
    frames = [subject.sign_frames(NOW - 3600 * S, HERE, scan(Encoder()(beat()))) for _ in range(3)]
    times = [signing_time(scan(frame).frames[0]) for frame in frames]
    assert times == [timestamp_of(NOW) + n for n in (1, 2, 3)]
    assert all(peer.takes(frame) for frame in frames)


def test_our_time_follows_the_latest_that_was_heard():
    subject, ahead = gate(), Peer(t_ns=NOW + 600 * S)
    subject.accept_frames(NOW, HERE, scan(ahead.send()))
    assert ahead.takes(subject.sign_frames(NOW, HERE, scan(Encoder()(beat()))))


def test_a_radios_own_status_needs_no_signature():
    status = Encoder(51, 68)(dialect.MAVLink_radio_status_message(100, 100, 100, 10, 10, 0, 0))
    assert gate().accept_frames(NOW, HERE, scan(status)) == status


def test_a_key_on_its_way_is_let_in_by_no_link_at_all():
    setup = Encoder(255, 190)(dialect.MAVLink_setup_signing_message(1, 1, list(KEY), 5))
    unkeyed = SigningGate(Keys(), [VEHICLES, STATIONS])
    for address in (HERE, (STATIONS.name, "10.0.0.2:1")):
        heard = scan(setup + Encoder(2, 1)(beat()))
        assert unkeyed.accept_frames(NOW, address, heard) == Encoder(2, 1)(beat())
    damaged = setup[:-2] + b"\0\0"
    assert KEY not in unkeyed.accept_frames(NOW, HERE, scan(damaged))


def test_without_keys_everything_passes_untouched():
    subject, data = SigningGate(Keys(), [VEHICLES]), b"noise" + Encoder(1, 1)(beat()) + Peer().send()
    assert subject.accept_frames(NOW, HERE, scan(data)) == data
    assert subject.sign_frames(NOW, HERE, scan(data)) == data.removeprefix(b"noise")


def test_each_vehicle_may_have_a_key_of_its_own_and_the_rest_none():
    subject = gate(Keys({1: KEY, vehicle_id(2, 3): OTHER}))
    assert subject.accept_frames(NOW, HERE, scan(Encoder(1, 1)(beat()))) == b""
    keyless = scan(Encoder(3, 1)(beat()))
    assert subject.accept_frames(NOW, HERE, keyless), "system 3 of another network has no key"
    to_one = Encoder()(dialect.MAVLink_mission_count_message(1, 1, 5))
    to_three = Encoder()(dialect.MAVLink_mission_count_message(3, 1, 5))
    out = subject.sign_frames(NOW, HERE, scan(to_one + to_three))
    assert [frame.signed for frame in scan(out).frames] == [True, False]


def test_what_is_for_all_at_an_address_goes_out_with_each_key_heard_there():
    subject = gate(Keys({1: KEY, 2: OTHER}))
    peers = Peer(1), Peer(2, key=OTHER)
    for peer in peers:
        subject.accept_frames(NOW, HERE, scan(peer.send()))
    frames = [f.data for f in scan(subject.sign_frames(NOW, HERE, scan(Encoder()(beat(6))))).frames]
    assert len(frames) == 2
    assert all(any(peer.takes(frame) for frame in frames) for peer in peers)


def test_a_ground_stations_endpoint_has_a_key_only_by_its_name():
    subject = gate(Keys({}, {STATIONS.name: OTHER}, KEY))
    other, station = (STATIONS.name, "10.0.0.7:1"), Peer(254, key=OTHER)
    assert subject.accept_frames(NOW, other, scan(Encoder(254, 190)(beat(6)))) == b""
    assert subject.accept_frames(NOW, other, scan(station.send(beat(6))))
    assert station.takes(subject.sign_frames(NOW, other, scan(Peer(1, key=KEY).send()))), (
        "signed anew for the other ground station"
    )
    assert gate().accept_frames(NOW, other, scan(Encoder(254, 190)(beat(6))))


def test_a_frame_of_mavlink_1_never_goes_out_to_a_signed_vehicle():
    mavlink1 = bytes(beat().pack(dialect.MAVLink(None), force_mavlink1=True))
    subject = gate()
    assert subject.sign_frames(NOW, HERE, scan(mavlink1)) == b""


@given(st.binary(max_size=300))
@settings(max_examples=100)
def test_no_bytes_raise(data):
    subject = gate()
    for bytes_ in (data, Peer().send()[:20] + data, b"\xfd\x00\x01" + data):
        subject.accept_frames(NOW, HERE, scan(bytes_))
        subject.sign_frames(NOW, HERE, scan(bytes_))


def test_senders_who_hold_the_key_cannot_fill_the_memory(monkeypatch):
    monkeypatch.setattr(signing, "_MAX_STREAMS", 400)
    monkeypatch.setattr(signing, "_MAX_ADDRESSES", 100)
    subject = gate()
    for number in range(600):
        peer = Peer(1 + number % 250, link_id=number // 250 % 256)
        subject.accept_frames(NOW, (VEHICLES.name, f"10.0.{number}:1"), scan(peer.send()))
    assert len(subject.times.latest()) == 400
    assert len(subject._keys_at) == 100
