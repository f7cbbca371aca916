"""Track objects through clutter: detections in, labelled trajectories and their score out.

python examples/track_a_data_set.py [--scans 60]
"""

import argparse

import numpy as np

from gcs.tracking import GlmbParams, Sensor, TrackingModel, ospa, track

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--scans", type=int, default=60)
count = parser.parse_args().scans

# Two objects, seen once a second with probability 0.95 and an error of 5 m, among ten false detections.
rng = np.random.default_rng(1)
start = np.array([[-800.0, 0.0], [0.0, 800.0]])
velocity = np.array([[20.0, 3.0], [5.0, -20.0]])
truth = [start + k * velocity for k in range(count)]
scans = []
for places in truth:
    seen = places[rng.random(2) < 0.95]
    clutter = rng.uniform(-1000.0, 1000.0, (rng.poisson(10), 2))
    scans.append(np.vstack([rng.normal(seen, 5.0), clutter]))

# detection probability, false detections per m2, covariance of a detection, field of view
radar = Sensor("radar", 0.95, 10 / 2000**2, 5.0**2 * np.eye(2), (-1000.0, -1000.0, 1000.0, 1000.0))
model = TrackingModel(GlmbParams(accel_psd_m2_s3=1.0), births_per_s=0.2, birth_speed_std_m_s=20.0)
tracks = track(scans, np.arange(count), radar, model)

for one in tracks.trajectories:
    x, y = one.mean[-1, :2]
    print(f"{one.label}: {one.t_s[0]:.0f} s to {one.t_s[-1]:.0f} s, at the end {x:.0f} {y:.0f} m")
found = [np.reshape(list(at.values()), (-1, 2)) for at in tracks.positions_m()]
print(f"OSPA {np.mean([ospa(x, y).total_m for x, y in zip(found, truth, strict=True)]):.1f} m")
