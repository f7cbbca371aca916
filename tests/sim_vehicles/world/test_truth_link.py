"""A simulated world around vehicles that fly already."""

import math
import queue
import socket
import subprocess
import sys
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.io.record_json import decode
from gcs.io.zenoh.key_expressions import truth_key
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import NS_PER_S, Truth
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec
from sim_vehicles.world import truth_link
from sim_vehicles.world.scenario import load
from sim_vehicles.world.truth_link import TruthSource

SCENARIO = load("prescribed")


def simstate(lat_deg: float) -> mavlink.MAVLink_simstate_message:
    return mavlink.MAVLink_simstate_message(*[0.0] * 9, round(lat_deg * 1e7), 0)


def reported(lat_deg: float) -> mavlink.MAVLink_global_position_int_message:
    return mavlink.MAVLink_global_position_int_message(0, round(lat_deg * 1e7), 0, 0, 0, 0, 0, 0, 0)


def test_a_reported_position_is_taken_only_while_no_true_one_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(truth_link, "print_message", said.append)
    source = TruthSource(1, 0.0)
    assert len(source.requests(0.0)) == 3
    assert source.place(reported(33.0), 1.0) is None  # the true one may still come
    assert source.place(reported(33.0), 9.0) == pytest.approx((33.0, 0.0))
    assert "vehicle 1 sends no true position" in said[0]
    assert source.place(simstate(34.0), 9.1) == pytest.approx((34.0, 0.0))
    assert source.place(reported(33.0), 9.2) is None
    assert source.requests(20.0) == []


@pytest.mark.real_time
def test_sensors_see_a_vehicle_that_flies_already() -> None:
    probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    probe.bind(("127.0.0.1", 0))
    port = probe.getsockname()[1]
    probe.close()
    endpoint, truths = free_endpoint(), queue.Queue[Truth]()
    vehicle = SimVehicle(VehicleSpec(1, 700.0, 500.0, 0.0, 100.0, 15.0), SCENARIO.frame, 0)
    with ZenohSession(listen=endpoint) as bus, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        bus.subscribe(truth_key("prescribed"), lambda key, data: truths.put(decode(key, data, Truth)))
        link.connect(("127.0.0.1", port))
        link.setblocking(False)
        world = subprocess.Popen(
            [sys.executable, "-P", "-m", "sim_vehicles", "world", "prescribed", "--link",
             f"udpin:127.0.0.1:{port}", "--zenoh", endpoint],
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            start_s, place = time.monotonic(), (math.nan, math.nan)
            while math.dist(place, (vehicle.east_m, vehicle.north_m)) > 60.0 or math.isnan(place[0]):
                assert time.monotonic() < start_s + 40.0, place
                t_ns = int((time.monotonic() - start_s) * NS_PER_S)
                for data in vehicle.datagrams_to_send(t_ns):
                    try:
                        link.send(data)
                    except ConnectionRefusedError:  # the world is still starting
                        continue
                try:
                    vehicle.receive_datagram(link.recv(2048), t_ns)
                except (BlockingIOError, ConnectionRefusedError):
                    time.sleep(0.02)
                while not truths.empty():
                    agents = {thing.id: thing for thing in truths.get().objects if thing.kind == "agents"}
                    assert not agents[2].alive  # it is not on the link
                    if agents[1].alive:
                        place = (agents[1].east_m, agents[1].north_m)
        finally:
            world.terminate()
            _, said = world.communicate(timeout=20)
    assert "its reported position is used instead" in said


@pytest.mark.real_time
def test_a_link_without_an_answer_is_named() -> None:
    done = subprocess.run(
        [sys.executable, "-P", "-m", "sim_vehicles", "world", "prescribed", "--link", "tcp:127.0.0.1:1",
         "--zenoh", free_endpoint(), "--zenoh-role", "listen"],
        capture_output=True, text=True, timeout=40, check=False,
    )  # fmt: skip
    assert done.returncode != 0
    assert "tcp:127.0.0.1:1: Connection refused; is the simulation running?" in done.stderr
    assert "the link to the running vehicles did not start" in " ".join(done.stderr.split())


@pytest.mark.real_time
def test_a_simulation_that_ends_is_named_without_a_traceback() -> None:
    with socket.create_server(("127.0.0.1", 0)) as simulation:
        where = f"tcp:127.0.0.1:{simulation.getsockname()[1]}"
        world = subprocess.Popen(
            [sys.executable, "-P", "-m", "sim_vehicles", "world", "prescribed", "--link", where,
             "--zenoh", free_endpoint(), "--zenoh-role", "listen"],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        try:
            connection, _ = simulation.accept()
            assert world.stdout is not None
            while "flying" not in (said := world.stdout.readline()):
                assert said
            connection.close()
            simulation.close()
            said, _ = world.communicate(timeout=40)
        finally:
            world.kill()
    assert world.returncode != 0
    assert f"{where}: Connection refused; did the simulation end?" in said
    assert "Traceback" not in said
