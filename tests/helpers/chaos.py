"""Faults at random moments for command, its bridge, its standby and what is between them: real processes.

A schedule is drawn from a seed (`helpers.chaos_schedule`). Command and standby are started again by their
supervisors, and change places with each take-over; a bridge by itself is started again as a service manager
does it.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import psutil

from gcs.errors import GcsError
from gcs.io.zenoh.discovery import ServiceAddress
from gcs.io.zenoh.key_expressions import events_key, truth_key
from gcs.io.zenoh.order_client import send_order
from gcs.io.zenoh.order_messages import OrderMessage
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from helpers.chaos_schedule import PATHS, Deed, Fault, Schedule, draw_schedule
from helpers.chaos_surroundings import PROGRAM, Surroundings, full_disk, stopped
from helpers.heartbeat_tap import HeartbeatTap
from helpers.processes import Run, bridges, free_port, node_of

MISSION_S: Final = 400.0
"""Flight of `deterministic`, with time for what the faults cost, and for holds that wait."""
_POLL_S: Final = 0.02
_AGAIN_S: Final = 1.0
"""Until a bridge by itself that has ended is started again."""
_START_S: Final = 240.0
_TAKE_OVER_S: Final = 25.0
_SETTLE_S: Final = 5.0
_OUTAGE_S: Final = 60.0
"""For a bridge and a command to start on a busy machine."""
_HEAL_S: Final = 4.0
"""Time after a partition in which a node may still take over: what was late comes, and a lease ends."""


@dataclass(slots=True)
class Node:
    """A supervised process of command or of a standby, or a bridge by itself."""

    name: str
    role: str
    process: subprocess.Popen[bytes]
    ends_unix_s: list[float] = field(default_factory=list)
    """Times at which a recording may end before its last second: of each `kill -9` and each full disk."""
    take_overs: int = 0
    """Those that are noted."""

    @property
    def pid(self) -> int:
        """Process that does the work."""
        return self.process.pid if self.role == "bridge" else node_of(self.process).pid


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
    pictures: list[tuple[str, bytes]] = field(default_factory=list)
    """Pictures of all nodes, with their keys."""
    truths: list[bytes] = field(default_factory=list)
    begun_unix_s: list[float] = field(default_factory=list)
    """Beginning of each fault."""
    healed: list[tuple[str, float]] = field(default_factory=list)
    """Faults, and the Unix times of their ends."""
    scans_to_picture: list[int] = field(default_factory=list)
    """Scans from the end of each fault until the picture was right."""
    done: list[str] = field(default_factory=list)
    """Faults, with their times."""
    problems: list[str] = field(default_factory=list)
    uncompared: int = 0
    """Take-overs whose state could not be compared: the last events were recorded nowhere."""
    gap_s: float = 0.0
    """Longest time without a heartbeat at a vehicle, while a bridge ran and was not stopped."""
    all_gap_s: float = 0.0
    """With the time of a bridge that is stopped or starts, and of a radio that loses datagrams."""


class ChaosRun:
    """One run."""

    def __init__(self, folder: Path, schedule: Schedule, speed: float, seed: int = 1) -> None:
        relay = free_port()
        observer = free_endpoint()
        self.run = Run(folder, speed, relay, (observer,))
        self.tap = HeartbeatTap(relay, self.run.port, seed)
        threading.Thread(target=self._drain_world, daemon=True).start()
        self._schedule = schedule
        self._speed = speed
        epoch_ns = int(self.run.clock[1].partition(",")[0]) if self.run.clock else 0
        flight = self.flight = Flight(folder, self.tap, speed, epoch_ns)
        self._command: Node | None = None
        self._standby: Node | None = None
        self._bridge: Node | None = None
        self._observer = ZenohSession(listen=observer, connect=f"{self.run.zenoh},{self.run.standby}")
        self._observer.subscribe(events_key("deterministic"), lambda _, batch: flight.events.append(batch))
        self._observer.subscribe(truth_key("deterministic"), lambda _, truth: flight.truths.append(truth))
        for kind in ("agents", "targets"):
            key = f"swarm/deterministic/picture/{kind}"
            self._observer.subscribe(key, lambda key, picture: flight.pictures.append((key, picture)))
        self._outages: list[tuple[float, float]] = []
        """Monotonic times without a bridge."""
        text = self.run.file.read_text()
        links = f'[links]\nfailover_s = {30.0 * speed}\nstandby = "{self.run.standby}"'
        text = text.replace("[links]", links, 1)
        bridge = free_endpoint() if schedule.is_bridge_alone else ""
        if bridge:
            text += f'\n[[links.bridges]]\nname = "main"\nzenoh = "{bridge}"\n'
        self.run.file.write_text(text)
        self._around = Surroundings(folder, self.run.zenoh, self.run.standby, bridge, self.tap, seed)

    def _drain_world(self) -> None:
        assert self.run.world.stdout is not None
        for _ in self.run.world.stdout:
            pass

    # ------------------------------------------------------------ processes

    def _start(self, role: str) -> Node:
        name = f"{role}-of-{1 + len(self.flight.nodes)}"
        arguments = () if role == "service" else ("--role", role)
        environment = {"XDG_RUNTIME_DIR": str(self.flight.folder), **self._around.environment(_place(role))}
        node = Node(name, role, self.run.serve(name, environment, arguments, program=PROGRAM))
        self.flight.nodes.append(node)
        return node

    def fly(self) -> Flight:
        """Fly a mission under the faults."""
        if self._schedule.is_bridge_alone:
            self._bridge = self._start("bridge")
            self.run.until(self._bridge.name, lambda said: "command connects to" in said, _START_S)
        self._command = self._start("service")
        self.run.until(self._command.name, lambda said: said.count("verified by read-back") >= 4, _START_S)
        self._standby = self._start("standby")
        self._wait_for_standby()
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

    def _wait_for_standby(self) -> None:
        """Wait until the standby has the state of command."""
        standby = self._standby
        assert standby is not None
        with contextlib.suppress(AssertionError):
            self.run.until(standby.name, _follows, _START_S)
            return
        self._problem(f"{standby.name} does not follow: {self._printed(standby)[-300:]}")

    def _printed(self, node: Node) -> str:
        return self.run.printed(node.name)

    def _problem(self, text: str) -> None:
        self.flight.problems.append(text)

    def _wait_until(self, until_s: float) -> None:
        while (left_s := until_s - time.monotonic()) > 0.0:
            time.sleep(min(left_s, 0.2))
            self._supervise()

    def _supervise(self) -> None:
        """Note an unexpected take-over, and a node that was given up."""
        if self._swap():
            assert self._command is not None
            self._problem(f"{self._command.name} took over from a command that was not disturbed")
        for node in (self._command, self._standby):
            if node is not None and node.process.poll() is not None:
                self._problem(f"{node.name} ended: {self._printed(node)[-300:]}")
                self._restart_both()
                return

    def _restart_both(self) -> None:
        """Start both nodes again, after an end in order or an unexpected one."""
        for node in (self._command, self._standby):
            if node is not None and node.process.poll() is None:
                node.process.kill()
                node.process.wait()
        command = self._command = self._start("service")
        until_s = time.monotonic() + _START_S
        while "MAVLink on" not in self._printed(command) and time.monotonic() < until_s:
            assert command.process.poll() is None, self._printed(command)[-300:]
            time.sleep(_POLL_S)
        self._standby = self._start("standby")
        self._wait_for_standby()

    def _swap(self) -> bool:
        """Let command and standby change places if the standby has taken over; return True if it has."""
        standby = self._standby
        if standby is None or self._printed(standby).count("takes over") <= standby.take_overs:
            return False
        standby.take_overs += 1
        self._command, self._standby = standby, self._command
        return True

    # ------------------------------------------------------------ faults

    def _inflict(self, fault: Fault) -> None:
        self._supervise()
        self.flight.done.append(str(fault))
        assert self._command is not None
        if fault.part == "radio":
            begin_s = time.monotonic()
            self._outages.append((begin_s, begin_s + fault.duration_s))
            self._around.harm_radio(fault)
            return
        self._wait_for_standby()
        self.flight.begun_unix_s.append(time.time())
        if fault.part == "bridge":
            self._harm_bridge(fault)
        elif fault.part == "standby":
            self._harm_standby(fault)
        elif fault.part in PATHS:
            self._harm_paths(fault)
        elif fault.part in ("command", "command and bridge"):
            self._harm_command(fault)
        else:
            self._harm_surroundings(fault)
        self.flight.healed.append((str(fault), time.time()))

    def _bridge_pids(self) -> list[int]:
        if self._bridge is not None:
            return [self._bridge.pid]
        return [bridge.pid for bridge in bridges(self.flight.folder)]

    def _harm_bridge(self, fault: Fault) -> None:
        begin_s = time.monotonic()
        for pid in self._bridge_pids():
            if fault.deed == "stop":
                with stopped(pid, fault.duration_s):
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
        self._problem(f"no heartbeats {_OUTAGE_S:g} s after the bridge was disturbed")

    def _harm_standby(self, fault: Fault) -> None:
        standby = self._standby
        assert standby is not None
        if fault.deed == "stop":
            with stopped(standby.pid, fault.duration_s):
                pass
            return
        _end_node(standby, fault.deed)
        if fault.deed == "restart":
            standby.process.wait()
            self._standby = self._start(standby.role)  # at the same endpoint
        else:
            self.run.until(standby.name, lambda said: not _follows(said))

    def _harm_paths(self, fault: Fault) -> None:
        """Cut or slow paths; command and standby may change places, unless the standby alone was cut off."""
        assert self._command is not None
        command = self._command
        begin_s = time.monotonic()
        paths = self._around.harm_paths(fault.part, fault.deed, _place(command.role))
        while time.monotonic() < begin_s + fault.duration_s:
            self._swap()
            time.sleep(_POLL_S)
        for path in paths:
            path.heal()
        self._see_take_over(command, time.monotonic(), _HEAL_S, notes=False)
        if self._command is command:
            return
        if fault.part == "standby to all":
            self._problem(f"{self._command.name} took over although it was cut off")
        self._wait_until_replaced(command)

    def _harm_surroundings(self, fault: Fault) -> None:
        assert self._command is not None
        assert self._standby is not None
        command = self._command
        if fault.deed == "step":
            node = command if fault.part == "clock of command" else self._standby
            self._around.step_clock(_place(node.role), fault.step_s)
            return
        if fault.deed == "fill":
            command.ends_unix_s.append(time.time())
            newest = max(recordings_of(self.flight.folder, command), key=os.path.getmtime)
            harm = full_disk(psutil.Process(command.pid), newest)
        else:
            harm = self._around.stalled_reader() if fault.deed == "stall" else self._around.flood()
        with harm:
            self._wait_until(time.monotonic() + fault.duration_s)

    def _harm_command(self, fault: Fault) -> None:
        command = self._command
        assert command is not None
        begin_s = time.monotonic()
        if fault.deed == "restart":
            self._restart_in_order(command)
            return
        if fault.deed == "stop":
            with stopped(command.pid, fault.duration_s):
                self._see_take_over(command, begin_s, fault.duration_s)
            if self._command is command:  # a stop as long as the lease: either goes on
                self._see_take_over(command, begin_s, time.monotonic() - begin_s + 2.0)
            if self._command is not command:
                self._wait_until_replaced(command)
            return
        pids = self._bridge_pids() if fault.part == "command and bridge" else []
        _end_node(command, "kill")
        begin_s = time.monotonic()
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        if pids and self._bridge is not None:
            self._bridge.process.wait()
            self._bridge = self._start("bridge")
        self._see_take_over(command, begin_s, _TAKE_OVER_S)
        if self._command is command:
            self._problem(f"no standby took over from {command.name}")
        if pids:
            self._wait_for_heartbeats(begin_s)

    def _restart_in_order(self, command: Node) -> None:
        """End command with Ctrl-C, which ends the standby, too; start both again."""
        begin_s = time.monotonic()
        command.process.send_signal(signal.SIGINT)
        command.process.wait(_START_S)
        standby = self._standby
        assert standby is not None
        try:
            standby.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._problem(f"{standby.name} goes on after {command.name} ended in order")
        self._restart_both()
        self._wait_for_heartbeats(begin_s)  # none are due after an end in order

    def _see_take_over(self, command: Node, begin_s: float, within_s: float, *, notes: bool = True) -> None:
        while self._command is command and time.monotonic() < begin_s + within_s:
            if self._swap() and notes:
                self.flight.take_over_s.append(time.monotonic() - begin_s)
            time.sleep(_POLL_S)

    def _wait_until_replaced(self, command: Node) -> None:
        """Wait until a command that another node has replaced follows it.

        The other one follows if it was too late with its lease, and the command before it got it again.
        """
        other = self._command
        assert other is not None
        until_s = time.monotonic() + _START_S
        while time.monotonic() < until_s:
            if _follows(self._printed(command)):
                return
            if _follows(self._printed(other)):
                self._command, self._standby = command, other
                return
            time.sleep(_POLL_S)
        self._problem(f"{command.name} does not follow the node that replaced it")

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
                for _ in send_order(address, order, self._schedule.answer_s, self._schedule.answer_s):
                    pass
            time.sleep(resumes_s)

    def _wait_for_end(self) -> None:
        deadline = time.monotonic() + MISSION_S / self._speed
        while time.monotonic() < deadline:
            if any("mission ended" in self._printed(node) for node in self.flight.nodes):
                return
            time.sleep(0.2)
            self._supervise()
        self._problem("the mission did not end")

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
        for node in (self._standby, self._command):
            if node is not None:
                node.process.send_signal(signal.SIGINT)
        if self._command is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._command.process.wait(40.0)

    def close(self) -> None:
        """End what still runs."""
        self._observer.close()
        self.run.end()
        self.tap.end()
        self._around.close()
        for bridge in bridges(self.flight.folder):
            bridge.kill()


def recordings_of(folder: Path, node: Node) -> list[Path]:
    """Return the folders of a node's recordings, one for each start."""
    return [*folder.glob(node.name), *folder.glob(f"{node.name}-[0-9]*")]


def _place(role: str) -> str:
    """Return the place of a node among the paths: it stays when command and standby change their duties."""
    return {"service": "one", "standby": "two"}.get(role, "bridge")


def _follows(said: str) -> bool:
    """Return True if a node said at last that it follows command."""
    others = ("this node ended", "asks for the state", "takes over")
    return said.rfind("follows it") > max(map(said.rfind, others))


def _end_node(node: Node, deed: Deed) -> None:
    if deed == "restart":
        node.process.send_signal(signal.SIGINT)
        return
    process = psutil.Process(node.pid)
    node.ends_unix_s.append(time.time())
    process.kill()


def fly_under(folder: Path, seed: int, speed: float, check: Callable[[Flight], None]) -> Flight:
    """Fly a run of a seed, and check it."""
    chaos = ChaosRun(folder, draw_schedule(seed), speed, seed)
    try:
        flight = chaos.fly()
    finally:
        chaos.close()
    check(flight)
    return flight
