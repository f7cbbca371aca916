"""The estimators of `gcs track` over the standard linear-Gaussian sets: mean and spread of every score.

    python tests/bench/bench_track.py --data DIR [--fresh 20] [--set merge_chi2=0.3]

DIR holds `demo_mc*.npz` and `hard_mc*.npz`. Every set is tracked by the model in its own file. With `--fresh`
it is not the recorded sets that are tracked but as many new draws of their detections, which is where to
compare one choice of the filter's limits (`--set`) with another. Seeds 0 to 119 have been used for choosing,
2000 to 2029, 3000 to 3029 and 4000 to 4029 for how a state is shown. Times are CPU time.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import astuple, fields, replace
from pathlib import Path

import numpy as np
from draws import sets

from gcs.cli.analyse.track_run import track_detections
from gcs.cli.analyse.track_scores import Scores, score
from gcs.io.detections.track_input import load
from gcs.tracking.glmb.filter import warm_up


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--fresh", type=int, default=0, metavar="N")
    parser.add_argument("--seed", type=int, default=1000, help="of the first fresh draw")
    parser.add_argument(
        "--set", action="append", default=[], metavar="PARAM=VALUE", help="override a GlmbParams field"
    )
    arguments = parser.parse_args()
    override = {name: float(value) for name, value in (text.split("=") for text in arguments.set)}
    warm_up()
    names = [field.name for field in fields(Scores)]
    for difficulty in ("demo", "hard"):
        with sets(arguments.data, difficulty, arguments.fresh, arguments.seed) as paths:
            loaded = [load(path, None, None) for path in paths]
        loaded = [
            replace(
                d, model=replace(d.tracking_model(), params=replace(d.tracking_model().params, **override))
            )
            for d in loaded
        ]
        for estimator, lag in (("filtered", None), ("recovered", None), ("smoothed", 3), ("smoothed", None)):
            tracked = (track_detections(d, estimator, lag_scans=lag, clock=time.process_time) for d in loaded)
            rows = np.array(
                [astuple(score(d, one)[0]) for d, one in zip(loaded, tracked, strict=True)], dtype=float
            )
            late = "" if lag is None else f", {lag} scans late"
            print(f"{difficulty} {estimator}{late}: {len(rows)} sets; mean ± spread, ± error of the mean")
            error = rows.std(axis=0, ddof=1) / np.sqrt(len(rows))
            for name, mean, spread, sure in zip(names, rows.mean(0), rows.std(0), error, strict=True):
                print(f"    {name:24s}{mean:8.2f} ± {spread:.2f}   ± {sure:.2f}")


if __name__ == "__main__":
    main()
