"""A user would lock a vehicle out: a key counts as given when the vehicle signs with it and obeys it."""

from __future__ import annotations

import itertools

import pytest

from gcs.geo import LocalFrame
from gcs.mavlink.frames.codec import scan
from gcs.mavlink.services.signing_setup import SigningSetup
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

S = 1_000_000_000
NOW = 1_767_225_600 * S
KEY, OLD, OTHER = bytes(range(32)), bytes(range(1, 33)), bytes(range(2, 34))


def vehicle(key: bytes | None = None, *, airborne: bool = False) -> SimVehicle:
    spec = VehicleSpec(1, 0.0, 0.0, 0.0, 0.0, 15.0, airborne=airborne)
    return SimVehicle(spec, LocalFrame(33.2, -87.6, 70.0), NOW, key)


def give(plane: SimVehicle, old: bytes | None = None, *, drops=lambda _n: False, seconds=10) -> SigningSetup:
    """Join both ends in memory; `drops` selects our lost frames."""
    counter, sent = itertools.count(NOW // 10_000 - 1_420_070_400 * 100_000), itertools.count()
    installation = SigningSetup(1, KEY, old, lambda _t: next(counter), NOW + seconds * S)
    for t_ns in range(NOW, NOW + (seconds + 1) * S, S // 20):
        for data in plane.datagrams_to_send(t_ns):
            for frame in scan(data).frames:
                installation.receive(frame)
        for frame_data in installation.poll(t_ns):
            if not drops(next(sent)):
                plane.receive_datagram(frame_data, t_ns)
    return installation


def test_a_vehicle_takes_a_key_and_shows_that_it_uses_it():
    plane = vehicle()
    installation = give(plane)
    assert (installation.outcome, installation.sent) == ("done", 1)
    assert plane._link.signing.state.secret_key == KEY


def test_lost_frames_are_sent_again():
    assert give(vehicle(), drops=lambda n: n in (0, 1, 3)).outcome == "done"


def test_a_new_key_goes_out_under_the_old_one():
    plane = vehicle(OLD)
    assert give(plane, OLD).outcome == "done"
    assert plane._link.signing.state.secret_key == KEY


@pytest.mark.parametrize("known", [None, OTHER])
def test_a_vehicle_with_an_unknown_key_keeps_it_and_is_reported(known):
    plane = vehicle(OLD)
    installation = give(plane, known, seconds=4)
    assert installation.outcome == "failed"
    assert "gcs keys rotate" in installation.detail
    assert plane._link.signing.state.secret_key == OLD


def test_a_vehicle_with_the_key_is_checked_and_does_not_get_it_again():
    installation = give(vehicle(KEY))
    assert (installation.outcome, installation.sent) == ("done", 0)


def test_no_key_goes_to_a_vehicle_that_is_armed():
    installation = give(vehicle(airborne=True))
    assert (installation.outcome, installation.sent) == ("failed", 0)
    assert "armed" in installation.detail


def test_a_missing_vehicle_is_reported():
    installation = SigningSetup(9, KEY, None, lambda t: t, NOW)
    assert installation.poll(NOW) == []
    assert installation.outcome == "failed"
    assert installation.detail.startswith("was not heard: is it on")
