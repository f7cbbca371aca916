"""What `gcs track` judges by: where the objects truly were.

- CSV with a line of titles: first `k`, `t_s` or `t_ns`; `id` (or `label`), numbers or words; `x` and `y` (or
  `px` and `py`); others are not read. So the estimates that `-o` writes can be the truth of another run.
- Without titles, and in an NPZ's `truth`: rows k,id,px,vx,py,vy or k,id,x,y.

By scan number, a scan without a row has nobody in it. By time, a scan is judged when the truth has a row at
its time; a row with nothing but the time says that nobody was there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from gcs.errors import ConfigError
from gcs.io.detections.columns import TIMES
from gcs.io.detections.model_file import MOST_SCANS
from gcs.io.detections.tables import FIRST, Numbers, read_csv, read_npz
from gcs.model import FloatArray, read_only
from gcs.tracking.metrics import Tracks

_ROW: Final = "rows of numbers k,id,px,vx,py,vy or k,id,x,y, or titles that say otherwise"
_NAMES: Final = ("id", "label")
_PLACES: Final = (("x", "y"), ("px", "py"))
_SAME_NS: Final = 1_000
"""Times so close are one: seconds since 1970 are known to a quarter of that in a float."""


@dataclass(frozen=True, slots=True)
class TruthRows:
    """A table of who was where."""

    path: Path
    title: str
    """Of the first column: "k" or one of `TIMES`."""
    first: FloatArray
    """(n,) scan or time."""
    who: tuple[object, ...]
    """(n,) None where a row says that nobody was there."""
    place_m: FloatArray
    """(n, 2) east/north."""

    @property
    def scans(self) -> npt.NDArray[np.int64]:
        """Scan numbers that occur, in order; none where rows have times."""
        numbers = self.first if self.title == "k" else np.empty(0)
        return np.unique(numbers.astype(np.int64))


def read_truth(path: Path) -> TruthRows:
    """Read a file of truth, NPZ or CSV.

    Raises
    ------
    ConfigError
        When it is none.
    """
    if path.suffix.lower() == ".npz":
        arrays = read_npz(path)
        if "truth" not in arrays:
            raise ConfigError(str(path), "truth", f"is missing; expected {_ROW}")
        return truth_rows(path, Numbers((), arrays["truth"]))
    numbers = read_csv(path, _ROW, _NAMES)
    if not numbers.titles and not numbers.rows.size:
        raise ConfigError(str(path), "", f"holds no row; expected {_ROW}")
    return truth_rows(path, numbers)


def truth_rows(path: Path, numbers: Numbers) -> TruthRows:
    """Take a table for the truth.

    Raises
    ------
    ConfigError
        When it is not what it should be.
    """
    if not numbers.rows.size:
        return TruthRows(path, "k", np.empty(0), (), np.empty((0, 2)))
    title, name, place = _columns(path, numbers)
    rows = numbers.rows
    first, ids, place_m = rows[:, 0], rows[:, name], rows[:, place]
    who: list[object] = [numbers.words[int(i)] for i in ids] if numbers.words else ids.tolist()
    nameless = np.isnan(ids) | np.array([one == "" for one in who])
    nobody = nameless & np.isnan(place_m).all(axis=1)
    for key, bad in (
        (title, ~np.isfinite(first)),
        (numbers.titles[name] if numbers.titles else "id", nameless & ~nobody),
        ("x,y", ~nobody & ~np.isfinite(place_m).all(axis=1)),
    ):
        if bad.any():
            problem = f"expected it in each row that is not empty; it is missing in row {np.argmax(bad) + 1}"
            raise ConfigError(str(path), key, problem)
    whole = (first == np.floor(first)) & (first >= 0) & (first <= MOST_SCANS)
    if title == "k" and not whole.all():
        found = f"expected whole numbers of scans from 0 to {MOST_SCANS}, found {first[~whole][0]:.10g}"
        raise ConfigError(str(path), "k", found)
    names = tuple(None if alone else one for one, alone in zip(who, nobody.tolist(), strict=True))
    return TruthRows(path, title, first, names, place_m)


def _columns(path: Path, numbers: Numbers) -> tuple[str, int, list[int]]:
    """Title of the first column, and which columns are the name and the place."""
    rows, titles = numbers.rows, numbers.titles
    if titles:
        name = next((titles.index(title) for title in _NAMES if title in titles), None)
        place = next(([titles.index(a), titles.index(b)] for a, b in _PLACES if {a, b} <= set(titles)), None)
        if titles[0] not in FIRST or name is None or place is None:
            raise ConfigError(
                str(path),
                "",
                f"expected the titles k, t_s or t_ns first, id, and x,y or px,py; found {','.join(titles)}",
            )
        if rows.shape[1] < len(titles):
            found = f"expected {len(titles)} columns as the titles say, found {rows.shape[1]}"
            raise ConfigError(str(path), "", found)
        return titles[0], name, place
    if rows.ndim != 2 or rows.shape[1] < 4:
        raise ConfigError(str(path), "", f"expected {_ROW}; found the shape {rows.shape}")
    return "k", 1, [2, 4 if rows.shape[1] >= 6 else 3]


def by_scan(truth: TruthRows, times: Mapping[int, int]) -> tuple[dict[int, Tracks[object]], tuple[str, ...]]:
    """Return positions by k at the scans that can be judged, and what the user should know of the others.

    Parameters
    ----------
    truth
        The table.
    times
        The number k of each scan, by its time in nanoseconds.

    Raises
    ------
    ConfigError
        When an object is at two places at once, or no scan can be judged.
    """
    by_number = truth.title == "k"
    numbers = truth.first.tolist() if by_number else _numbers(truth.first * TIMES[truth.title], times)
    known, said = set(times.values()), set(numbers)
    true: dict[int, dict[object, FloatArray]] = {k: {} for k in times.values() if by_number or k in said}
    if truth.who and known.isdisjoint(said):
        raise ConfigError(
            str(truth.path), truth.title, "no scan of the detections is in it; expected their truth"
        )
    for k, who, place in zip(numbers, truth.who, truth.place_m, strict=True):
        if k is None or k not in known or who is None:
            continue
        if who in true[k]:
            raise ConfigError(str(truth.path), "id", f"{who!r} is in scan {k:.0f} twice; expected it once")
        true[k][who] = read_only(place)
    left = len(times) - len(true)
    remark = (
        f"{truth.path}: {left} of {len(times)} scans are not judged: the truth has no row at their times."
    )
    return dict(true), (remark,) if left else ()


def _numbers(t_ns: FloatArray, times: Mapping[int, int]) -> list[int | None]:
    """Return which scan was at each time; None where there was none."""
    scans = sorted(times)
    at = np.searchsorted(scans, t_ns - _SAME_NS).tolist()
    return [
        times[scans[i]] if i < len(scans) and scans[i] - t <= _SAME_NS else None
        for i, t in zip(at, t_ns.tolist(), strict=True)
    ]
