"""The estimators of `gcs track` over all the standard linear-Gaussian sets: mean and spread of every score.

    python tests/bench/bench_track.py --data DIR

DIR holds `demo_mc*.npz` and `hard_mc*.npz`. Every set is tracked by the model in its own file.
"""

from __future__ import annotations

import argparse
from dataclasses import astuple, fields
from pathlib import Path

import numpy as np

from gcs.commands.detections import load
from gcs.commands.track import Scores, score, track
from gcs.tracking.glmb import warm_up


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    folder = parser.parse_args().data
    warm_up()
    names = [field.name for field in fields(Scores)]
    for difficulty in ("demo", "hard"):
        for estimator in ("filtered", "recovered", "smoothed"):
            rows = []
            for path in sorted(folder.glob(f"{difficulty}_mc*.npz")):
                detections = load(path, None, None)
                rows.append(astuple(score(detections, track(detections, estimator))[0]))
            print(difficulty, estimator, f"{len(rows)} sets")
            for name, mean, spread in zip(names, np.mean(rows, axis=0), np.std(rows, axis=0), strict=True):
                print(f"    {name:24s}{mean:8.2f} ± {spread:.2f}")


if __name__ == "__main__":
    main()
