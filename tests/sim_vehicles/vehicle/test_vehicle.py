"""A vehicle is the same for the same seed, is lost at its time, and sends nothing when lost."""

from __future__ import annotations

import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.geo import LocalFrame
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

S = 1_000_000_000
START_NS = 1_767_225_600 * S
FRAME = LocalFrame(33.2, -87.6, 70.0)


def spec(**changes) -> VehicleSpec:
    return VehicleSpec(
        **(
            {
                "system_id": 1,
                "east_m": 0.0,
                "north_m": 0.0,
                "course_rad": 1.0,
                "alt_rel_m": 100.0,
                "forward_speed_m_s": 15.0,
            }
            | changes
        )
    )


def lost_after_s(vehicle: SimVehicle, limit_s: int) -> int | None:
    for second in range(1, limit_s + 1):
        vehicle.advance(START_NS + second * S)
        if not vehicle.alive:
            return second
    return None


def test_specification_survives_json():
    original = spec(dies_at_s=12.5, airborne=False)
    assert msgspec.json.decode(msgspec.json.encode(original), type=VehicleSpec) == original


@settings(max_examples=15)
@given(st.lists(st.integers(1, 700_000_000), min_size=1, max_size=20))
def test_what_it_does_depends_on_time_not_on_how_often_it_is_called(pauses_ns):
    end_ns = START_NS + 15 * S
    often, seldom = SimVehicle(spec(), FRAME, START_NS), SimVehicle(spec(), FRAME, START_NS)
    said, t_ns = b"", START_NS
    for pause_ns in pauses_ns:
        t_ns = min(t_ns + pause_ns, end_ns)
        said += b"".join(often.datagrams_to_send(t_ns))
    said += b"".join(often.datagrams_to_send(end_ns))
    assert said == b"".join(seldom.datagrams_to_send(end_ns))
    assert (often.east_m, often.north_m) == (seldom.east_m, seldom.north_m)


def test_nothing_happens_before_the_start():
    vehicle = SimVehicle(spec(), FRAME, START_NS)
    assert vehicle.datagrams_to_send(START_NS - S) == []
    assert (vehicle.east_m, vehicle.north_m) == (0.0, 0.0)


def test_distance_flown_is_speed_times_time():
    vehicle = SimVehicle(spec(), FRAME, START_NS)
    flown, t_ns = 0.0, START_NS
    for _ in range(100):
        before = vehicle.east_m, vehicle.north_m
        t_ns += 10_000_000
        vehicle.advance(t_ns)
        flown += math.dist(before, (vehicle.east_m, vehicle.north_m))
    assert flown == pytest.approx(15.0, rel=1e-3)


def test_a_prescribed_death_comes_on_time_and_is_silent():
    vehicle = SimVehicle(spec(dies_at_s=5.0), FRAME, START_NS)
    vehicle.advance(START_NS + int(4.98 * S))
    assert vehicle.alive
    vehicle.datagrams_to_send(START_NS + 5 * S)
    assert not vehicle.alive
    place = vehicle.east_m, vehicle.north_m
    pen = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    vehicle.receive_datagram(mavlink.MAVLink_ping_message(1, 2, 0, 0).pack(pen), START_NS + 6 * S)
    assert vehicle.datagrams_to_send(START_NS + 60 * S) == []
    assert (vehicle.east_m, vehicle.north_m) == place


def test_death_is_drawn_once_a_period_with_the_given_probability():
    ages = [
        lost_after_s(SimVehicle(spec(seed=k, survival_probability=0.8), FRAME, START_NS), 60)
        for k in range(120)
    ]
    assert None not in ages
    assert sum(ages) / len(ages) == pytest.approx(5.0, abs=1.2)
    slow = SimVehicle(spec(survival_probability=0.0, death_check_period_s=5.0), FRAME, START_NS)
    assert lost_after_s(slow, 10) == 5


BEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 255, 190))


def heard(vehicle: SimVehicle, from_s: int, to_s: int) -> None:
    for second in range(from_s, to_s + 1):
        vehicle.receive_datagram(BEAT, START_NS + second * S)


@pytest.mark.parametrize("how", [{"dies_at_s": 5.0}, {"survival_probability": 0.0}])
def test_deaths_wait_for_a_ground_station_that_stays(how):
    vehicle = SimVehicle(spec(waits_for_ground=True, **how), FRAME, START_NS)
    assert lost_after_s(vehicle, 50) is None
    heard(vehicle, 50, 55)  # before the flight
    vehicle.advance(START_NS + 90 * S)
    assert vehicle.alive
    heard(vehicle, 90, 100)
    assert vehicle.alive
    assert lost_after_s(vehicle, 105) in (101, 105)


def test_deaths_on_the_ground_count_from_the_start():
    vehicle = SimVehicle(spec(dies_at_s=5.0), FRAME, START_NS)
    assert lost_after_s(vehicle, 50) == 5


def test_certain_survival_has_no_deaths_and_deaths_are_the_vehicles_own():
    assert lost_after_s(SimVehicle(spec(), FRAME, START_NS), 120) is None
    by_seed = {
        (seed, k): lost_after_s(
            SimVehicle(spec(system_id=k, seed=seed, survival_probability=0.9), FRAME, START_NS), 90
        )
        for seed in (1, 2)
        for k in range(1, 9)
    }
    again = SimVehicle(spec(system_id=3, seed=2, survival_probability=0.9), FRAME, START_NS)
    assert lost_after_s(again, 90) == by_seed[2, 3]
    assert len({by_seed[1, k] for k in range(1, 9)}) > 2
    assert [by_seed[1, k] for k in range(1, 9)] != [by_seed[2, k] for k in range(1, 9)]


def test_truth_is_exact_and_carries_its_time():
    vehicle = SimVehicle(spec(gps_noise_std_m=50.0), FRAME, START_NS)
    t_ns = START_NS + 7 * S
    vehicle.advance(t_ns)
    clock, state = vehicle.truth_messages(t_ns)
    east, north = FRAME.to_local(state.lat_int * 1e-7, state.lon_int * 1e-7)
    assert clock.time_unix_usec * 1000 == t_ns
    assert math.dist((east, north), (vehicle.east_m, vehicle.north_m)) < 0.02
    assert math.atan2(state.ve, state.vn) % math.tau == pytest.approx(vehicle.course_rad)
