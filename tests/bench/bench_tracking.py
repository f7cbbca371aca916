"""Tracker bench: milliseconds of CPU per scan at the sizes of a swarm, and start-up.

    python tests/bench/bench_tracking.py

How accurate it is: `bench_track.py`; against others: `bench_peers.py`; to 10,000 objects: `bench_scale.py`.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams, warm_up


def scan_times(n_objects: int, n_clutter: int, scans: int = 100, side_m: float = 6000.0) -> np.ndarray:
    """Milliseconds of each update and picture; births at the objects' first places at every scan."""
    rng = np.random.default_rng(7)
    sensor = Sensor("bench", 0.98, n_clutter / side_m**2, np.eye(2) * 10.0, (0.0, 0.0, side_m, side_m))
    state = np.column_stack(
        [rng.uniform(500, side_m - 500, (n_objects, 2)), rng.normal(0, 10, (n_objects, 2))]
    )
    births = [Birth(s * [1, 1, 0, 0], np.diag([100.0, 100.0, 100.0, 100.0]), 0.03) for s in state]
    tracker = Glmb("targets", GlmbParams(accel_psd_m2_s3=1.0), 1)
    times, errors = [], []
    for k in range(scans):
        seen = state[rng.random(n_objects) < 0.98, :2]
        z = np.vstack(
            [seen + rng.normal(0, 10**0.5, seen.shape), rng.uniform(0, side_m, (rng.poisson(n_clutter), 2))]
        )
        begin = time.process_time()
        tracker.update(k * NS_PER_S, rng.permutation(z), sensor, births)
        picture = tracker.picture(k * NS_PER_S)
        times.append((time.process_time() - begin) * 1e3)
        errors.append(float(picture.cardinality @ np.arange(picture.cardinality.size)) - n_objects)
        state[:, :2] += state[:, 2:]
    print(
        f"{n_objects:4d} objects {n_clutter:4d} clutter: mean {np.mean(times):6.2f}  "
        f"median {np.median(times):6.2f}  p95 {np.quantile(times, 0.95):6.2f}  max {np.max(times):6.2f} ms   "
        f"mean count error {np.mean(errors[2:]):+.3f}"
    )
    return np.array(times)


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.parse_args()
    begin = time.perf_counter()
    warm_up()
    print(f"warm-up {time.perf_counter() - begin:.2f} s")
    for n_objects, n_clutter in [(5, 25), (5, 200), (50, 30), (50, 200), (60, 200), (100, 60), (100, 200)]:
        scan_times(n_objects, n_clutter)


if __name__ == "__main__":
    main()
