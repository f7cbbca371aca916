"""True positions of running vehicles, from a link to their simulation, for the simulated world.

It requests SIMSTATE (ArduPilot's SITL) and HIL_STATE_QUATERNION (PX4) from each vehicle on the endpoint, and
sends the true positions to the world process. It sends no heartbeat, so that vehicles do not treat it as a
ground station.

If a vehicle sends no true position within some seconds, its reported one (GLOBAL_POSITION_INT) is used, with
a line on standard error.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import time
from typing import Any

os.environ.setdefault("MAVLINK20", "1")  # Read by mavutil at import.

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.io.clock import RunClock
from sim_vehicles.autopilots.firmware import true_place, truth_messages
from sim_vehicles.error_output import print_message
from sim_vehicles.process_start import Address, TruthLinkArguments, await_start, read_arguments
from sim_vehicles.vehicle.frames import Outbox

_POLL_S = 0.01
_RETRIES = 3
_SYSTEM_ID = 250
_AGAIN_S = 2.0
_REPORTED_AFTER_S = 8.0
_RATE_HZ = 10.0
_REQUESTED = (
    mavlink.MAVLINK_MSG_ID_SIMSTATE,
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
)


class TruthSource:
    """Requests to one vehicle, and its position."""

    def __init__(self, system_id: int, now_s: float) -> None:
        self.system_id = system_id
        self._has_truth = self._is_reported = False
        self._heard_s = now_s
        self._requested_s = -_AGAIN_S

    def requests(self, now_s: float) -> list[Any]:
        """Return the requests that are due, until a true position comes."""
        if self._has_truth or now_s - self._requested_s < _AGAIN_S:
            return []
        self._requested_s = now_s
        command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        interval_us = 1e6 / _RATE_HZ
        return [
            mavlink.MAVLink_command_long_message(
                self.system_id, 1, command, 0, number, interval_us, 0, 0, 0, 0, 0
            )
            for number in _REQUESTED
        ]

    def place(self, message: Any, now_s: float) -> tuple[float, float] | None:
        """Return latitude and longitude in degrees of a message, or None."""
        place = true_place(message)
        if place is not None:
            self._has_truth = True
            return place
        is_late = now_s - self._heard_s >= _REPORTED_AFTER_S
        if self._has_truth or not is_late or message.get_type() != "GLOBAL_POSITION_INT":
            return None
        if not self._is_reported:
            self._is_reported = True
            print_message(
                f"vehicle {self.system_id} sends no true position (SIMSTATE, HIL_STATE_QUATERNION): "
                "its reported position is used instead"
            )
        return message.lat * 1e-7, message.lon * 1e-7


def forward_truth(link: Any, clock: RunClock, world: Address) -> None:
    """Forward true states from the link to the world until standard input closes."""
    sources: dict[int, TruthSource] = {}
    outboxes: dict[int, Outbox] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as towards_world:
        while True:
            if select.select([sys.stdin], [], [], 0.0)[0] and not os.read(sys.stdin.fileno(), 1024):
                return
            message = link.recv_match(blocking=True, timeout=_POLL_S)
            now_s = time.monotonic()
            if message is None or message.get_srcComponent() != mavlink.MAV_COMP_ID_AUTOPILOT1:
                continue
            system_id = message.get_srcSystem()
            source = sources.setdefault(system_id, TruthSource(system_id, now_s))
            for request in source.requests(now_s):
                link.mav.send(request)
            place = source.place(message, now_s)
            if place is None:
                continue
            outbox = outboxes.setdefault(system_id, Outbox(system_id))
            for truth in truth_messages(clock.now_ns(), place):
                outbox.send(truth)
            for data in outbox.pop_datagrams():
                with contextlib.suppress(OSError):  # Full buffer.
                    towards_world.sendto(data, world)


def main() -> int:
    """Run until standard input closes."""
    arguments = read_arguments(TruthLinkArguments)
    endpoint = arguments.link.removeprefix("serial:")
    baud = 57600
    if endpoint != arguments.link:
        endpoint, _, rate = endpoint.rpartition(":")
        baud = int(rate)
    try:
        with contextlib.redirect_stdout(sys.stderr):  # mavutil prints; the supervisor reads stdout.
            link = mavutil.mavlink_connection(
                endpoint, baud=baud, source_system=_SYSTEM_ID, autoreconnect=True, retries=_RETRIES
            )
    except OSError as error:
        sys.stderr.write(f"{arguments.link}: {error.strerror or error}; is the simulation running?\n")
        return 1
    start = await_start()
    if start is not None:
        try:
            with contextlib.redirect_stdout(sys.stderr):
                forward_truth(link, start.clock, arguments.truth)
        except OSError as error:
            sys.stderr.write(f"{arguments.link}: {error.strerror or error}; did the simulation end?\n")
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
