"""Simulated targets: double integrators without input, with constant velocity (paper, III).

Without acceleration the paper's 100 Hz integration has an exact closed form. Targets are reflected at the
border of the map; obstacles do not stop them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_vehicles.world.scenario import GaussianTargets, Scenario, generator

_DRAWS = 1000


@dataclass(frozen=True, slots=True)
class Target:
    """Position, velocity and appearance of one target."""

    id: int
    east_m: float
    north_m: float
    v_east_m_s: float
    v_north_m_s: float
    appears_s: float

    def position_m(self, t_s: float, width_m: float, height_m: float) -> tuple[float, float] | None:
        """Return east and north at scenario time `t_s`; None before it appears."""
        if t_s < self.appears_s:
            return None
        moved_s = t_s - self.appears_s
        return (
            _reflect(self.east_m + self.v_east_m_s * moved_s, width_m),
            _reflect(self.north_m + self.v_north_m_s * moved_s, height_m),
        )


def _reflect(x_m: float, size_m: float) -> float:
    """Reflect a coordinate into [0, size]."""
    x_m %= 2.0 * size_m
    return x_m if x_m <= size_m else 2.0 * size_m - x_m


def make_targets(scenario: Scenario, seed: int) -> list[Target]:
    """Return all targets of a scenario for a seed."""
    simulation = scenario.simulation
    drawn = simulation.gaussian_targets
    if drawn is None:
        return [
            Target(i, t.east_m, t.north_m, t.v_east_m_s, t.v_north_m_s, t.appears_s)
            for i, t in enumerate(simulation.targets)
        ]
    rng = generator(seed, "targets")
    area = scenario.config.map
    targets = []
    for i, birth in enumerate(scenario.config.births):
        place = rng.normal([birth.east_m, birth.north_m], birth.std_m)
        east, north = np.clip(place, 0.0, [area.width_m, area.height_m])
        v_east, v_north = _velocity(drawn, (float(east), float(north)), (area.width_m, area.height_m), rng)
        appears_s = round(float(rng.uniform(0.0, drawn.appear_by_s)), 2)
        targets.append(Target(i, float(east), float(north), v_east, v_north, appears_s))
    return targets


def _velocity(
    drawn: GaussianTargets,
    place_m: tuple[float, float],
    size_m: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Draw a velocity with which a target stays on the map long enough; zero if none is found."""
    for _ in range(_DRAWS):
        velocity = rng.normal(0.0, drawn.speed_std_m_s, 2)
        speed = float(np.hypot(*velocity))
        velocity *= min(1.0, drawn.max_speed_m_s / speed) if speed > 0.0 else 1.0
        end = place_m + velocity * drawn.inside_for_s
        if np.all(end >= 0.0) and np.all(end <= size_m):
            return float(velocity[0]), float(velocity[1])
    return 0.0, 0.0
