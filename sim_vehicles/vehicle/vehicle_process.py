"""Process of one or more simulated vehicles: their sockets and clock (arguments: `VehicleArguments`).

Each vehicle has its own UDP socket and exchanges datagrams with the ground station's address only. It sends
its true state to the simulated world ten times a second of run time: SYSTEM_TIME and SIM_STATE in one
datagram, a HEARTBEAT after ground contact, and EXTENDED_SYS_STATE when it is down. Datagrams of the ground
station are dropped at random, each way. The process also ends on SIGTERM or SIGINT.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import socket
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.io.clock import RunClock
from gcs.io.signing.keystore import read_keys
from gcs.model import NS_PER_S
from sim_vehicles.autopilots.mission_protocol import NEVER_NS
from sim_vehicles.error_output import print_message
from sim_vehicles.process_start import (
    Address,
    VehicleArguments,
    await_start,
    load_elevation,
    read_arguments,
)
from sim_vehicles.vehicle.frames import Outbox
from sim_vehicles.vehicle.packet_loss import is_lost
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

GROUND_HEARTBEAT = mavlink.MAVLink_heartbeat_message(
    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
)
"""Sent to the simulated world after ground contact."""
DOWN = mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_ON_GROUND)
"""Sent to the simulated world by a vehicle that came down elsewhere than by a landing of its mission."""
_TRUTH_PERIOD_NS = NS_PER_S // 10
_MIN_SLEEP_S = 0.001
_MAX_SLEEP_S = 0.05
_MAX_LAG_NS = NS_PER_S // 2


class Host:
    """One vehicle on its socket."""

    def __init__(
        self, vehicle: SimVehicle, start_t_ns: int, gcs: Address, truth: Address | None, loss: float
    ) -> None:
        self.vehicle = vehicle
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self._gcs = gcs
        self._truth = truth
        self._truth_outbox = Outbox(vehicle.system_id)
        self._truth_ns = start_t_ns if truth is not None else NEVER_NS
        self._loss = loss
        self._rng = np.random.default_rng([vehicle.spec.seed, vehicle.system_id])

    @property
    def due_ns(self) -> int:
        """Time of the next action."""
        return min(self.vehicle.due_ns, self._truth_ns)

    def receive(self, t_ns: int) -> None:
        """Process all waiting datagrams from the ground station; drop others."""
        while True:
            try:
                data, sender = self.socket.recvfrom(2048)
            except BlockingIOError:
                return
            except ConnectionError:  # An ICMP error for an earlier datagram.
                continue
            if sender == self._gcs and not is_lost(self._loss, self._rng):
                self.vehicle.receive_datagram(data, t_ns)

    def advance(self, t_ns: int) -> None:
        """Fly up to `t_ns` and send what is due."""
        while self._truth_ns <= t_ns:
            self.vehicle.advance(self._truth_ns)
            time_message, state_message = self.vehicle.truth_messages(self._truth_ns)
            if self.vehicle.alive:
                extra = [GROUND_HEARTBEAT] if self.vehicle.ground.began_t_ns is not None else []
                if self.vehicle.is_down:
                    extra.append(DOWN)
                self._send_truth(time_message, state_message, *extra)
                self._truth_ns += _TRUTH_PERIOD_NS
            else:
                # A time without a state: the vehicle is lost.
                self._send_truth(time_message)
                self._truth_ns = NEVER_NS
        for data in self.vehicle.datagrams_to_send(t_ns):
            if not is_lost(self._loss, self._rng):
                self._send(data, self._gcs)

    def _send_truth(self, *messages: Any) -> None:
        for message in messages:
            self._truth_outbox.send(message)
        for data in self._truth_outbox.pop_datagrams():
            self._send(data, self._truth)

    def _send(self, data: bytes, to: Address | None) -> None:
        if to is not None:
            # No receiver, or a full buffer: a datagram may be lost.
            with contextlib.suppress(OSError):
                self.socket.sendto(data, to)


def fly(hosts: list[Host], clock: RunClock) -> None:
    """Fly until standard input closes."""
    with selectors.DefaultSelector() as selector:
        selector.register(sys.stdin, selectors.EVENT_READ)
        for host in hosts:
            selector.register(host.socket, selectors.EVENT_READ, host)
        last_message_s = 0.0
        while True:
            due_ns = min(host.due_ns for host in hosts)
            # At least a millisecond: due times may have passed.
            ready = selector.select(min(max(clock.wall_s_until(due_ns), _MIN_SLEEP_S), _MAX_SLEEP_S))
            t_ns = clock.now_ns()
            for key, _ in ready:
                if isinstance(key.data, Host):
                    key.data.receive(t_ns)
                elif not os.read(sys.stdin.fileno(), 1024):
                    return
            for host in hosts:
                host.advance(t_ns)
            late_ns = clock.now_ns() - due_ns
            if late_ns > _MAX_LAG_NS and time.monotonic() > last_message_s + 1.0:
                last_message_s = time.monotonic()
                names = ", ".join(str(host.vehicle.system_id) for host in hosts)
                late_s = late_ns / NS_PER_S
                print_message(
                    f"vehicle {names}: {late_s:.1f} s of run time behind the clock: "
                    "this machine is too slow; a lower --speed would help"
                )


def _key(spec: VehicleSpec) -> bytes | None:
    """Return the signing key of a vehicle: its own, or the default."""
    if not spec.key_file:
        return None
    keys = read_keys(Path(spec.key_file))
    return keys.vehicles.get(spec.system_id, keys.default)


def main() -> None:
    """Fly until standard input closes or a signal comes."""
    arguments = read_arguments(VehicleArguments)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    # Build one vehicle first: lazy imports and tables are ready when the clock starts.
    SimVehicle(arguments.specs[0], arguments.frame, 0).advance(0)
    keys = {spec.system_id: _key(spec) for spec in arguments.specs}
    elevation = load_elevation(arguments.elevation)
    start = await_start()
    if start is None:
        return
    with contextlib.ExitStack() as stack:
        hosts = []
        for spec in arguments.specs:
            key = keys.get(spec.system_id)
            vehicle = SimVehicle(spec, arguments.frame, start.start_t_ns, key, elevation)
            host = Host(vehicle, start.start_t_ns, start.gcs, start.truth, arguments.loss)
            stack.enter_context(host.socket)
            hosts.append(host)
        fly(hosts, start.clock)


if __name__ == "__main__":
    main()
