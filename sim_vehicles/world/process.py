"""Process of the world: receives true states of vehicles, publishes scans and ground truth on zenoh.

Vehicles send their true state ten times a second of run time (SYSTEM_TIME and SIM_STATE in one datagram).
At each scan time the world waits for the states of all living agents, interpolates, and publishes. An agent
without further states is lost, by the scenario or since its process was killed.

With `waits_for_ground` targets stand until a vehicle has ground contact, shown by a HEARTBEAT with its true
state. The line ``ready PORT`` has the port of the true states.
"""

from __future__ import annotations

import heapq
import os
import select
import socket
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.geo import LocalFrame
from gcs.io.clock import RunClock
from gcs.io.records import encode
from gcs.io.zenoh.key_expressions import scan_key, truth_key
from gcs.io.zenoh.scans import encode_scan
from gcs.io.zenoh.session import ZenohSession
from gcs.model import Scan, TruthObject
from sim_vehicles.autopilots.mission_protocol import NEVER_NS
from sim_vehicles.process_start import WorldArguments, await_clock, read_arguments
from sim_vehicles.world.scenario import Scenario, load
from sim_vehicles.world.world import World

_MAX_WAIT_S = 0.25
"""Wall time that a scan waits for an agent's state."""


@dataclass(slots=True)
class AgentTruth:
    """Newest true states of one agent."""

    states: list[tuple[int, float, float]]
    """(t_ns, east_m, north_m), oldest first; at first the scenario's start."""
    silent: bool = False
    """True after a wait without a newer state: scans do not wait for it."""
    down: bool = False
    """True if it came down elsewhere than by a landing of its mission."""

    def add(self, t_ns: int, east_m: float, north_m: float) -> None:
        """Add a state; ignore it if it is older than the newest."""
        if t_ns > self.states[-1][0]:
            self.states.append((t_ns, east_m, north_m))
            del self.states[:-40]
            self.silent = False

    def at(self, t_ns: int) -> tuple[float, float]:
        """Return east and north at `t_ns`, interpolated, and clamped to the known states."""
        previous = self.states[0]
        for state in self.states:
            if state[0] >= t_ns:
                span_ns = state[0] - previous[0]
                part = (t_ns - previous[0]) / span_ns if span_ns > 0 else 1.0
                east_m = previous[1] + part * (state[1] - previous[1])
                return east_m, previous[2] + part * (state[2] - previous[2])
            previous = state
        return previous[1], previous[2]


class TruthReceiver:
    """Receives the agents' true states on a UDP socket."""

    def __init__(self, scenario: Scenario) -> None:
        self._frame: LocalFrame = scenario.frame
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 1024 * 1024)
        self._socket.bind(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]
        self.ground_t_ns: int | None = None
        """Time when a vehicle first reported a ground station."""
        self.agents = {a.system_id: AgentTruth([(0, a.east_m, a.north_m)]) for a in scenario.config.agents}

    def wait(self, timeout_s: float) -> bool:
        """Receive for at most `timeout_s`; return True if standard input has closed."""
        readable, _, _ = select.select([self._socket, sys.stdin], [], [], max(0.0, timeout_s))
        if self._socket in readable:
            for data in self._datagrams():
                self._add_datagram(data)
        return sys.stdin in readable and not os.read(sys.stdin.fileno(), 1024)

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
        time_message, state = by_type.get("SYSTEM_TIME"), by_type.get("SIM_STATE")
        agent = self.agents.get(time_message.get_srcSystem()) if time_message is not None else None
        if time_message is None or agent is None:
            return
        if state is None:
            agent.silent = True  # Lost.
        else:
            place = self._frame.to_local(state.lat_int * 1e-7, state.lon_int * 1e-7)
            agent.add(time_message.time_unix_usec * 1000, *place)
            agent.down = "EXTENDED_SYS_STATE" in by_type
        if self.ground_t_ns is None and "HEARTBEAT" in by_type:
            self.ground_t_ns = time_message.time_unix_usec * 1000

    def agents_at(self, t_ns: int) -> list[TruthObject] | None:
        """Return all agents at `t_ns`; None while the state of a living one is missing."""
        if any(a.states[-1][0] < t_ns and not a.silent for a in self.agents.values()):
            return None
        return [
            TruthObject("agents", system_id, *agent.at(t_ns), agent.states[-1][0] >= t_ns, agent.down)
            for system_id, agent in self.agents.items()
        ]

    def give_up(self, t_ns: int) -> None:
        """Stop waiting for agents without a state since `t_ns`."""
        for agent in self.agents.values():
            agent.silent = agent.silent or agent.states[-1][0] < t_ns


def fly(world: World, receiver: TruthReceiver, bus: ZenohSession, clock: RunClock) -> None:
    """Publish scan after scan until standard input closes."""
    mission = world.scenario.config.name
    index, published_t_ns = 0, -1
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
        while (agents := receiver.agents_at(t_ns)) is None:
            left_s = give_up_s - time.monotonic()
            if left_s <= 0:
                receiver.give_up(t_ns)
            elif receiver.wait(left_s):
                return
        if receiver.ground_t_ns is not None:
            world.moves_from_t_ns = min(world.moves_from_t_ns, receiver.ground_t_ns)
        truth = world.truth(t_ns, agents)
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
    with ZenohSession(**{arguments.zenoh_role: arguments.zenoh}) as bus:
        clock = await_clock(f"ready {receiver.port}")
        if clock is not None:
            moves_from_t_ns = NEVER_NS if arguments.waits_for_ground else clock.start_t_ns
            fly(World(scenario, arguments.seed, clock.start_t_ns, moves_from_t_ns), receiver, bus, clock)


if __name__ == "__main__":
    main()
