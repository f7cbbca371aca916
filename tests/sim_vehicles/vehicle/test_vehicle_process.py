"""The vehicle's process: real sockets, a shared clock, and a clean end."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import socket
import time
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.geo import LocalFrame
from sim_vehicles.vehicle.vehicle import VehicleSpec

FRAME = LocalFrame(33.2, -87.6, 70.0)


def spec(system_id=7, **changes) -> VehicleSpec:
    values = {
        "system_id": system_id, "east_m": 100.0, "north_m": 200.0, "course_rad": math.pi / 2,
        "alt_rel_m": 100.0, "forward_speed_m_s": 15.0,
    }  # fmt: skip
    return VehicleSpec(**(values | changes))


class Port:
    """A UDP port on loopback that reads MAVLink."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.1)
        self.number: int = self.socket.getsockname()[1]
        self.senders: dict[int, tuple[str, int]] = {}

    def datagram(self):
        try:
            data, sender = self.socket.recvfrom(2048)
        except TimeoutError:
            return []
        messages = mavlink.MAVLink(None).parse_buffer(bytearray(data)) or []
        for message in messages:
            self.senders[message.get_srcSystem()] = sender
        return messages

    def until(self, wanted, seconds=20.0):
        """Read datagrams until one holds what is wanted; return its messages."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            messages = self.datagram()
            if any(wanted(m) for m in messages):
                return messages
        pytest.fail(f"not heard within {seconds} s")

    def send(self, system_id, message) -> None:
        pen = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.socket.sendto(message.pack(pen), self.senders[system_id])


@pytest.fixture
def port():
    made = Port()
    yield made
    made.socket.close()


@pytest.fixture
def world():
    made = Port()
    yield made
    made.socket.close()


def kind(name, system_id=7):
    return lambda m: m.get_type() == name and m.get_srcSystem() == system_id


def test_it_answers_the_ground_station_and_no_other_sender(start_process, port, world):
    start_process(port.number, spec())
    port.until(kind("HEARTBEAT"))
    world.senders = port.senders  # the world is the other sender here
    world.send(7, mavlink.MAVLink_command_long_message(7, 1, 176, 0, 1, 11, 0, 0, 0, 0, 0))
    port.send(7, mavlink.MAVLink_ping_message(5, 6, 0, 0))
    port.until(kind("PING"))
    beat = next(m for m in port.until(kind("HEARTBEAT")) if m.get_type() == "HEARTBEAT")
    assert beat.custom_mode == 12


def test_a_pack_of_vehicles_has_a_socket_each(start_process, port):
    start_process(port.number, *(spec(k) for k in (1, 2, 3)))
    for system_id in (1, 2, 3):
        if system_id not in port.senders:
            port.until(kind("HEARTBEAT", system_id))
    assert len(set(port.senders.values())) == 3


def test_truth_comes_ten_times_a_second_of_run_time_with_its_time(start_process, port, world):
    start_process(port.number, spec(), truth_port=world.number, speed=8.0)
    times, places = [], []
    while len(times) < 40:
        clock, state = world.until(kind("SIM_STATE"))
        times.append(clock.time_unix_usec)
        places.append(FRAME.to_local(state.lat_int * 1e-7, state.lon_int * 1e-7))
    assert {b - a for a, b in pairwise(times)} == {100_000}
    assert math.dist(places[0], (100.0, 200.0)) < 0.02
    for before, after in pairwise(places):
        assert math.dist(before, after) == pytest.approx(1.5, abs=0.05)


def test_the_world_learns_when_a_ground_station_stays(start_process, port, world):
    start_process(port.number, spec(), truth_port=world.number, speed=20.0)
    port.until(kind("HEARTBEAT"))
    first = world.until(kind("SIM_STATE"))
    assert not any(m.get_type() == "HEARTBEAT" for m in first)
    deadline, is_reported = time.monotonic() + 20, False
    while not is_reported and time.monotonic() < deadline:
        port.send(7, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        is_reported = any(m.get_type() == "HEARTBEAT" for m in world.datagram())
    assert is_reported


def test_a_lost_vehicle_sends_nothing_more_and_its_process_stays(start_process, port, world):
    specs = spec(1, dies_at_s=4.0), spec(2)
    process = start_process(port.number, *specs, truth_port=world.number, speed=8.0)
    last_us = {1: 0, 2: 0}
    while last_us[2] < last_us[1] + 4_000_000:
        messages = world.until(lambda m: m.get_type() == "SIM_STATE")
        last_us[messages[0].get_srcSystem()] = messages[0].time_unix_usec
    assert process.poll() is None


def test_a_late_vehicle_flies_on_though_its_terminal_is_not_read(start_process, port):
    unread, stderr = os.pipe()
    os.set_blocking(stderr, False)
    with contextlib.suppress(BlockingIOError):
        while os.write(stderr, bytes(4096)):
            pass
    os.set_blocking(stderr, True)
    process = start_process(port.number, spec(), speed=20.0, stderr=stderr)
    port.until(kind("HEARTBEAT"))
    process.send_signal(signal.SIGSTOP)
    time.sleep(0.3)
    process.send_signal(signal.SIGCONT)
    for number in (5, 6):
        port.send(7, mavlink.MAVLink_ping_message(number, number, 0, 0))
        port.until(lambda m, number=number: m.get_type() == "PING" and m.seq == number, 10.0)
    os.close(stderr)
    os.close(unread)


def test_lost_datagrams_do_not_stop_it(start_process, port):
    start_process(port.number, spec(), loss=0.5, speed=20.0)
    port.until(kind("HEARTBEAT"))
    deadline = time.monotonic() + 20
    answered = False
    while not answered and time.monotonic() < deadline:
        port.send(7, mavlink.MAVLink_ping_message(5, 6, 0, 0))
        answered = any(kind("PING")(m) for m in port.datagram())
    assert answered


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT, "stdin"])
def test_it_ends_cleanly(start_process, port, how):
    process = start_process(port.number, spec())
    port.until(kind("HEARTBEAT"))
    if how == "stdin":
        process.stdin.close()
    else:
        process.send_signal(how)
    assert process.wait(10) == 0
