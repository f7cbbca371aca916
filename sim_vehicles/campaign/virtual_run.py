"""Mission in one process on virtual time: no sockets, no sleep, the same outcome for the same seed.

The modules are those of a real-time run. MAVLink bytes pass between vehicles and central command in memory,
delayed by one step of 50 ms. Only the transport and the clock differ.
"""

from __future__ import annotations

import heapq
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gcs.core.engine import Engine
from gcs.core.snapshot import PeriodicSnapshots, decode_state, encode_state
from gcs.model import (
    NS_PER_S,
    Datagram,
    Effect,
    Event,
    MissionEnded,
    Order,
    Plan,
    Resumed,
    Scan,
    Send,
    Snapshot,
    Tick,
    Truth,
    TruthObject,
)
from sim_vehicles.vehicle.packet_loss import is_lost
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import Scenario, generator
from sim_vehicles.world.vehicle_specs import vehicle_specs
from sim_vehicles.world.world import World

STEP_NS = NS_PER_S // 20
START_T_NS = 1_767_225_600 * NS_PER_S
"""2026-01-01T00:00:00Z: virtual missions start then, so that equal seeds give equal recordings."""
LINK = "virtual"


@dataclass(slots=True)
class Timings:
    """CPU time of central command, for the summary."""

    scan_ms: list[float] = field(default_factory=list)
    plan_ms: list[float] = field(default_factory=list)


@dataclass(slots=True)
class VirtualRun:
    """One mission.

    Parameters
    ----------
    on_event, on_effect, on_truth, on_snapshot : callable, optional
        Called with each event, each effect, the ground truth at each scan, and a snapshot each 10 s.
    loss : float
        Probability that a datagram is lost, each way.
    kills : dict
        Vehicles whose process is killed: system id to seconds from the start.
    orders : sequence of Order
        An operator's orders, each at its time.
    tamper : callable, optional
        Hostile link: from run time, peer and bytes of a vehicle's datagram to the (peer, bytes) that arrive.
    """

    scenario: Scenario
    seed: int
    on_event: Callable[[Event], None] | None = None
    on_effect: Callable[[int, Effect], None] | None = None
    on_truth: Callable[[Truth], None] | None = None
    loss: float = 0.0
    kills: dict[int, float] = field(default_factory=dict)
    orders: Sequence[Order] = ()
    tamper: Callable[[int, str, bytes], Iterable[tuple[str, bytes]]] | None = None
    on_snapshot: Callable[[Snapshot], None] | None = None
    timings: Timings = field(default_factory=Timings)
    engine: Engine = field(init=False)
    vehicles: dict[str, SimVehicle] = field(init=False)
    t_ns: int = field(init=False, default=START_T_NS)
    ended: bool = field(init=False, default=False)
    _world: World = field(init=False)
    _scan_index: int = field(init=False, default=0)
    _orders: deque[Order] = field(init=False)
    _to_vehicles: deque[Send] = field(init=False, default_factory=deque)
    _published_t_ns: int = field(init=False, default=-1)
    _delayed: list[tuple[int, int, Scan]] = field(init=False, default_factory=list)
    """Scans that have not arrived: (arrival, number, scan)."""
    _loss_rng: np.random.Generator = field(init=False)
    _snapshots: PeriodicSnapshots = field(init=False, default_factory=PeriodicSnapshots)

    def __post_init__(self) -> None:
        config = self.scenario.config
        self._orders = deque(sorted(self.orders, key=lambda order: order.t_ns))
        self.engine = Engine(config, self.seed)
        self._world = World(self.scenario, self.seed, START_T_NS)
        self._loss_rng = generator(self.seed, "loss")
        self.vehicles = {
            f"vehicle:{spec.system_id}": SimVehicle(
                spec, self.scenario.frame, START_T_NS, elevation=config.elevation
            )
            for spec in vehicle_specs(self.scenario, self.seed)
        }

    def order(self, order: Order) -> None:
        """Add an operator's order, at its time or now."""
        self._orders = deque(sorted([*self._orders, order], key=lambda one: one.t_ns))

    def run(self, max_duration_s: float | None = None) -> float:
        """Fly until the mission or the time limit ends; return the run time in seconds."""
        limit_s = max_duration_s or self.scenario.config.mission.max_duration_s
        end_ns = START_T_NS + int(limit_s * NS_PER_S)
        while not self.ended and self.t_ns <= end_ns:
            self._move_vehicles()
            while self.t_ns >= self._world.scan_t_ns(self._scan_index):
                self._scan(self._scan_index)
                self._scan_index += 1
            while self._delayed and self._delayed[0][0] <= self.t_ns:
                arrival_t_ns, _, scan = heapq.heappop(self._delayed)
                self._step(replace(scan, t_ns=max(arrival_t_ns, scan.t_ns)))
            while self._orders and self._orders[0].t_ns <= self.t_ns:
                self._step(replace(self._orders.popleft(), t_ns=self.t_ns))
            self._step(Tick(self.t_ns))
            self.t_ns += STEP_NS
        return (self.t_ns - START_T_NS) / NS_PER_S

    def snapshot(self) -> Snapshot:
        """Return the state of central command now."""
        return Snapshot(self.t_ns, encode_state(self.engine.state))

    def restart(self, outage_s: float, snapshot: Snapshot | None = None) -> None:
        """Kill central command, fly on without it, and restart it from a snapshot."""
        snapshot = snapshot or self.snapshot()
        self._to_vehicles.clear()
        self._delayed.clear()
        end_ns = self.t_ns + int(outage_s * NS_PER_S)
        while self.t_ns < end_ns:
            for vehicle in self.vehicles.values():
                vehicle.advance(self.t_ns)
                vehicle.datagrams_to_send(self.t_ns)
            self.t_ns += STEP_NS
        while self._world.scan_t_ns(self._scan_index) < self.t_ns:
            self._scan_index += 1
        state = decode_state("snapshot", snapshot.data)
        self.engine = Engine(self.scenario.config, self.seed, state)
        self._step(Resumed(self.t_ns, snapshot.t_ns))

    def _move_vehicles(self) -> None:
        for _ in range(len(self._to_vehicles)):
            send = self._to_vehicles.popleft()
            vehicle = self.vehicles.get(send.peer)
            if vehicle is not None and not self._is_killed(vehicle):
                vehicle.receive_datagram(send.data, self.t_ns)
        for peer, vehicle in self.vehicles.items():
            if self._is_killed(vehicle):
                continue
            vehicle.advance(self.t_ns)
            for data in vehicle.datagrams_to_send(self.t_ns):
                if not is_lost(self.loss, self._loss_rng):
                    for sender, arrived in self._arriving(peer, data):
                        self._step(Datagram(self.t_ns, LINK, sender, arrived))

    def _arriving(self, peer: str, data: bytes) -> Iterable[tuple[str, bytes]]:
        return [(peer, data)] if self.tamper is None else self.tamper(self.t_ns, peer, data)

    def _is_killed(self, vehicle: SimVehicle) -> bool:
        at_s = self.kills.get(vehicle.system_id)
        return at_s is not None and self.t_ns >= START_T_NS + at_s * NS_PER_S

    def _scan(self, index: int) -> None:
        truth = self._world.truth(self._world.scan_t_ns(index), self._agents())
        if self.on_truth is not None and truth.t_ns > self._published_t_ns:
            self.on_truth(truth)
            self._published_t_ns = truth.t_ns
        scan = self._world.scan(index, truth)
        heapq.heappush(self._delayed, (self._world.arrival_t_ns(index), index, scan))

    def _agents(self) -> Iterable[TruthObject]:
        for vehicle in self.vehicles.values():
            alive = vehicle.alive and not self._is_killed(vehicle)
            place = vehicle.east_m, vehicle.north_m
            is_down = alive and vehicle.is_down
            yield TruthObject("agents", vehicle.system_id, *place, alive, is_down, vehicle.alt_msl_m)

    def _step(self, event: Event) -> None:
        snapshot = None if self.on_snapshot is None else self._snapshots.before(event, self.engine.state)
        if snapshot is not None and self.on_snapshot is not None:
            self.on_snapshot(snapshot)
        if self.on_event is not None:
            self.on_event(event)
        is_timed = not isinstance(event, Datagram)  # to read the clock costs more than most datagrams
        started = time.process_time() if is_timed else 0.0
        effects = self.engine.step(event)
        took_ms = (time.process_time() - started) * 1e3 if is_timed else 0.0
        if isinstance(event, Scan):
            self.timings.scan_ms.append(took_ms)
        for effect in effects:
            if isinstance(effect, Plan) and is_timed:
                self.timings.plan_ms.append(took_ms)
            elif isinstance(effect, Send) and not is_lost(self.loss, self._loss_rng):
                self._to_vehicles.append(effect)
            elif isinstance(effect, MissionEnded):
                self.ended = True
            if self.on_effect is not None:
                self.on_effect(self.t_ns, effect)
