"""Process around one real firmware: starts and launches it, and forwards its frames.

With `FirmwareArguments` it starts the firmware in a folder and brings the vehicle into LOITER above its
start. Then it behaves as a `vehicle_process`: one UDP socket to the ground station, and
the true state to the simulated world. The firmware of a lost vehicle is killed.

A firmware that is slower than nine tenths of the run's speed causes a warning on standard error: results of
such a run are not valid.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import select
import selectors
import signal
import socket
import subprocess
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.errors import SimulationError
from gcs.io.clock import RunClock
from gcs.mavlink.frames.codec import Encoder
from gcs.model import NS_PER_S
from sim_vehicles.autopilots.firmware import (
    Launch,
    Ports,
    Stage,
    arduplane_command,
    px4_command,
    true_place,
    truth_messages,
)
from sim_vehicles.autopilots.firmware_faults import injection_messages, receiver_message, stick_message
from sim_vehicles.error_output import print_message
from sim_vehicles.process_start import (
    Address,
    FirmwareArguments,
    await_start,
    read_arguments,
)
from sim_vehicles.vehicle.faults import FaultChange, FaultKind, Faults, fault_changes
from sim_vehicles.vehicle.frames import FrameReader, Outbox
from sim_vehicles.vehicle.packet_loss import is_lost
from sim_vehicles.vehicle.vehicle_process import DOWN, GROUND_HEARTBEAT
from sim_vehicles.world.first_contact import GroundContact

_LAUNCH_WITHIN_S = 150.0
"""Wall time."""
_NAP_S = 0.05
_PR_SET_PDEATHSIG = 1
_LAUNCH_SYSTEM_ID = 250
"""System id of the launch commands; no failsafe waits for its heartbeat."""
_SENT_TIMES = 3
"""Each message that begins or ends a fault, since datagrams may be lost."""
_STICK_PERIOD_NS = NS_PER_S // 20
_DOWN_M = 3.0
_HOME_M = 100.0
_HEARTBEAT_S = 0.1
"""Wall time between heartbeats before a ground station is heard; the simulation runs faster than that."""
_PROGRESS_S = 20.0
"""Wall time between messages about a launch."""
_STAGE_TEXT = {
    Stage.WAITING: "waits until it can be armed",
    Stage.TAKING_OFF: "takes off",
    Stage.RETURNING: "flies to its start",
    Stage.LOITERING: "is at its start",
    Stage.DONE: "loiters at its start",
}
_LAG_PART = 0.1
_LAG_CHECK_NS = 20 * NS_PER_S


def _die_with_parent() -> None:
    """Have Linux kill the firmware when its host is killed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


class _Port:
    """UDP socket to the firmware, which sends first; its address is the sender's."""

    def __init__(self, port: int = 0, peer: Address | None = None) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.port: int = self.socket.getsockname()[1]
        self.peer = peer

    def receive_all(self) -> list[bytes]:
        """Return all waiting datagrams."""
        datagrams: list[bytes] = []
        while True:
            try:
                data, self.peer = self.socket.recvfrom(4096)
            except (BlockingIOError, ConnectionError):
                return datagrams
            datagrams.append(data)

    def send(self, data: bytes) -> None:
        """Send to the firmware; lost if it does not listen."""
        if self.peer is not None:
            with contextlib.suppress(OSError):
                self.socket.sendto(data, self.peer)


class FirmwareHost:
    """One firmware, its two ports, and the sockets to the ground station and the world."""

    def __init__(self, arguments: FirmwareArguments) -> None:
        vehicle = arguments.vehicle
        folder = Path(arguments.folder)
        binary = Path(arguments.binary)
        (self.spec,) = vehicle.specs
        frame = vehicle.frame
        spec = self.spec
        self._frame = frame
        self.launch = Launch(spec, frame)
        folder.mkdir(parents=True, exist_ok=True)
        environment: dict[str, str] = {}
        if arguments.firmware == "px4":
            at = arguments.instance
            self._ground = self._truth_port = _Port(14540 + at, ("127.0.0.1", 14580 + at))
            command, environment = px4_command(binary, spec, frame, at, arguments.speed, folder)
        else:
            self._ground = _Port()
            self._truth_port = _Port()
            ports = Ports(self._ground.port, self._truth_port.port)
            command = arduplane_command(
                binary, spec, frame, ports, arguments.instance, folder, has_terrain=bool(vehicle.elevation)
            )
        self._log = (folder / "firmware.log").open("wb")
        self.process = subprocess.Popen(  # noqa: S603  the program that the user named, no shell
            command, cwd=folder, stdin=subprocess.DEVNULL, stdout=self._log, stderr=subprocess.STDOUT,
            env={**os.environ, **environment}, start_new_session=True, preexec_fn=_die_with_parent,
        )  # fmt: skip
        self.log_path = folder / "firmware.log"
        self._reader = FrameReader()
        self._commands = Outbox(_LAUNCH_SYSTEM_ID)
        self._heartbeats = Encoder()
        self._heartbeat_s = -math.inf
        self._truths = Outbox(spec.system_id)
        self._receiver = Outbox(spec.system_id)
        self._towards_gcs = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._towards_gcs.setblocking(False)
        self._gcs = arguments.gcs
        self._world = arguments.truth
        self._loss = vehicle.loss
        self._rng = np.random.default_rng([spec.seed, spec.system_id])
        self._death_rng = np.random.default_rng([spec.seed, zlib.crc32(b"death"), spec.system_id])
        self._ground_contact = GroundContact()
        self._death_check_ns = 0
        self._deaths_from_ns: int | None = None
        self._lag_from: tuple[int, int] | None = None
        self._faults = Faults()
        self._fault_changes: list[FaultChange] = []
        self._is_down = False
        self._alt_msl_m = math.nan
        self._is_receiver = arguments.firmware == "px4" and any(
            fault.kind is FaultKind.GLITCH for fault in spec.faults
        )
        self._has_sticks = arguments.firmware == "px4" and any(f.kind is FaultKind.RC for f in spec.faults)
        self._stick_ns = 0
        self.is_lost = self.has_failed = False
        """True after its loss by the scenario; True after an end of the firmware by itself."""

    # ------------------------------------------------------------ before the clock starts

    def bring_up(self) -> bool:
        """Launch the vehicle; return False if standard input closed before.

        Raises
        ------
        SimulationError
            The firmware ended, or the vehicle was not in LOITER above its start in time.
        """
        if self.spec.autopilot == "px4" and (self.spec.wind_east_m_s or self.spec.wind_north_m_s):
            print_message(f"vehicle {self.spec.system_id} flies in still air: PX4's SIH has no wind")
        deadline = time.monotonic() + _LAUNCH_WITHIN_S
        told = self.launch.stage
        tell_s = time.monotonic()
        while self.launch.stage is not Stage.DONE:
            if told is not self.launch.stage or time.monotonic() >= tell_s:
                told = self.launch.stage
                tell_s = time.monotonic() + _PROGRESS_S
                is_told = self.launch.last_status and told is Stage.WAITING
                status = f" ({self.launch.last_status})" if is_told else ""
                print_message(f"vehicle {self.spec.system_id} {_STAGE_TEXT[told]}{status}")
            self.beat()
            if self.process.poll() is not None:
                raise SimulationError(
                    f"the firmware ended with code {self.process.returncode}: see {self.log_path}"
                )
            if time.monotonic() > deadline:
                raise SimulationError(
                    f"not in the air after {_LAUNCH_WITHIN_S:.0f} s ({self.launch.stage.name}): "
                    f"{self.launch.last_status or 'the firmware sent no status text'}; see {self.log_path}"
                )
            if select.select([sys.stdin], [], [], 0.02)[0]:
                return False
            datagrams = self._truth_port.receive_all()
            if self._truth_port is not self._ground:
                self._ground.receive_all()  # Dropped: not ready yet.
            for data in datagrams:
                for message in self._reader.messages(data):
                    self.launch.receive(message)
                    self._send_fix(message)
            for command in self.launch.poll(time.monotonic_ns()):
                self._commands.send(command)
            for data in self._commands.pop_datagrams():
                self._truth_port.send(data)
        return True

    def beat(self) -> None:
        """Send a heartbeat if it is due, until a ground station is heard.

        With FS_GCS_ENABL an ArduPlane does not arm without one, and returns when they end.
        """
        if self._ground_contact.began_t_ns is None and time.monotonic() >= self._heartbeat_s:
            self._heartbeat_s = time.monotonic() + _HEARTBEAT_S
            self._truth_port.send(self._heartbeats(GROUND_HEARTBEAT))

    def set_speed(self, speed: float) -> None:
        """Set the speed of ArduPlane's simulation; PX4's has it from the start."""
        if self.spec.autopilot == "px4":
            return
        name = b"SIM_SPEEDUP"
        parameter = mavlink.MAVLink_param_set_message(
            self.spec.system_id, 1, name, speed, mavlink.MAV_PARAM_TYPE_REAL32
        )
        for _ in range(3):
            self._truth_port.send(self._commands.encode(parameter))

    def begin(self, t_ns: int) -> None:
        """Start the run time, and losses unless they wait for ground contact."""
        if not self.spec.waits_for_ground:
            self._start_losses(t_ns)

    def _start_losses(self, t_ns: int) -> None:
        self._deaths_from_ns = t_ns
        self._death_check_ns = t_ns + int(self.spec.death_check_period_s * NS_PER_S)
        self._fault_changes = fault_changes(self.spec.faults, t_ns)

    # ------------------------------------------------------------ while the mission is flown

    @property
    def sockets(self) -> list[socket.socket]:
        """Sockets to read."""
        ports = {self._ground.socket, self._truth_port.socket, self._towards_gcs}
        return sorted(ports, key=lambda one: one.fileno())

    @property
    def has_ended(self) -> bool:
        """True once the vehicle is lost, or its firmware has failed."""
        return self.is_lost or self.has_failed

    def work(self, t_ns: int) -> None:
        """Forward waiting datagrams both ways, and end the vehicle when it is lost."""
        if self.process.poll() is not None:
            self.has_failed = True
            print_message(
                f"vehicle {self.spec.system_id}: the firmware ended with code {self.process.returncode}: "
                f"see {self.log_path}"
            )
            return
        self.beat()
        if self._dies(t_ns):
            self.stop()
            self.is_lost = True
            self._send_truth(t_ns, None)  # A time without a state: the vehicle is lost.
            return
        self._change_faults(t_ns)
        self._send_sticks(time.monotonic_ns())
        for data in self._commands.pop_datagrams():
            self._truth_port.send(data)
        is_silent = FaultKind.RADIO in self._faults
        for data in self._ground.receive_all():
            if not is_silent and not is_lost(self._loss, self._rng):
                with contextlib.suppress(OSError):  # No receiver, or a full buffer.
                    self._towards_gcs.sendto(data, self._gcs)
            if self._truth_port is self._ground:
                self._forward_truth(data, t_ns)
        if self._truth_port is not self._ground:
            for data in self._truth_port.receive_all():
                self._forward_truth(data, t_ns)
        while True:
            try:
                data, sender = self._towards_gcs.recvfrom(4096)
            except BlockingIOError:
                break
            except ConnectionError:
                continue
            if sender == self._gcs and not is_silent and not is_lost(self._loss, self._rng):
                if self._ground_contact.hear(t_ns) and self.spec.waits_for_ground:
                    self._start_losses(t_ns)
                self._ground.send(data)

    def _change_faults(self, t_ns: int) -> None:
        """Begin and end the faults that are due."""
        spec = self.spec
        while self._fault_changes and self._fault_changes[-1].t_ns <= t_ns:
            change = self._fault_changes.pop()
            if change.begins:
                self._faults.begin(change.kind, t_ns)
            else:
                self._faults.end(change.kind)
            for _ in range(_SENT_TIMES):
                for message in injection_messages(
                    spec.system_id, spec.autopilot == "px4", change.kind, change.begins
                ):
                    self._commands.send(message)

    def _send_sticks(self, now_ns: int) -> None:
        """Be the radio control of a PX4 that is to lose it."""
        if self._has_sticks and now_ns >= self._stick_ns and FaultKind.RC not in self._faults:
            self._stick_ns = now_ns + _STICK_PERIOD_NS
            self._commands.send(stick_message(self.spec.system_id))

    def _send_fix(self, message: Any) -> None:
        """Be the GPS receiver of a PX4 that is to glitch."""
        if self._is_receiver and message.get_type() == "HIL_STATE_QUATERNION":
            has_fix = FaultKind.GPS not in self._faults
            fix = receiver_message(message, has_fix, glitches=FaultKind.GLITCH in self._faults)
            self._truth_port.send(self._receiver.encode(fix))

    def _watch_height(self, message: Any) -> None:
        """Note that the vehicle came down elsewhere than at its home."""
        east_m, north_m = self._frame.to_local(message.lat * 1e-7, message.lon * 1e-7)
        is_home = math.dist((east_m, north_m), (self.spec.east_m, self.spec.north_m)) < _HOME_M
        self._is_down = message.relative_alt * 1e-3 < _DOWN_M and not is_home

    def _dies(self, t_ns: int) -> bool:
        spec = self.spec
        from_ns = self._deaths_from_ns
        if from_ns is None:
            return False
        if spec.dies_at_s is not None and t_ns - from_ns >= spec.dies_at_s * NS_PER_S:
            return True
        while spec.survival_probability < 1.0 and self._death_check_ns <= t_ns:
            self._death_check_ns += int(spec.death_check_period_s * NS_PER_S)
            if self._death_rng.random() > spec.survival_probability:
                return True
        return False

    def _forward_truth(self, data: bytes, t_ns: int) -> None:
        for message in self._reader.messages(data):
            place = true_place(message)
            if place is not None:
                self._send_truth(t_ns, place)
                self._send_fix(message)
            elif message.get_type() == "SYSTEM_TIME":
                self._watch_lag(message.time_boot_ms, t_ns)
            elif message.get_type() == "GLOBAL_POSITION_INT":
                self._alt_msl_m = message.alt * 1e-3
                self._watch_height(message)

    def _send_truth(self, t_ns: int, place: tuple[float, float] | None) -> None:
        for message in truth_messages(t_ns, place, self._alt_msl_m):
            self._truths.send(message)
        if place is not None and self._ground_contact.began_t_ns is not None:
            self._truths.send(GROUND_HEARTBEAT)
        if place is not None and self._is_down:
            self._truths.send(DOWN)
        for data in self._truths.pop_datagrams():
            with contextlib.suppress(OSError):
                self._towards_gcs.sendto(data, self._world)

    def _watch_lag(self, boot_ms: int, t_ns: int) -> None:
        if self._lag_from is None:
            self._lag_from = boot_ms, t_ns
            return
        passed_ns = t_ns - self._lag_from[1]
        if passed_ns < _LAG_CHECK_NS:
            return
        flown_ns = (boot_ms - self._lag_from[0]) * 1_000_000
        self._lag_from = boot_ms, t_ns
        if flown_ns < (1.0 - _LAG_PART) * passed_ns:
            print_message(
                f"vehicle {self.spec.system_id}: the firmware runs at {flown_ns / passed_ns:.2f} of the "
                "run's speed; lower --speed"
            )

    def stop(self) -> None:
        """End the firmware and everything that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self._log.close()


def fly(host: FirmwareHost, clock: RunClock) -> None:
    """Forward datagrams until the vehicle is lost, or standard input closes; return when that closes."""
    with selectors.DefaultSelector() as selector:
        selector.register(sys.stdin, selectors.EVENT_READ, "stdin")
        for one in host.sockets:
            selector.register(one, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select(_NAP_S):
                if key.data == "stdin" and not os.read(sys.stdin.fileno(), 1024):
                    return
            if not host.has_ended:
                host.work(clock.now_ns())
            elif len(selector.get_map()) > 1:  # what is not read would wake this loop again and again
                for one in host.sockets:
                    selector.unregister(one)


def main() -> int:
    """Run until standard input closes or a signal comes."""
    arguments = read_arguments(FirmwareArguments)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    host = FirmwareHost(arguments)
    try:
        if host.bring_up() and (start := await_start(idle=host.beat)) is not None:
            host.set_speed(start.speed)
            host.begin(start.start_t_ns)
            fly(host, start.clock)
            return int(host.has_failed)
    except SimulationError as error:
        sys.stderr.write(f"vehicle {host.spec.system_id}: {error}\n")
        return 1
    finally:
        host.stop()
    return 0


if __name__ == "__main__":
    sys.exit(main())
