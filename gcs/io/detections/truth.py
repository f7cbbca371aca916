"""Ground truth for the scores of `gcs track`: positions of the true objects.

A CSV has the titles `k`, `t_s` or `t_ns` first, `id` or `label` (numbers or words), and `x,y` or `px,py`. The
estimates that `-o` writes can be the truth of another run. An NPZ has `truth` with rows k,id,px,vx,py,vy.

By scan number, a scan without a row has no object. By time, a scan is scored if the truth has a row at its
time; a row with nothing but the time means that there is no object.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from gcs.errors import ConfigError
from gcs.io.detections.model_file import MAX_SCANS
from gcs.io.detections.table_files import (
    TIME_UNIT_NS,
    Table,
    array_table,
    read_csv,
    read_npz,
    title_error,
)
from gcs.mistake_codes import MistakeCode
from gcs.model import FloatArray, IntArray, read_only
from gcs.tracking.metrics import Tracks

_TITLES: Final = "k, t_s or t_ns first; id or label; x and y, or px and py"
_ID_TITLES: Final = ("id", "label")
_SAME_TIME_NS: Final = 1_000
"""Times within this are equal: a float knows seconds since 1970 to a quarter of it."""


@dataclass(frozen=True, slots=True)
class TruthRows:
    """Rows of a ground-truth table."""

    path: Path
    title: str
    """Title of the first column."""
    first: FloatArray
    """(n,) scan number or time."""
    ids: tuple[object, ...]
    """(n,) None in a row that means "no object"."""
    positions_m: FloatArray
    """(n, 2) east, north."""

    @property
    def scans(self) -> IntArray:
        """Scan numbers of the rows, in order; none if they have times."""
        numbers = self.first if self.title == "k" else np.empty(0)
        return np.unique(numbers.astype(np.int64))


def read_truth(path: Path) -> TruthRows:
    """Read ground truth, NPZ or CSV.

    Raises
    ------
    ConfigError
        The file is not a table of ground truth.
    """
    if path.suffix.lower() == ".npz":
        return truth_rows(array_table(path, read_npz(path), "truth"))
    return truth_rows(read_csv(path, _TITLES, _ID_TITLES))


def truth_rows(table: Table) -> TruthRows:
    """Return the ground truth of a table.

    Raises
    ------
    ConfigError
        A title or a number is missing.
    """
    rows = table.rows
    title = table.titles[0]
    id_column = table.column(_ID_TITLES)
    position = table.pair("x", "y") or table.pair("px", "py")
    if id_column is None or position is None:
        raise title_error(table.path, _TITLES, ",".join(table.titles))
    first = rows[:, 0]
    ids = rows[:, id_column]
    positions_m = rows[:, position]
    names: list[object] = [table.words[int(i)] for i in ids] if table.words else ids.tolist()
    without_id = np.isnan(ids) | np.array([name == "" for name in names], np.bool_)
    is_empty = without_id & np.isnan(positions_m).all(axis=1)
    for key, is_bad in (
        (title, ~np.isfinite(first)),
        (table.titles[id_column], without_id & ~is_empty),
        ("x,y", ~is_empty & ~np.isfinite(positions_m).all(axis=1)),
    ):
        if is_bad.any():
            problem = f"expected it in each row that is not empty; missing in row {np.argmax(is_bad) + 1}"
            raise ConfigError(str(table.path), key, MistakeCode.WRONG_TYPE, problem)
    is_scan = (first == np.floor(first)) & (first >= 0) & (first <= MAX_SCANS)
    if title == "k" and not is_scan.all():
        problem = f"expected whole scan numbers from 0 to {MAX_SCANS}, found {first[~is_scan][0]:.10g}"
        raise ConfigError(str(table.path), "k", MistakeCode.OUT_OF_RANGE, problem)
    known = tuple(None if empty else name for name, empty in zip(names, is_empty.tolist(), strict=True))
    return TruthRows(table.path, title, first, known, positions_m)


def truth_by_scan(
    truth: TruthRows, scan_numbers: Mapping[int, int]
) -> tuple[dict[int, Tracks[object]], tuple[str, ...]]:
    """Return the true positions by scan number, and remarks on scans without truth.

    Parameters
    ----------
    scan_numbers
        Number of each scan, by its time in nanoseconds.

    Raises
    ------
    ConfigError
        An object is at two positions at once, or no scan has truth.
    """
    by_number = truth.title == "k"
    numbers = (
        truth.first.tolist()
        if by_number
        else _scans_at(truth.first * TIME_UNIT_NS[truth.title], scan_numbers)
    )
    scans = set(scan_numbers.values())
    with_rows = set(numbers)
    if truth.ids and scans.isdisjoint(with_rows):
        problem = "no scan of the detections is in it; expected their truth"
        raise ConfigError(str(truth.path), truth.title, MistakeCode.CONFLICT, problem)
    true: dict[int, dict[object, FloatArray]] = {
        k: {} for k in scan_numbers.values() if by_number or k in with_rows
    }
    for k, id_, position_m in zip(numbers, truth.ids, truth.positions_m, strict=True):
        if k is None or k not in scans or id_ is None:
            continue
        if id_ in true[k]:
            raise ConfigError(
                str(truth.path),
                "id",
                MistakeCode.DUPLICATE,
                f"{id_!r} is in scan {k:.0f} twice; expected it once",
            )
        true[k][id_] = read_only(position_m)
    missing = len(scan_numbers) - len(true)
    remark = (
        f"{truth.path}: {missing} of {len(scan_numbers)} scans are not scored: the truth has no row at "
        "their times."
    )
    return dict(true), (remark,) if missing else ()


def _scans_at(t_ns: FloatArray, scan_numbers: Mapping[int, int]) -> list[int | None]:
    """Return the number of the scan at each time, None for no scan."""
    times = sorted(scan_numbers)
    at = np.searchsorted(times, t_ns - _SAME_TIME_NS).tolist()
    return [
        scan_numbers[times[i]] if i < len(times) and times[i] - t <= _SAME_TIME_NS else None
        for i, t in zip(at, t_ns.tolist(), strict=True)
    ]
