"""Fresh draws of a recorded scenario: its truth and its own model, detections drawn anew from a seed.

Defaults are chosen on these, never on the recorded sets themselves.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np


def fresh(arrays: dict[str, np.ndarray], seed: int) -> dict[str, np.ndarray]:
    """Return the set with other detections: misses, noise, clutter and order by the model that it carries."""
    rng = np.random.default_rng([20_260, seed])
    (west, east), (south, north) = arrays["region"]
    rows = []
    for k in range(1, int(arrays["K"]) + 1):
        true = arrays["truth"][arrays["truth"][:, 0] == k][:, [2, 4]]
        seen = true[rng.random(len(true)) < arrays["pD"]]
        made = seen + rng.normal(0.0, float(arrays["sigma_z"]), seen.shape)
        n = rng.poisson(float(arrays["lambda_c"]))
        clutter = np.column_stack([rng.uniform(west, east, n), rng.uniform(south, north, n)])
        z = rng.permutation(np.vstack([made, clutter]))
        rows.append(np.column_stack([np.full(len(z), float(k)), z]))
    return {**arrays, "meas": np.vstack(rows)}


@contextmanager
def sets(folder: Path, difficulty: str, n_fresh: int, seed: int = 0) -> Iterator[list[Path]]:
    """Give the recorded sets of a difficulty, or `n_fresh` fresh draws of the first one from a seed on."""
    recorded = sorted(folder.glob(f"{difficulty}_mc*.npz"))
    if not n_fresh:
        yield recorded
        return
    with np.load(recorded[0]) as file, TemporaryDirectory() as made:
        arrays = {key: file[key] for key in file.files}
        paths = [Path(made) / f"{difficulty}_fresh{n:05d}.npz" for n in range(seed, seed + n_fresh)]
        for n, path in enumerate(paths, seed):
            np.savez(path, **fresh(arrays, n))
        yield paths
