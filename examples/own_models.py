"""Track in three dimensions with a model of your own: a radar of range, azimuth, elevation and range rate.

python examples/own_models.py
"""

import numpy as np

from gcs.tracking import GlmbParams, MeasurementModel, TrackingModel, constant_velocity, ospa, track


def expected(states):
    """Return what the radar measures (n, 4) of states x, y, z, vx, vy, vz (n, 6)."""
    reach = np.linalg.norm(states[:, :3], axis=1)
    x, y, z = (states[:, :3] / reach[:, None]).T
    return np.column_stack([reach, np.arctan2(x, y), np.arcsin(z), (states[:, 3:].T * [x, y, z]).sum(axis=0)])


def birth(z):
    """Return the Gaussian, (6,) and (6, 6), of an object that was detected for the first time."""
    along = np.array([np.sin(z[1]) * np.cos(z[2]), np.cos(z[1]) * np.cos(z[2]), np.sin(z[2])])
    return np.concatenate([z[0] * along, z[3] * along]), np.diag([400.0] * 3 + [900.0] * 3)


# detection probability, false detections of a scan per unit of z, h(x), R; angles are wrapped
rng, std = np.random.default_rng(1), np.array([5.0, 0.005, 0.005, 0.5])
low, high = np.array([100.0, -np.pi, 0.0, -60.0]), np.array([3000.0, np.pi, 0.5, 60.0])
density = 20 / np.prod(high - low)
radar = MeasurementModel("radar", 0.9, density, expected, np.diag(std**2), angles=(1, 2), birth=birth)
state = np.array([[-800.0, 600.0, 200.0, 30.0, 0.0, 2.0], [700.0, 900.0, 400.0, -25.0, -10.0, 0.0]])
scans, truth = [], []
for _ in range(40):
    z = expected(state[rng.random(2) < 0.9])
    scans.append(np.vstack([rng.normal(z, std), rng.uniform(low, high, (rng.poisson(20), 4))]))
    truth.append(state[:, :3].copy())
    state[:, :3] += state[:, 3:]
model = TrackingModel(GlmbParams(0.0), births_per_s=0.1, motion=constant_velocity(3, 1.0))
tracks = track(scans, np.arange(40), radar, model)
found = [np.array(list(at.values())) for at in tracks.positions_m()]
error_m = np.mean([ospa(x, y).total_m for x, y in zip(found, truth, strict=True)])
print(f"{len(tracks)} trajectories of {', '.join(tracks.names)}, OSPA {error_m:.1f} m")
