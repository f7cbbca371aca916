"""Ground truth of a simulated world and its scans: no clock, no I/O."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from gcs.core.perception.terrain_sight import TARGET_HEIGHT_M
from gcs.model import NS_PER_S, Scan, Sensor, Truth, TruthObject
from sim_vehicles.world.scenario import Scenario
from sim_vehicles.world.sensor import TrueSight, make_sensors, observe
from sim_vehicles.world.targets import Target, make_targets

_MAX_SCANS_KEPT = 10_000
"""More than are delayed at a time."""


class _DueScan(NamedTuple):
    """Scan to be made, ordered by time."""

    t_ns: int
    sensor: int
    number: int
    """Number of this sensor's scans before."""


@dataclass(slots=True)
class World:
    """Targets and sensors of a scenario for one seed; true states of agents are arguments.

    The scans of all sensors are numbered in order of measurement; at one epoch, in order of the scenario.
    """

    scenario: Scenario
    seed: int
    start_t_ns: int
    moves_from_t_ns: int = -1
    """Time at which targets start to move and to appear; -1 for `start_t_ns`."""
    targets: list[Target] = field(init=False)
    sensors: list[Sensor] = field(init=False)
    _sights: list[TrueSight | None] = field(init=False)
    """What terrain does to each sensor's view; None for those that it does not hinder."""
    _scans: deque[_DueScan] = field(init=False, default_factory=lambda: deque(maxlen=_MAX_SCANS_KEPT))
    _scans_made: int = field(init=False, default=0)
    _next_scans: list[_DueScan] = field(init=False)

    def __post_init__(self) -> None:
        if self.moves_from_t_ns < 0:
            self.moves_from_t_ns = self.start_t_ns
        self.targets = make_targets(self.scenario, self.seed)
        self.sensors = make_sensors(self.scenario)
        self._sights = [self._sight(sensor) for sensor in self.sensors]
        self._next_scans = [self._due_scan(sensor, 0) for sensor in range(len(self.sensors))]

    def _sight(self, sensor: Sensor) -> TrueSight | None:
        elevation = self.scenario.config.elevation
        viewpoint = sensor.viewpoint
        return None if elevation is None or viewpoint is None else TrueSight(elevation, sensor, viewpoint)

    def _due_scan(self, sensor: int, count: int) -> _DueScan:
        table = self.scenario.sensors[sensor]
        t_ns = self.start_t_ns + round(table.offset_s * NS_PER_S) + count * round(table.period_s * NS_PER_S)
        return _DueScan(t_ns, sensor, count)

    def _numbered(self, index: int) -> _DueScan:
        while self._scans_made <= index:
            due = min(self._next_scans)
            self._next_scans[due.sensor] = self._due_scan(due.sensor, due.number + 1)
            self._scans.append(due)
            self._scans_made += 1
        return self._scans[index - self._scans_made]  # From the newest.

    def scan_t_ns(self, index: int) -> int:
        """Return the measurement time of scan `index`."""
        return self._numbered(index).t_ns

    def arrival_t_ns(self, index: int) -> int:
        """Return the time at which scan `index` is published, after its sensor's delay."""
        due = self._numbered(index)
        return due.t_ns + round(self.scenario.sensors[due.sensor].delay_s * NS_PER_S)

    def truth(self, t_ns: int, agents: Iterable[TruthObject]) -> Truth:
        """Return the ground truth at `t_ns`; a target that has not appeared is not alive."""
        area = self.scenario.config.map
        objects = sorted(agents, key=lambda agent: agent.id)
        for target in self.targets:
            moved_s = max(0, t_ns - self.moves_from_t_ns) / NS_PER_S
            place = target.position_m(moved_s, area.width_m, area.height_m)
            east, north = place or (target.east_m, target.north_m)
            alt_msl_m = self._target_alt_msl_m(east, north)
            objects.append(
                TruthObject("targets", target.id, east, north, place is not None, alt_msl_m=alt_msl_m)
            )
        return Truth(t_ns, tuple(objects))

    def _target_alt_msl_m(self, east_m: float, north_m: float) -> float | None:
        elevation = self.scenario.config.elevation
        return None if elevation is None else elevation.height_msl_m(east_m, north_m) + TARGET_HEIGHT_M

    def scan(self, index: int, truth: Truth) -> Scan:
        """Return the detections of a sensor at scan `index`."""
        due = self._numbered(index)
        sensor = self.sensors[due.sensor]
        purpose = f"scan {sensor.name}" if due.sensor else "scan"
        sight = self._sights[due.sensor]
        return observe(sensor, truth.objects, self.seed, due.number, truth.t_ns, purpose, sight)
