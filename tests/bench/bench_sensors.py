"""Births anywhere, turns, and range/bearing sensors: what each gives, on draws of its own.

    python tests/bench/bench_sensors.py [--runs 20]

Prints a table for each: the count in clutter and with births, arcs followed by straight and by turning
motion, and unscented against extended updates. Seeds are 100, 101, ...; nothing is tuned on them.
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from gcs.model import NS_PER_S, Polar, Sensor
from gcs.tracking.glmb import kalman
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams, warm_up
from gcs.tracking.models import sensor_geometry
from gcs.tracking.models.adaptive_birth import AdaptiveBirth
from gcs.tracking.models.measurement_model import linearise, sensor_model

SIDE_M = 2000.0
FIELD = (0.0, 0.0, SIDE_M, SIDE_M)


def births_run(seed: int, clutter: float, appear_per_s: float, scans: int = 100) -> tuple[float, float]:
    """Mean count error inside the field, and ms per scan (median); births assumed 0.1 per second."""
    rng, births = np.random.default_rng(seed), AdaptiveBirth(0.1, 8.0, 0.1, GlmbParams(1.0).process_noise)
    detector = Sensor("s", 0.95, clutter / SIDE_M**2, np.eye(2) * 25.0, FIELD)
    tracker = Glmb("targets", GlmbParams(accel_psd_m2_s3=1.0), 1, summarise_detections=True)
    state, errors, spent = np.empty((0, 4)), [], []
    for k in range(scans):
        inside = sensor_geometry.covers(detector, state[:, :2])
        state = state[inside & (rng.random(len(state)) < 0.99)]
        push = rng.normal(0.0, 1.0, (len(state), 2))
        state = np.hstack([state[:, :2] + state[:, 2:] + push / 2, state[:, 2:] + push])
        new = rng.poisson(appear_per_s)
        state = np.vstack(
            [state, np.hstack([rng.uniform(100, SIDE_M - 100, (new, 2)), rng.normal(0, 8, (new, 2))])]
        )
        seen = state[sensor_geometry.covers(detector, state[:, :2]) & (rng.random(len(state)) < 0.95), :2]
        z = np.vstack(
            [seen + rng.normal(0, 5, seen.shape), rng.uniform(0, SIDE_M, (rng.poisson(clutter), 2))]
        )
        begin = time.process_time()
        tracker.update(k * NS_PER_S, z, detector, births.births(k * NS_PER_S))
        assert tracker.detection_summary is not None
        births.add_scan(k * NS_PER_S, z, detector, tracker.detection_summary.explained)
        places = np.reshape([t.mean[:2] for t in tracker.estimate()], (-1, 2))
        spent.append((time.process_time() - begin) * 1e3)
        errors.append(
            int(sensor_geometry.covers(detector, places).sum())
            - int(sensor_geometry.covers(detector, state[:, :2]).sum())
        )
    return float(np.mean(errors)), float(np.median(spent))


def aircraft(rng: np.random.Generator, kind: str, seconds: int, speed_m_s: float = 15.0) -> np.ndarray:
    """States (n, 4) each second: straight, legs with arcs of 0.1 to 0.4 rad/s, or a circle of 30 to 80 m."""
    place, heading, rate, left_s, states, dt_s = np.zeros(2), rng.uniform(0, 2 * math.pi), 0.0, 0.0, [], 0.02
    if kind == "loiter":
        rate, left_s = rng.choice([-1, 1]) * speed_m_s / rng.uniform(30, 80), math.inf
    elif kind == "straight":
        left_s = math.inf
    for step in range(int(seconds / dt_s)):
        if left_s <= 0:
            rate = 0.0 if rate else rng.choice([-1, 1]) * rng.uniform(0.1, 0.4)
            left_s = rng.uniform(2, 8) if rate else rng.uniform(4, 15)
        v = speed_m_s * np.array([math.sin(heading), math.cos(heading)])
        if step % 50 == 0:
            states.append([*place, *v])
        heading, place, left_s = heading + rate * dt_s, place + v * dt_s, left_s - dt_s
    return np.array(states)


def turning_run(params: GlmbParams, kind: str, seeds: range) -> dict[str, tuple[float, float, float]]:
    """RMS error of position and velocity, and mean NEES (4 is right), from the sixth second on.

    Of each estimator, at the scans at which the filter showed the aircraft.
    """
    found: dict[str, list[tuple[float, float, float]]] = {"filtered": [], "recovered": [], "smoothed": []}
    detector = Sensor("s", 0.98, 4e-6, np.eye(2) * 10.0, (-5e3, -5e3, 5e3, 5e3))
    for seed in seeds:
        rng = np.random.default_rng(seed)
        path, tracker = aircraft(rng, kind, 60), Glmb("agents", params, 1, keep_histories=True)
        shown = set()
        for k, x in enumerate(path):
            z = x[None, :2][rng.random(1) < 0.98]
            clutter = x[:2] + rng.uniform(-150, 150, (rng.poisson(0.36), 2))
            z = np.vstack([z + rng.normal(0, math.sqrt(10), z.shape), clutter])
            birth = Birth(np.array([*x[:2], 0.0, 0.0]), np.diag([100.0] * 4), 0.5)
            tracker.update(k * NS_PER_S, z, detector, [birth] if k == 0 else ())
            for track in tracker.estimate()[:1] if k > 5 else ():
                shown.add(k)
                found["filtered"].append(_errors(track.mean - x, track.cov))
        assert tracker.histories is not None
        for name, smooth in (("recovered", False), ("smoothed", True)):
            for one in tracker.histories.paths(smooth=smooth)[:1]:
                rows = zip(one.scan.tolist(), one.mean, one.cov, strict=True)
                found[name] += [_errors(m - path[k], P) for k, m, P in rows if k in shown]
    means = {name: np.mean(rows, axis=0) for name, rows in found.items()}
    return {name: (math.sqrt(p), math.sqrt(v), float(nees)) for name, (p, v, nees) in means.items()}


def _errors(d: np.ndarray, cov: np.ndarray) -> tuple[float, float, float]:
    """Squared errors of position and velocity, and the NEES."""
    return d[:2] @ d[:2], d[2:] @ d[2:], d @ np.linalg.solve(cov, d)


def update_run(prior_std_m: float, bearing_std_rad: float, runs: int) -> list[tuple[float, float]]:
    """RMS position error and NEES (2 is right) of one update: unscented, and extended (filterpy)."""
    radar = sensor_geometry.polar_sensor(
        "r", 0.9, Polar(0, 0, 5.0, bearing_std_rad, (0, 5e3), (0, math.pi), 1e-3)
    )
    rng, first = np.random.default_rng(100), np.zeros(1, np.int64)
    squares: list[list[tuple[float, float]]] = [[], []]
    for _ in range(runs):
        mean, cov = np.array([0.0, 1000.0, 0.0, 0.0]), np.diag([prior_std_m**2, prior_std_m**2, 25.0, 25.0])
        x = rng.multivariate_normal(mean, cov)
        z = sensor_geometry.sensor_coordinates(radar, x[None, :2]) + rng.normal(0, (5.0, bearing_std_rad))
        view = linearise(sensor_model(radar), mean[None], cov[None])
        ours, ours_cov = kalman.update_tracks(mean[None], cov[None], first, first, z, view)
        peer = ExtendedKalmanFilter(4, 2)
        peer.x, peer.P, peer.R = mean, cov, np.diag([25.0, bearing_std_rad**2])
        peer.update(z[0], _jacobian, lambda s: sensor_geometry.sensor_coordinates(radar, s[None, :2])[0])
        for found, (m, P) in zip(squares, [(ours[0], ours_cov[0]), (peer.x, peer.P)], strict=True):
            d = (m - x)[:2]
            found.append((d @ d, d @ np.linalg.solve(P[:2, :2], d)))
    return [(math.sqrt(np.mean([e for e, _ in s])), float(np.mean([n for _, n in s]))) for s in squares]


def _jacobian(x: np.ndarray) -> np.ndarray:
    r2 = x[0] ** 2 + x[1] ** 2
    r = math.sqrt(r2)
    return np.array([[x[0] / r, x[1] / r, 0.0, 0.0], [x[1] / r2, -x[0] / r2, 0.0, 0.0]])


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    seeds = range(100, 100 + parser.parse_args().runs)
    warm_up()
    for appear in (0.0, 0.1):
        for clutter in (1, 20, 60, 200):
            rows = np.array([births_run(seed, clutter, appear) for seed in seeds])
            mean, sem = rows[:, 0].mean(), rows[:, 0].std() / math.sqrt(len(rows))
            print(f"appear {appear}/s, clutter {clutter:3d}: count error {mean:+.3f} +- {sem:.3f}, "
                  f"{rows[:, 1].mean():.2f} ms")  # fmt: skip
    models = {
        "straight, 4 m/s2": GlmbParams(accel_psd_m2_s3=16.0),
        "straight, 2 m/s2": GlmbParams(accel_psd_m2_s3=4.0),
        "turning, 1 m/s2": GlmbParams(accel_psd_m2_s3=1.0, turn_rate_std_rad_s=0.3, turn_time_s=10.0),
    }
    for kind in ("straight", "legs", "loiter"):
        for name, params in models.items():
            for estimator, (position, velocity, nees) in turning_run(params, kind, seeds).items():
                print(
                    f"{kind:8s} {name}, {estimator:9s}: {position:.2f} m, {velocity:.2f} m/s, NEES {nees:.1f}"
                )
    for prior_std_m, bearing_std_rad in ((10.0, 0.005), (40.0, 0.005), (150.0, 0.005), (150.0, 0.05)):
        found = update_run(prior_std_m, bearing_std_rad, 3000)
        for name, (error_m, nees) in zip(("unscented", "extended "), found, strict=True):
            print(f"prior {prior_std_m:.0f} m at 1 km, bearing {bearing_std_rad} rad, {name}: "
                  f"{error_m:.2f} m, NEES {nees:.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
