"""Track recorded detections with a Kalman tracker, and compare its scores with those of `gcs track`.

    python tests/bench/bench_baselines.py SET [--model FILE] [--truth FILE] [--estimator smoothed]

- nearest: global nearest neighbour within 4 sigma. A track starts at a detection near a birth component, or
  anywhere with `[anywhere]`. Two detections in three scans confirm it; three misses in a row end it.
- true-association: a Kalman filter for each true object with its own detections, from the first to the last
  one. It needs the true object of each detection: the column `src`.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Literal, TypeAlias, get_args

from baselines import NearestNeighbourTracker, TrueAssociationTracker
from rich.console import Console

from gcs.cli.analyse.track import Estimator
from gcs.cli.analyse.track_run import track_detections
from gcs.cli.analyse.track_scores import Scores, States, Tracked, score, score_rows
from gcs.cli.warm_up_progress import HISTORIES, TRACKING, load_kernels
from gcs.io.detections.track_input import Detections, load

Baseline: TypeAlias = Literal["nearest", "true-association"]


def track_baseline(
    detections: Detections,
    baseline: Baseline,
    estimator: Estimator,
) -> Tracked:
    """Run a baseline tracker over all scans; estimators as in `gcs track`.

    "recovered" and "smoothed" are whole paths of confirmed tracks, from the first to the last detection, as
    are all estimates of true association.
    """
    model = detections.tracking_model()
    speed_std_m_s = model.birth_speed_std_m_s
    nearest = NearestNeighbourTracker(model.params, speed_std_m_s if model.births_per_s > 0.0 else None)
    true = TrueAssociationTracker(model.params, speed_std_m_s)
    tracker = nearest if baseline == "nearest" else true
    states: dict[int, States] = {k: {} for k in detections.scan_numbers.values()}
    number_of_scan: list[int] = []
    scan_ms: list[float] = []
    for scan in detections.scans:
        begin = time.perf_counter()
        if baseline == "nearest":
            nearest.update(scan.t_ns, scan.z_m, scan.sensor, model.births)
        else:
            assert scan.origin is not None
            true.update(scan.t_ns, scan.z_m, scan.sensor, model.births, scan.origin)
        scan_ms.append((time.perf_counter() - begin) * 1e3)
        if tracker.scans > len(number_of_scan):
            number_of_scan.append(detections.scan_numbers[scan.t_ns])
            states[number_of_scan[-1]] = nearest.estimates()
    if estimator != "filtered" or baseline == "true-association":
        states = {k: {} for k in states}
        for path in tracker.paths(smooth=estimator == "smoothed"):
            for n, mean in zip(path.scan, path.mean, strict=True):
                states[number_of_scan[n]][path.label] = mean
    late_scans = len(detections.scans) - tracker.scans
    return Tracked(states, {}, scan_ms, late_scans, 0)


def compare(detections: Detections, estimator: Estimator) -> dict[str, Scores]:
    """Return the scores of the GLMB filter and of the baselines that the detections allow."""
    found = {"GLMB": score(detections, track_detections(detections, estimator))[0]}
    for baseline in get_args(Baseline):
        if baseline == "nearest" or all(scan.origin is not None for scan in detections.scans):
            found[baseline] = score(detections, track_baseline(detections, baseline, estimator))[0]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set", type=Path)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--estimator", choices=get_args(Estimator), default="recovered")
    given = parser.parse_args()
    load_kernels(Console(stderr=True), TRACKING, HISTORIES)
    for name, scores in compare(load(given.set, given.model, given.truth), given.estimator).items():
        print(f"{name}: " + "; ".join(" ".join(row) for row in score_rows(scores)))


if __name__ == "__main__":
    main()
