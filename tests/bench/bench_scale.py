"""Time per scan and the count's bias from 10 to 10,000 objects, sparse and dense, and over a long run.

    python tests/bench/bench_scale.py [--plot docs/images/scale.png] [--most 10000] [--scans 25]
    python tests/bench/bench_scale.py --long 10000     # is a scan as fast, and memory as small, at the end?
    python tests/bench/bench_scale.py --flood          # thousands of detections in one scan

As many clutter points as objects; sparse: a cell of 316 m x 316 m for each object, dense: 100 m x 100 m, with
noise of 3.2 m and gates of 18 m and more around each track (`worlds.py` says how they live). CPU time of the
thread (not of the process: BLAS, which makes the worlds, keeps its other threads spinning for a while) of
`update` (the filter), of `estimates` (all tracks, existence and the number's distribution as arrays) and of
`picture` (the same as records).
"""

from __future__ import annotations

import argparse
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from worlds import World

from gcs.model import NS_PER_S
from gcs.tracking.glmb.filter import Glmb, warm_up

SETTLE = 5
"""Scans left out at the beginning."""
CELLS_M = {"sparse": 316.0, "dense": 100.0}


def timed(tracker: Glmb, world: World, scan: object) -> tuple[float, float, float, float]:
    """CPU milliseconds of update, estimates and picture, and the mean of the number of objects."""
    begin = time.thread_time()
    tracker.update(scan.t_ns, scan.z_m, world.sensor, scan.births)
    middle = time.thread_time()
    tracker.estimates()
    late = time.thread_time()
    picture = tracker.picture(scan.t_ns)
    end = time.thread_time()
    mean = float(picture.cardinality @ np.arange(picture.cardinality.size))
    return (middle - begin) * 1e3, (late - middle) * 1e3, (end - late) * 1e3, mean


def measure(world: World, scans: int, **limits: int) -> dict[str, float]:
    """Median and 95 % of the milliseconds, and the count's bias over all scans."""
    tracker = Glmb("targets", replace(world.params, **limits), 1)
    rows = [(*timed(tracker, world, scan), len(scan.truth)) for scan in world.scans(scans + SETTLE)]
    update, estimates, picture, mean, true = np.array(rows[SETTLE:]).T
    return {
        "update": float(np.median(update)),
        "update_95": float(np.quantile(update, 0.95)),
        "estimates": float(np.median(estimates)),
        "picture": float(np.median(picture)),
        "bias": float(mean.sum() / true.sum() - 1.0),
    }


def curve(sizes: list[int], scans: int, plot: Path | None) -> None:
    result = {name: [] for name in CELLS_M}
    print(
        "objects  clutter            update ms   95 %   estimates ms   picture ms   us/object   count's bias"
    )
    for name, cell_m in CELLS_M.items():
        for n in sizes:
            row = measure(World(n, n, cell_m), max(scans, min(200, 2000 // n)))
            result[name].append(row["update"])
            print(
                f"{n:7d}  {n:7d}  {name:6s}  {row['update']:10.2f} {row['update_95']:7.2f}"
                f"  {row['estimates']:12.2f}  {row['picture']:10.2f}  {row['update'] / n * 1e3:10.2f}"
                f"   {row['bias']:+.2%}",
                flush=True,
            )
    row = measure(World(100, 60, 600.0), 200, max_hypotheses=1000)
    print(
        f"    100       60  1,000 hypotheses each"
        f" {row['update']:7.2f} {row['update_95']:7.2f}  {row['estimates']:12.2f}  {row['picture']:10.2f}"
    )
    if plot is not None:
        draw(sizes, result, plot)


def draw(sizes: list[int], result: dict[str, list[float]], plot: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    for (name, times), style in zip(result.items(), ("o-", "s--"), strict=True):
        axes.loglog(
            sizes, times, style, label=f"{name}: one object per {CELLS_M[name]:.0f} m x {CELLS_M[name]:.0f} m"
        )
    last = result["sparse"][-1] / sizes[-1]
    axes.loglog(sizes, [last * n for n in sizes], ":", color="grey", label="linear")
    axes.set(xlabel="objects (and as many clutter points per scan)", ylabel="update, ms of CPU per scan")
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.legend()
    figure.savefig(plot, dpi=130)


def long_run(scans: int) -> None:
    world = World(20, 20, 316.0)
    tracker, update, parts = Glmb("targets", world.params, 1), [], 5
    print(f"20 objects, 20 clutter points, {scans} scans\n scans     median ms   99 %   most memory MiB")
    for k, scan in enumerate(world.scans(scans), 1):
        update.append(timed(tracker, world, scan)[0])
        if k % (scans // parts) == 0:
            fifth = update[-(scans // parts) :]
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(
                f"{k:6d}  {np.median(fifth):11.3f} {np.quantile(fifth, 0.99):6.3f}  {memory:10.1f}",
                flush=True,
            )


def flood() -> None:
    """One scan of very many detections among ordinary ones: on the objects, and anywhere."""
    print("detections in one scan            update ms   next ones ms   most memory MiB")
    for where in ("anywhere", "on the objects"):
        for n in (1_000, 10_000, 100_000):
            world, rng = World(50, 50, 316.0), np.random.default_rng(1)
            tracker, times = Glmb("targets", world.params, 1), []
            for k, scan in enumerate(world.scans(12)):
                z = scan.z_m
                if k == 6 and where == "anywhere":
                    z = np.vstack([z, rng.uniform(0.0, world.side_m, (n, 2))])
                elif k == 6:
                    z = np.vstack([z, rng.choice(scan.truth[:, :2], n) + rng.normal(0.0, 5.0, (n, 2))])
                begin = time.thread_time()
                tracker.update(k * NS_PER_S, z, world.sensor, scan.births)
                times.append((time.thread_time() - begin) * 1e3)
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(
                f"{n:8d} {where:16s}  {times[6]:14.1f}  {np.max(times[7:]):12.1f}  {memory:14.0f}", flush=True
            )


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--most", type=int, default=10_000)
    parser.add_argument("--scans", type=int, default=25)
    parser.add_argument("--long", type=int, metavar="SCANS")
    parser.add_argument("--flood", action="store_true")
    arguments = parser.parse_args()
    warm_up()
    if arguments.long:
        long_run(arguments.long)
    elif arguments.flood:
        flood()
    else:
        sizes = [n for n in (10, 30, 100, 300, 1_000, 3_000, 10_000) if n <= arguments.most]
        curve(sizes, arguments.scans, arguments.plot)


if __name__ == "__main__":
    main()
