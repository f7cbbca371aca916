"""The world's sensor: truth and a random generator in, one scan out.

Each object inside the field of view is detected with probability p_D at its position plus Gaussian noise.
Clutter is Poisson in number and uniform over the field of view. All points come in random order and without
identity: the standard multi-object observation model (Vo & Vo 2013, section III-C).

Every scan has a generator of its own, and draws for every object whether or not it is there, so that one
agent's death does not change what is seen of the others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs.model import Scan, Sensor, TruthObject, read_only
from sim_vehicles.scenario import Scenario, generator


def make_sensor(scenario: Scenario) -> Sensor:
    """What the scenario's sensor announces of itself: the truth, as a calibrated sensor would."""
    table, area = scenario.simulation.sensor, scenario.config.map
    margin = table.field_margin_m
    field = (-margin, -margin, area.width_m + margin, area.height_m + margin)
    return Sensor(
        name=table.name,
        detection_probability=table.detection_probability,
        clutter_density_per_m2=table.clutter_per_scan / _area_m2(field),
        noise_cov_m2=read_only(np.eye(2) * table.noise_std_m**2),
        field_of_view_m=field,
    )


def observe(sensor: Sensor, objects: Sequence[TruthObject], seed: int, scan_index: int, t_ns: int) -> Scan:
    """One scan of `objects` at `t_ns`. `objects` lists everything, the dead with alive False."""
    rng = generator(seed, "scan", scan_index)
    east_min, north_min, east_max, north_max = sensor.field_of_view_m
    std = np.sqrt(np.diag(sensor.noise_cov_m2))
    seen = []
    for thing in objects:
        detected = rng.random() < sensor.detection_probability
        point = np.array([thing.east_m, thing.north_m]) + std * rng.standard_normal(2)
        inside = east_min <= thing.east_m <= east_max and north_min <= thing.north_m <= north_max
        if detected and thing.alive and inside:
            seen.append(point)
    clutter = rng.poisson(sensor.clutter_density_per_m2 * _area_m2(sensor.field_of_view_m))
    points = np.concatenate(
        [np.reshape(seen, (-1, 2)), rng.uniform([east_min, north_min], [east_max, north_max], (clutter, 2))]
    )
    return Scan(t_ns, t_ns, sensor, read_only(rng.permutation(points)))


def _area_m2(field: tuple[float, float, float, float]) -> float:
    east_min, north_min, east_max, north_max = field
    return (east_max - east_min) * (north_max - north_min)
