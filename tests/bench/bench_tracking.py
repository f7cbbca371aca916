"""Tracker bench: milliseconds per scan by size, start-up, and accuracy on the standard linear-Gaussian sets.

    python tests/bench/bench_tracking.py [--data DIR]

DIR holds `vo_linear_gaussian/*.npz` or is that folder. Parameters come from the files' own model, never from
`truth` or `src`. Estimator for the scores: `Glmb.estimate`, filtered (nothing is re-estimated later).
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb import Birth, Glmb, GlmbParams, warm_up
from gcs.tracking.metrics import gospa, ospa, ospa2

WINDOW = 10


def scan_times(n_objects: int, n_clutter: int, scans: int = 100, side_m: float = 6000.0) -> np.ndarray:
    """Milliseconds of each update and picture; births at the objects' first places at every scan."""
    rng = np.random.default_rng(7)
    sensor = Sensor("bench", 0.98, n_clutter / side_m**2, np.eye(2) * 10.0, (0.0, 0.0, side_m, side_m))
    state = np.column_stack(
        [rng.uniform(500, side_m - 500, (n_objects, 2)), rng.normal(0, 10, (n_objects, 2))]
    )
    births = [Birth(s * [1, 1, 0, 0], np.diag([100.0, 100.0, 100.0, 100.0]), 0.03) for s in state]
    tracker = Glmb("targets", GlmbParams(accel_std_m_s2=1.0), 1)
    times, errors = [], []
    for k in range(scans):
        seen = state[rng.random(n_objects) < 0.98, :2]
        z = np.vstack(
            [seen + rng.normal(0, 10**0.5, seen.shape), rng.uniform(0, side_m, (rng.poisson(n_clutter), 2))]
        )
        begin = time.perf_counter()
        tracker.update(k * NS_PER_S, rng.permutation(z), sensor, births)
        picture = tracker.picture(k * NS_PER_S)
        times.append((time.perf_counter() - begin) * 1e3)
        errors.append(float(picture.cardinality @ np.arange(picture.cardinality.size)) - n_objects)
        state[:, :2] += state[:, 2:]
    print(
        f"{n_objects:4d} objects {n_clutter:4d} clutter: mean {np.mean(times):6.2f}  "
        f"median {np.median(times):6.2f}  p95 {np.quantile(times, 0.95):6.2f}  max {np.max(times):6.2f} ms   "
        f"mean count error {np.mean(errors[2:]):+.3f}"
    )
    return np.array(times)


def score(path: Path, params: dict[str, float]) -> list[float]:
    """OSPA, its localisation part, OSPA(2), GOSPA, count error, ms per scan of one set."""
    data = np.load(path)
    (east_min, east_max), (north_min, north_max) = data["region"]
    area = (east_max - east_min) * (north_max - north_min)
    sensor = Sensor(
        "set", float(data["pD"]), float(data["lambda_c"]) / area, np.eye(2) * float(data["sigma_z"]) ** 2,
        (east_min, north_min, east_max, north_max),
    )  # fmt: skip
    order = [0, 2, 1, 3]
    cov = np.diag(data["birth_std"][order] ** 2)
    births = [Birth(mean[order], cov, float(data["r_birth"])) for mean in data["birth_mean"]]
    tracker = Glmb(
        "targets",
        GlmbParams(
            accel_std_m_s2=float(data["sigma_v"]), survival_probability_per_s=float(data["pS"]), **params
        ),
        1,
    )
    rows, true, found = [], [], []
    for k in range(1, int(data["K"]) + 1):
        z = data["meas"][data["meas"][:, 0] == k, 1:3]
        begin = time.perf_counter()
        tracker.update(k * NS_PER_S, z, sensor, births)
        tracker.picture(k * NS_PER_S)
        spent = (time.perf_counter() - begin) * 1e3
        now = data["truth"][data["truth"][:, 0] == k]
        true.append({int(row[1]): row[[2, 4]] for row in now})
        found.append({track.label: track.mean[:2] for track in tracker.estimate()})
        x, y = np.reshape(list(found[-1].values()), (-1, 2)), np.reshape(list(true[-1].values()), (-1, 2))
        near = ospa(x, y)
        window = ospa2(found[-WINDOW:], true[-WINDOW:])
        rows.append(
            [near.total_m, near.localisation_m, window.total_m, gospa(x, y).total_m, len(x) - len(y), spent]
        )
    return list(np.mean(rows, axis=0))


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path)
    parser.add_argument(
        "--set", action="append", default=[], metavar="PARAM=VALUE", help="override a GlmbParams field"
    )
    arguments = parser.parse_args()
    begin = time.perf_counter()
    warm_up()
    print(f"warm-up {time.perf_counter() - begin:.2f} s")
    if arguments.data is None:
        for n_objects, n_clutter in [
            (5, 25),
            (5, 200),
            (50, 30),
            (50, 200),
            (60, 200),
            (100, 60),
            (100, 200),
        ]:
            scan_times(n_objects, n_clutter)
        return
    params = {name: float(value) for name, value in (text.split("=") for text in arguments.set)}
    folder = next(p for p in (arguments.data / "vo_linear_gaussian", arguments.data) if p.is_dir())
    for name in ("demo", "hard"):
        rows = np.array([score(path, params) for path in sorted(folder.glob(f"{name}_mc*.npz"))])
        titles = ("OSPA", "loc", "OSPA2", "GOSPA", "count", "ms")
        print(
            name,
            "  ".join(
                f"{t} {m:.2f}±{s:.2f}" for t, m, s in zip(titles, rows.mean(0), rows.std(0), strict=True)
            ),
        )


if __name__ == "__main__":
    main()
