"""Faults at random moments for command, its bridge and its standby: real processes, simulated vehicles.

A schedule is drawn from a seed. Processes that end are started again as a service manager does it; after a
take-over the old command is not, since its node has been replaced.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np

from gcs.errors import GcsError
from gcs.io.zenoh.discovery import ServiceAddress
from gcs.io.zenoh.key_expressions import events_key
from gcs.io.zenoh.order_client import send_order
from gcs.io.zenoh.order_messages import OrderMessage
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from helpers.heartbeat_tap import HeartbeatTap
from helpers.processes import Run, bridges, free_port

Part: TypeAlias = Literal["command", "standby", "bridge", "command and bridge"]
Deed: TypeAlias = Literal["kill", "stop", "restart"]

MISSION_S: Final = 200.0
"""Flight of `deterministic`, with time for what the faults cost."""
_POLL_S: Final = 0.02
_AGAIN_S: Final = 1.0
"""Until a process that has ended is started again."""
_START_S: Final = 240.0
_TAKE_OVER_S: Final = 25.0
_SETTLE_S: Final = 5.0
_OUTAGE_S: Final = 60.0
"""For a bridge and a command to start on a busy machine."""


class Fault(NamedTuple):
    """A fault of one part."""

    at_s: float
    """After the missions were uploaded and the standby had the state."""
    part: Part
    deed: Deed
    duration_s: float = 0.0
    """Of a stop."""


class Schedule(NamedTuple):
    """Faults of one run."""

    is_bridge_alone: bool
    """True: the bridge is a process by itself, as on another machine; False: command starts it."""
    faults: tuple[Fault, ...]
    orders: tuple[tuple[float, int, float], ...]
    """Times at which a vehicle is to hold, the vehicles, and times after which they resume."""
    flies_to_the_end: bool = True


def draw_schedule(seed: int) -> Schedule:
    """Draw the faults of a run: one that ends or stops command, others before and after it."""
    rng = np.random.default_rng(seed)
    main_s = float(rng.uniform(3.0, 12.0))
    faults = [_main_fault(rng, main_s)]
    for _ in range(int(rng.integers(0, 3))):
        part: Part = "standby" if rng.random() < 0.5 else "bridge"
        faults.append(_fault(rng, float(rng.uniform(0.0, main_s)), part))
    if rng.random() < 0.5:
        part = "bridge" if rng.random() < 0.5 else "command"
        faults.append(_fault(rng, main_s + float(rng.uniform(6.0, 12.0)), part))
    orders = [
        (float(rng.uniform(0.0, main_s + 6.0)), int(rng.integers(1, 5)), float(rng.uniform(1.0, 4.0)))
        for _ in range(3)
    ]
    return Schedule(bool(rng.random() < 0.4), tuple(sorted(faults)), tuple(sorted(orders)))


def _main_fault(rng: np.random.Generator, at_s: float) -> Fault:
    kind = rng.random()
    if kind < 0.55:
        return Fault(at_s, "command", "kill")
    if kind < 0.65:
        return Fault(at_s, "command and bridge", "kill")
    if kind < 0.75:
        return Fault(at_s, "command", "restart")
    return Fault(at_s, "command", "stop", float(rng.uniform(1.0, 20.0)))


def _fault(rng: np.random.Generator, at_s: float, part: Part) -> Fault:
    kind = rng.random()
    if kind < 0.4:
        return Fault(at_s, part, "kill")
    if kind < 0.5:
        return Fault(at_s, part, "restart")
    return Fault(at_s, part, "stop", float(rng.uniform(1.0, 6.0)))


@dataclass(slots=True)
class Node:
    """A process of command, of a standby, or of a bridge by itself."""

    name: str
    process: subprocess.Popen[bytes]
    ended_unix_s: float | None = None
    """Time of its `kill -9`."""


@dataclass(slots=True)
class Flight:
    """What a run left behind."""

    folder: Path
    tap: HeartbeatTap
    speed: float
    epoch_ns: int
    nodes: list[Node] = field(default_factory=list)
    take_over_s: list[float] = field(default_factory=list)
    """From the fault until the standby commanded."""
    events: list[bytes] = field(default_factory=list)
    """Batches of command's events, as a standby gets them: a recording lacks the second before a kill."""
    done: list[str] = field(default_factory=list)
    """Faults, with their times."""
    problems: list[str] = field(default_factory=list)
    uncompared: int = 0
    """Take-overs whose state could not be compared: the last events were recorded nowhere."""
    gap_s: float = 0.0
    """Longest time without a heartbeat at a vehicle, while a bridge ran and was not stopped."""
    all_gap_s: float = 0.0
    """With the time of a bridge that is stopped or starts."""


class ChaosRun:
    """One run."""

    def __init__(self, folder: Path, schedule: Schedule, speed: float) -> None:
        relay = free_port()
        self.run = Run(folder, speed, relay)
        self.tap = HeartbeatTap(relay, self.run.port)
        threading.Thread(target=self._drain_world, daemon=True).start()
        self._schedule = schedule
        self._speed = speed
        epoch_ns = int(self.run.clock[1].partition(",")[0]) if self.run.clock else 0
        self.flight = Flight(folder, self.tap, speed, epoch_ns)
        self._command: Node | None = None
        self._standby: Node | None = None
        self._bridge: Node | None = None
        self._runtime = {"XDG_RUNTIME_DIR": str(folder)}
        self._observer = ZenohSession(connect=self.run.zenoh)
        self._observer.subscribe(
            events_key("deterministic"), lambda _, batch: self.flight.events.append(batch)
        )
        self._outages: list[tuple[float, float]] = []
        """Monotonic times without a bridge."""
        links = f'[links]\nfailover_s = {30.0 * speed}\nstandby = "{self.run.standby}"'
        if schedule.is_bridge_alone:
            links += f'\nbridge = "{free_endpoint()}"'
        self.run.file.write_text(self.run.file.read_text().replace("[links]", links, 1))

    def _drain_world(self) -> None:
        assert self.run.world.stdout is not None
        for _ in self.run.world.stdout:
            pass

    # ------------------------------------------------------------ processes

    def _start(self, role: str) -> Node:
        name = f"{role}-{1 + len(self.flight.nodes)}"
        arguments = ("--console", "off", *(() if role == "command" else ("--role", role)))
        node = Node(name, self.run.serve(name, self._runtime, arguments))
        self.flight.nodes.append(node)
        return node

    def fly(self) -> Flight:
        """Fly a mission under the faults."""
        if self._schedule.is_bridge_alone:
            self._bridge = self._start("bridge")
            self.run.until(self._bridge.name, lambda said: "command connects to" in said, _START_S)
        self._command = self._start("command")
        self.run.until(self._command.name, lambda said: said.count("verified by read-back") >= 4, _START_S)
        self._start_standby()
        begin_s = time.monotonic()
        threads = [
            threading.Thread(target=self._order, args=(begin_s, number, *order), daemon=True)
            for number, order in enumerate(self._schedule.orders)
        ]
        for thread in threads:
            thread.start()
        for fault in self._schedule.faults:
            self._wait_until(begin_s + fault.at_s)
            self._inflict(fault)
        self._wait_until(time.monotonic() + _SETTLE_S)
        if self._schedule.flies_to_the_end:
            self._wait_for_end()
        end_s = time.monotonic()
        for thread in threads:
            thread.join(_START_S)
        self._measure_gaps(begin_s, end_s)
        self._end()
        return self.flight

    def _start_standby(self) -> None:
        standby = self._standby = self._start("standby")
        with contextlib.suppress(AssertionError):
            self.run.until(standby.name, lambda said: "follows it" in said, _START_S)
            return
        self._standby = None
        self.flight.problems.append(
            f"{standby.name} does not follow: {self.run.printed(standby.name)[-300:]}"
        )

    def _wait_until(self, until_s: float) -> None:
        while (left_s := until_s - time.monotonic()) > 0.0:
            time.sleep(min(left_s, 0.2))
            self._supervise()

    def _supervise(self) -> None:
        """Note an unexpected take-over; start what has ended again."""
        standby = self._standby
        if standby is not None and self._takes_over(standby):
            self.flight.problems.append(f"{standby.name} took over from a command that was not disturbed")
            self._command, self._standby = standby, None
        command = self._command
        if command is not None and command.process.poll() is not None:
            self.flight.problems.append(f"{command.name} ended: {self.run.printed(command.name)[-300:]}")
            self._command = self._start("command")

    def _takes_over(self, standby: Node) -> bool:
        return "takes over" in self.run.printed(standby.name)

    # ------------------------------------------------------------ faults

    def _inflict(self, fault: Fault) -> None:
        self._supervise()
        self.flight.done.append(
            f"{fault.at_s:.1f} s {fault.deed} {fault.part}"
            + (f" for {fault.duration_s:.1f} s" if fault.duration_s else "")
        )
        if fault.part == "bridge":
            self._harm_bridge(fault)
        elif fault.part == "standby":
            self._harm_standby(fault)
        else:
            self._harm_command(fault)

    def _bridge_pids(self) -> list[int]:
        if self._bridge is not None:
            return [self._bridge.process.pid]
        return [bridge.pid for bridge in bridges(self.flight.folder)]

    def _harm_bridge(self, fault: Fault) -> None:
        begin_s = time.monotonic()
        for pid in self._bridge_pids():
            if fault.deed == "stop":
                with _stopped(pid, fault.duration_s):
                    pass
            else:
                os.kill(pid, signal.SIGKILL if fault.deed == "kill" else signal.SIGTERM)
        if fault.deed != "stop" and self._bridge is not None:
            self._bridge.process.wait()
            time.sleep(_AGAIN_S)
            self._bridge = self._start("bridge")
        self._wait_for_heartbeats(begin_s)

    def _wait_for_heartbeats(self, begin_s: float) -> None:
        """Wait for the end of an outage of the bridge, that began at a monotonic time."""
        self._outages.append((begin_s, begin_s + _OUTAGE_S))
        since_s = time.monotonic()
        while time.monotonic() < since_s + _OUTAGE_S:
            heard_s = [times[-1] for times in self.tap.heard_s.values()]
            if min(heard_s) > since_s + 0.5:
                self._outages[-1] = (begin_s, time.monotonic())
                return
            time.sleep(0.1)
        self.flight.problems.append(f"no heartbeats {_OUTAGE_S:g} s after the bridge was disturbed")

    def _harm_standby(self, fault: Fault) -> None:
        standby = self._standby
        if standby is None:
            return
        if fault.deed == "stop":
            with _stopped(standby.process.pid, fault.duration_s):
                pass
            return
        self._standby = None
        _signal(standby, fault.deed)
        standby.process.wait()
        time.sleep(_AGAIN_S)
        self._start_standby()

    def _harm_command(self, fault: Fault) -> None:
        command = self._command
        if command is None:
            return
        standby = self._standby
        begin_s = time.monotonic()
        if fault.deed == "restart":
            self._restart_in_order(command)
            return
        if fault.deed == "stop":
            with _stopped(command.process.pid, fault.duration_s):
                self._see_take_over(command, begin_s, fault.duration_s)
            if self._command is command:  # short, or without a standby
                if standby is not None:
                    self._see_late_take_over(command, begin_s)
                return
            self._wait_end_of_replaced(command)
            return
        pids = self._bridge_pids() if fault.part == "command and bridge" else []
        _signal(command, "kill")
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        command.process.wait()
        if pids and self._bridge is not None:
            self._bridge.process.wait()
            self._bridge = self._start("bridge")
        if standby is not None:
            self._see_take_over(command, begin_s, _TAKE_OVER_S)
        if self._command is command:
            if standby is not None:
                self.flight.problems.append(f"{standby.name} did not take over from {command.name}")
            self._command = self._start("command")
            self._wait_until_commands(self._command)
        if pids:
            self._wait_for_heartbeats(begin_s)

    def _restart_in_order(self, command: Node) -> None:
        """End command with Ctrl-C, which ends the standby, too; start both again."""
        begin_s = time.monotonic()
        command.process.send_signal(signal.SIGINT)
        command.process.wait(_START_S)
        standby, self._standby = self._standby, None
        if standby is not None:
            try:
                standby.process.wait(10.0)
            except subprocess.TimeoutExpired:
                self.flight.problems.append(f"{standby.name} goes on after {command.name} ended in order")
                standby.process.kill()
        self._command = self._start("command")
        self._wait_until_commands(self._command)
        self._wait_for_heartbeats(begin_s)  # none are due after an end in order
        self._start_standby()

    def _wait_until_commands(self, node: Node) -> None:
        with contextlib.suppress(AssertionError):
            self.run.until(node.name, lambda said: "MAVLink on" in said, _START_S)

    def _see_take_over(self, command: Node, begin_s: float, within_s: float) -> None:
        standby = self._standby
        while standby is not None and time.monotonic() < begin_s + within_s:
            if self._takes_over(standby):
                self.flight.take_over_s.append(time.monotonic() - begin_s)
                self._command, self._standby = standby, None
                return
            if standby.process.poll() is not None:
                self.flight.problems.append(f"{standby.name} ended while {command.name} was gone")
                self._standby = standby = None
            time.sleep(_POLL_S)

    def _see_late_take_over(self, command: Node, begin_s: float) -> None:
        """A stop as long as the lease: either goes on."""
        self._see_take_over(command, begin_s, time.monotonic() - begin_s + 2.0)
        if self._command is not command:
            self._wait_end_of_replaced(command)

    def _wait_end_of_replaced(self, command: Node) -> None:
        try:
            command.process.wait(20.0)
        except subprocess.TimeoutExpired:
            self.flight.problems.append(f"{command.name} goes on although it was replaced")

    # ------------------------------------------------------------ orders, end, heartbeats

    def _order(self, begin_s: float, number: int, at_s: float, vehicle: int, resumes_s: float) -> None:
        """Order a vehicle to hold, then to resume; an operator's program repeats what is not answered."""
        endpoints = f"{self.run.zenoh},{self.run.standby}"
        address = ServiceAddress("deterministic", endpoints, None)
        time.sleep(max(0.0, begin_s + at_s - time.monotonic()))
        for action in ("hold", "resume"):
            order = OrderMessage(
                order_id=f"chaos-{number}-{action}", action=action, vehicles=[vehicle], origin="chaos"
            )
            with contextlib.suppress(GcsError):
                for _ in send_order(address, order, 40.0, 40.0):
                    pass
            time.sleep(resumes_s)

    def _wait_for_end(self) -> None:
        deadline = time.monotonic() + MISSION_S / self._speed
        while time.monotonic() < deadline:
            if any("mission ended" in self.run.printed(node.name) for node in self.flight.nodes):
                return
            time.sleep(0.2)
            self._supervise()
        self.flight.problems.append("the mission did not end")

    def _measure_gaps(self, begin_s: float, end_s: float) -> None:
        flight = self.flight
        flight.all_gap_s = max(self.tap.gaps_s(begin_s, end_s), default=end_s - begin_s)
        free, at_s = [], begin_s
        for begin, end in sorted(self._outages):
            free.append((at_s, begin))
            at_s = max(at_s, end)
        free.append((at_s, end_s))
        flight.gap_s = max(
            (max(self.tap.gaps_s(begin, end), default=0.0) for begin, end in free if end > begin), default=0.0
        )

    def _end(self) -> None:
        """End all in order, command last, which shows that it can."""
        if self._standby is not None:
            self._standby.process.send_signal(signal.SIGINT)
        if self._command is not None:
            self._command.process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._command.process.wait(40.0)

    def close(self) -> None:
        """End what still runs."""
        self._observer.close()
        self.run.end()
        self.tap.end()
        for bridge in bridges(self.flight.folder):
            bridge.kill()


def _signal(node: Node, deed: Deed) -> None:
    if deed == "restart":
        node.process.send_signal(signal.SIGINT)
        return
    if node.process.poll() is None:
        node.ended_unix_s = time.time()
        node.process.kill()


@contextlib.contextmanager
def _stopped(pid: int, duration_s: float) -> Iterator[None]:
    """Stop a process for some time."""
    begin_s = time.monotonic()
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
        time.sleep(max(0.0, begin_s + duration_s - time.monotonic()))
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def fly_under(folder: Path, seed: int, speed: float, check: Callable[[Flight], None]) -> Flight:
    """Fly a run of a seed, and check it."""
    chaos = ChaosRun(folder, draw_schedule(seed), speed)
    try:
        flight = chaos.fly()
    finally:
        chaos.close()
    check(flight)
    return flight
