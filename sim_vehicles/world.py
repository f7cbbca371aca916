"""The truth of a simulated world and the scans made of it: pure, shared by processes and virtual time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from gcs.model import NS_PER_S, Scan, Sensor, Truth, TruthObject
from sim_vehicles.scenario import Scenario
from sim_vehicles.sensor import make_sensor, observe
from sim_vehicles.targets import Target, make_targets


@dataclass(slots=True)
class World:
    """Targets and the sensor of a scenario for one seed; the agents' true states come from outside."""

    scenario: Scenario
    seed: int
    start_t_ns: int
    targets: list[Target] = field(init=False)
    sensor: Sensor = field(init=False)
    period_ns: int = field(init=False)

    def __post_init__(self) -> None:
        self.targets = make_targets(self.scenario, self.seed)
        self.sensor = make_sensor(self.scenario)
        self.period_ns = round(self.scenario.simulation.sensor.period_s * NS_PER_S)

    def scan_t_ns(self, index: int) -> int:
        """When scan `index` is measured."""
        return self.start_t_ns + index * self.period_ns

    def truth(self, t_ns: int, agents: Iterable[TruthObject]) -> Truth:
        """Everything there is at `t_ns`; a target that has not appeared yet is not alive."""
        area = self.scenario.config.map
        objects = sorted(agents, key=lambda agent: agent.id)
        for target in self.targets:
            place = target.position_m((t_ns - self.start_t_ns) / NS_PER_S, area.width_m, area.height_m)
            east, north = place or (target.east_m, target.north_m)
            objects.append(TruthObject("targets", target.id, east, north, place is not None))
        return Truth(t_ns, tuple(objects))

    def scan(self, index: int, truth: Truth) -> Scan:
        """What the sensor sees of the truth at scan `index`."""
        return observe(self.sensor, truth.objects, self.seed, index, truth.t_ns)
