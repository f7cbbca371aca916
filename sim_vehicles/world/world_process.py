"""Process of the world: receives true states of vehicles, publishes scans and ground truth on zenoh.

Vehicles send their true state ten times a second of run time (SYSTEM_TIME and SIM_STATE in one datagram).
At each scan time the world waits for the states of all living agents, interpolates, and publishes. An agent
is lost when it says so, by the scenario, when its process has ended (a line on standard input), or when
nothing comes from it for some seconds. On a busy machine states come late: such an agent lives on, its
position is extrapolated, and the ground truth names it.

With `waits_for_ground` targets stand until a vehicle has ground contact, shown by a HEARTBEAT with its true
state. The line ``ready PORT`` has the port of the true states.
"""

from __future__ import annotations

import heapq
import math
import os
import select
import socket
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.geo import LocalFrame
from gcs.io.clock import RunClock
from gcs.io.record_json import encode
from gcs.io.zenoh.key_expressions import scan_key, truth_key
from gcs.io.zenoh.scans import encode_scan
from gcs.io.zenoh.session import ZenohSession
from gcs.model import Scan, TruthObject
from sim_vehicles.autopilots.mission_protocol import NEVER_NS
from sim_vehicles.process_start import WorldArguments, await_start, read_arguments
from sim_vehicles.world.scenario import Scenario, load
from sim_vehicles.world.world import World

_MAX_WAIT_S = 0.25
"""Wall time that a scan waits for an agent's state."""
_SILENT_S = 5.0
"""Wall time without any state after which an agent is lost."""


@dataclass(slots=True)
class AgentTruth:
    """Newest true states of one agent."""

    states: list[tuple[int, float, float, float]]
    """(t_ns, east_m, north_m, alt_msl_m), oldest first; at first the scenario's start."""
    heard_s: float = -math.inf
    """Wall time of the last state."""
    waited_t_ns: int = -1
    """Time of the last scan that could not wait any longer for a state."""
    late_t_ns: int = -1
    """The same of a living agent; -1 once its state of that time has come."""
    is_lost: bool = False
    """True after its own report of its loss, or the end of its process."""
    down: bool = False
    """True if it came down elsewhere than by a landing of its mission."""

    def add(self, t_ns: int, east_m: float, north_m: float, alt_msl_m: float, now_s: float) -> None:
        """Add a state; ignore it if it is older than the newest."""
        self.heard_s = now_s
        if t_ns > self.states[-1][0]:
            self.states.append((t_ns, east_m, north_m, alt_msl_m))
            del self.states[:-40]

    def is_known(self, t_ns: int) -> bool:
        """Return True if there is a state of that time or later."""
        return self.states[-1][0] >= t_ns

    def is_missing(self, t_ns: int) -> bool:
        """Return True if a scan should wait for a state: it lives, and was not late at the last scan."""
        was_late = self.waited_t_ns > self.states[-1][0]
        return not (self.is_known(t_ns) or self.is_lost or was_late)

    def is_late(self, t_ns: int, now_s: float) -> bool:
        """Return True if it lives, and has sent no state of that time yet."""
        return not (self.is_known(t_ns) or self.is_lost) and now_s - self.heard_s <= _SILENT_S

    def at(self, t_ns: int, *, extrapolates: bool = False) -> tuple[float, float, float]:
        """Return east, north and height at `t_ns`, interpolated; beyond the newest state it, or onward."""
        later = next((n for n, state in enumerate(self.states) if state[0] >= t_ns), len(self.states))
        if later == 0 or (later == len(self.states) and not (extrapolates and later > 1)):
            return self.states[min(later, len(self.states) - 1)][1:]
        later = min(later, len(self.states) - 1)
        t0_ns, *before = self.states[later - 1]
        t1_ns, *after = self.states[later]
        part = (t_ns - t0_ns) / (t1_ns - t0_ns)
        east_m, north_m, alt_msl_m = (b + part * (a - b) for b, a in zip(before, after, strict=True))
        return east_m, north_m, alt_msl_m


class TruthReceiver:
    """Receives the agents' true states on a UDP socket."""

    def __init__(self, scenario: Scenario) -> None:
        self._frame: LocalFrame = scenario.frame
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 1024 * 1024)
        self._socket.bind(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]
        self._input = b""
        self.ground_t_ns: int | None = None
        """Time when a vehicle first reported a ground station."""
        self.agents = {
            a.system_id: AgentTruth([(0, a.east_m, a.north_m, math.nan)]) for a in scenario.config.agents
        }

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def wait(self, timeout_s: float) -> bool:
        """Receive for at most `timeout_s`; return True if standard input has closed."""
        readable, _, _ = select.select([self._socket, sys.stdin], [], [], max(0.0, timeout_s))
        if self._socket in readable:
            for data in self._datagrams():
                self._add_datagram(data)
        return sys.stdin in readable and not self.add_input(os.read(sys.stdin.fileno(), 1024))

    def add_input(self, data: bytes) -> bool:
        """Note the ends of processes, one list of system ids a line; return False at the end of the input."""
        *lines, self._input = (self._input + data).split(b"\n")
        for line in lines:
            for system_id in msgspec.json.decode(line, type=list[int]):
                self.agents[system_id].is_lost = True
        return bool(data)

    def _datagrams(self) -> Iterator[bytes]:
        while True:
            try:
                yield self._socket.recv(2048)
            except (BlockingIOError, ConnectionError):
                return

    def _add_datagram(self, data: bytes) -> None:
        try:
            messages = mavlink.MAVLink(None).parse_buffer(bytearray(data)) or []
        except mavlink.MAVError:
            return
        by_type = {message.get_type(): message for message in messages}
        time_message = by_type.get("SYSTEM_TIME")
        state = by_type.get("SIM_STATE")
        agent = self.agents.get(time_message.get_srcSystem()) if time_message is not None else None
        if time_message is None or agent is None:
            return
        if state is None:
            agent.is_lost = True
        else:
            place = self._frame.to_local(state.lat_int * 1e-7, state.lon_int * 1e-7)
            agent.add(time_message.time_unix_usec * 1000, *place, state.alt, time.monotonic())
            agent.down = "EXTENDED_SYS_STATE" in by_type
        if self.ground_t_ns is None and "HEARTBEAT" in by_type:
            self.ground_t_ns = time_message.time_unix_usec * 1000

    def agents_at(self, t_ns: int, now_s: float) -> list[TruthObject] | None:
        """Return all agents at `t_ns`; None while a scan should wait for the state of one."""
        if any(agent.is_missing(t_ns) for agent in self.agents.values()):
            return None
        found = []
        for system_id, agent in self.agents.items():
            is_late = agent.is_late(t_ns, now_s)
            east_m, north_m, alt_msl_m = agent.at(t_ns, extrapolates=is_late)
            alive = is_late or agent.is_known(t_ns)
            alt = None if math.isnan(alt_msl_m) else alt_msl_m
            found.append(TruthObject("agents", system_id, east_m, north_m, alive, agent.down, alt))
        return found

    def give_up(self, t_ns: int, now_s: float) -> None:
        """Stop waiting for agents without a state since `t_ns`."""
        for agent in self.agents.values():
            if not agent.is_known(t_ns):
                agent.waited_t_ns = t_ns
                agent.late_t_ns = t_ns if agent.is_late(t_ns, now_s) else agent.late_t_ns

    def caught_up(self) -> tuple[int, ...]:
        """Return, once, the agents whose states came after the scans that waited for them."""
        late = []
        for system_id, agent in self.agents.items():
            if -1 < agent.late_t_ns <= agent.states[-1][0]:
                late.append(system_id)
                agent.late_t_ns = -1
        return tuple(late)


def fly(world: World, receiver: TruthReceiver, bus: ZenohSession, clock: RunClock) -> None:
    """Publish scan after scan until standard input closes."""
    mission = world.scenario.config.name
    index = 0
    published_t_ns = -1
    delayed: list[tuple[int, int, Scan]] = []
    while True:
        t_ns = world.scan_t_ns(index)
        while (wait_s := clock.wall_s_until(min(t_ns, delayed[0][0] if delayed else t_ns))) > 0:
            if receiver.wait(wait_s):
                return
        if delayed and delayed[0][0] <= t_ns:
            scan = heapq.heappop(delayed)[-1]
            bus.publish(scan_key(mission, scan.sensor.name), encode_scan(scan, world.scenario.frame))
            continue
        give_up_s = time.monotonic() + _MAX_WAIT_S
        while (agents := receiver.agents_at(t_ns, time.monotonic())) is None:
            left_s = give_up_s - time.monotonic()
            if left_s <= 0:
                receiver.give_up(t_ns, time.monotonic())
            elif receiver.wait(left_s):
                return
        if receiver.ground_t_ns is not None:
            world.moves_from_t_ns = min(world.moves_from_t_ns, receiver.ground_t_ns)
        truth = replace(world.truth(t_ns, agents), late=receiver.caught_up())
        if t_ns > published_t_ns:
            bus.publish(truth_key(mission), encode(truth))
            published_t_ns = t_ns
        heapq.heappush(delayed, (world.arrival_t_ns(index), index, world.scan(index, truth)))
        index += 1


def main() -> None:
    """Run the world until standard input closes."""
    arguments = read_arguments(WorldArguments)
    scenario = load(arguments.scenario)
    receiver = TruthReceiver(scenario)
    tls = Path(arguments.zenoh_tls) if arguments.zenoh_tls else None
    with ZenohSession(**{arguments.zenoh_role: arguments.zenoh}, tls=tls) as bus:
        start = await_start(f"ready {receiver.port}")
        if start is not None:
            moves_from_t_ns = NEVER_NS if arguments.waits_for_ground else start.start_t_ns
            world = World(scenario, arguments.seed, start.start_t_ns, moves_from_t_ns)
            fly(world, receiver, bus, start.clock)


if __name__ == "__main__":
    main()
