"""A ground station that talks to a vehicle in memory, and a vehicle in a process of its own."""

from __future__ import annotations

import math
import selectors
import subprocess
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.geo import LocalFrame
from sim_vehicles.process_start import Start, VehicleArguments, process_command
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

S = 1_000_000_000
START_NS = 1_767_225_600 * S
FRAME = LocalFrame(33.2, -87.6, 70.0)


class Ground:
    """Talks to one vehicle and keeps the clock."""

    def __init__(self, **spec: Any) -> None:
        defaults: dict[str, Any] = {
            "system_id": 7, "east_m": 0.0, "north_m": 0.0, "course_rad": math.pi / 2, "alt_rel_m": 100.0,
            "forward_speed_m_s": 15.0, "gps_noise_std_m": 0.0,
        }  # fmt: skip
        self.spec = VehicleSpec(**(defaults | spec))
        self.vehicle = SimVehicle(self.spec, FRAME, START_NS)
        self.pen = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.t_ns = START_NS
        self.heard: list[Any] = []
        self.fly(0)

    def fly(self, seconds: float, tick_s: float = 0.05) -> list[Any]:
        """Let time pass; return what was heard meanwhile."""
        end_ns, heard = self.t_ns + int(seconds * S), []
        while True:
            for datagram in self.vehicle.datagrams_to_send(self.t_ns):
                assert len(datagram) <= 1400
                heard += mavlink.MAVLink(None).parse_buffer(bytearray(datagram)) or []
            if self.t_ns >= end_ns:
                break
            self.t_ns = min(self.t_ns + int(tick_s * S), end_ns)
        self.heard += heard
        return heard

    def send(self, message: Any, sender: int = 255, component: int = 190) -> list[Any]:
        """Send one message; return what comes back at once."""
        self.fly(0)
        self.pen.srcSystem, self.pen.srcComponent = sender, component
        self.vehicle.receive_datagram(message.pack(self.pen), self.t_ns)
        return self.fly(0)

    def command(self, command: int, *params: float, target: int = 7, **who: int) -> tuple[int, list[Any]]:
        """COMMAND_LONG; return the ACK's result and all that came."""
        values = [*params, *[0.0] * (7 - len(params))]
        replies = self.send(mavlink.MAVLink_command_long_message(target, 1, command, 0, *values), **who)
        acks = [r for r in replies if r.get_type() == "COMMAND_ACK" and r.command == command]
        assert len(acks) == 1, replies
        return acks[0].result, replies

    def upload(self, *items: Any, mission_type: int = 0) -> int:
        """Upload items as given (item 0 included); return the ACK's type."""
        replies = self.send(mavlink.MAVLink_mission_count_message(7, 1, len(items), mission_type))
        while replies[-1].get_type() == "MISSION_REQUEST":
            replies = self.send(items[replies[-1].seq])
        assert replies[-1].get_type() == "MISSION_ACK"
        return replies[-1].type

    def download(self, mission_type: int = 0) -> list[Any]:
        """Read the stored items back."""
        count = self.send(mavlink.MAVLink_mission_request_list_message(7, 1, mission_type))[-1].count
        return [
            self.send(mavlink.MAVLink_mission_request_int_message(7, 1, seq, mission_type))[-1]
            for seq in range(count)
        ]

    def until(self, condition: Any, seconds: float = 300.0) -> list[Any]:
        """Fly until `condition()` holds; fail when it never does. Returns what was heard."""
        heard: list[Any] = []
        for _ in range(int(seconds / 0.05)):
            if condition():
                return heard
            heard += self.fly(0.05)
        pytest.fail(f"nothing of the kind within {seconds} s")

    @property
    def mode(self) -> int:
        return int(self.vehicle.autopilot.mode)


def item(seq: int, east_m: float, north_m: float, alt_m: float = 100.0, **fields: Any) -> Any:
    """One MISSION_ITEM_INT: a waypoint by default."""
    lat, lon = FRAME.to_geodetic(east_m, north_m)
    values: dict[str, Any] = {
        "frame": 6, "command": mavlink.MAV_CMD_NAV_WAYPOINT, "current": 0, "autocontinue": 1,
        "param1": 0.0, "param2": 0.0, "param3": 0.0, "param4": math.nan,
        "x": round(lat * 1e7), "y": round(lon * 1e7), "z": alt_m, "mission_type": 0,
    } | fields  # fmt: skip
    return mavlink.MAVLink_mission_item_int_message(7, 1, seq, **values)


@pytest.fixture
def ground() -> type[Ground]:
    """The class, so that a test says what vehicle it wants."""
    return Ground


@pytest.fixture(name="item")
def item_fixture() -> Any:
    """Makes one MISSION_ITEM_INT."""
    return item


@pytest.fixture
def start_process() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts vehicle processes that talk to a port, and ends them with the test."""
    running: list[subprocess.Popen[str]] = []

    def start(
        port: int,
        *specs: VehicleSpec,
        truth_port: int = 0,
        loss: float = 0.0,
        speed: float = 1.0,
        stderr: int | None = None,
    ) -> subprocess.Popen[str]:
        truth = ("127.0.0.1", truth_port) if truth_port else None
        arguments = VehicleArguments(FRAME, list(specs), loss)
        command, pipe = process_command("vehicle.vehicle_process", arguments), subprocess.PIPE
        process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=stderr, text=True)
        running.append(process)
        assert process.stdin is not None
        assert process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            assert selector.select(30), "the vehicle did not come up"
        assert process.stdout.readline() == "ready\n"
        now_ns = time.time_ns()
        process.stdin.write(Start(now_ns, now_ns, speed, ("127.0.0.1", port), truth).line())
        process.stdin.flush()
        return process

    yield start
    for process in running:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()
