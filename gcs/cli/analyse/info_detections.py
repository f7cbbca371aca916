"""Contents of a table of detections for `gcs info`: scans, rate, gaps, missing values, order."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.filesize import decimal

from gcs.errors import ConfigError
from gcs.io.detections.columns import Columns, find_columns
from gcs.io.detections.table_files import DETECTION_TITLES, TIME_UNIT_NS, array_table, read_csv, read_npz
from gcs.mistake_codes import MistakeCode
from gcs.model import NS_PER_S, FloatArray

_MIN_GAP_PERIODS: Final = 5.0
"""A gap is longer than this many median scan periods."""
_MAX_GAPS_LISTED: Final = 100
_MAX_GAPS_SHOWN: Final = 3


def detections_contents(path: Path) -> dict[str, Any]:
    """Read detections and return their contents for JSON.

    Raises
    ------
    ConfigError
        When the file is not a table of detections.
    """
    more: list[str] = []
    if path.is_file() and path.stat().st_size == 0:
        raise ConfigError(str(path), "", MistakeCode.INVALID_FILE, "is empty")
    if path.suffix.lower() == ".npz":
        arrays = read_npz(path)
        table = array_table(path, arrays, "meas")
        more = sorted(set(arrays) - {"meas"})
    else:
        table = read_csv(path, DETECTION_TITLES)
    return {
        "kind": "detections",
        "file": str(path),
        "bytes": path.stat().st_size,
        "more": more,
        "remarks": list(table.remarks),
        "sensors": list(table.words),
        **_scans(table.rows, find_columns(table)),
    }


def _scans(rows: FloatArray, of: Columns) -> dict[str, Any]:
    """Count scans. Times are in seconds if the file has them, else in scan numbers."""
    title = of.time
    first = rows[:, 0] * (TIME_UNIT_NS[title] / NS_PER_S if title in TIME_UNIT_NS else 1.0)
    is_detection = of.is_detection(rows)
    is_finite = np.zeros(len(rows), np.bool_)
    for pair in (of.position, of.polar):
        if pair is not None:
            is_finite |= np.isfinite(rows[:, pair]).all(axis=1)
    when = np.unique(first[np.isfinite(first)])
    steps = np.diff(when)
    median = float(np.median(steps)) if steps.size else 0.0
    gaps = np.flatnonzero(steps > _MIN_GAP_PERIODS * median)
    timed = title in TIME_UNIT_NS
    return {
        "column": title,
        "scans": int(when.size),
        "detections": int(is_finite.sum()),
        "not_finite": int((~is_finite & is_detection).sum()),
        "first": float(when[0]) if when.size else None,
        "last": float(when[-1]) if when.size else None,
        "rate_hz": 1.0 / median if timed and median > 0.0 else None,
        "gap_count": int(gaps.size),
        "gaps": [{"at": float(when[i]), "length": float(steps[i])} for i in gaps[:_MAX_GAPS_LISTED]],
        "out_of_order": int((np.diff(first) < 0.0).sum()),
    }


def print_detections(contents: dict[str, Any], console: Console) -> None:
    """Print the contents of a table of detections."""

    def print_line(text: str, style: str = "") -> None:
        console.print(text, style=style, highlight=False, markup=False, soft_wrap=True)

    more = f"; also {', '.join(contents['more'])}" if contents["more"] else ""
    print_line(f"{contents['file']}: detections, {decimal(contents['bytes'])}{more}")
    if contents["sensors"]:
        print_line(f"sensors: {', '.join(contents['sensors'])}")
    scans = contents["scans"]
    unit = "" if contents["column"] == "k" else " s"
    if not scans:
        print_line("no scans", "yellow")
        return
    start = contents["first"]
    rate = "" if contents["rate_hz"] is None else f" at {contents['rate_hz']:.3g} Hz"
    span = f"from {start:.10g}{unit} to {contents['last']:.10g}{unit}"
    print_line(f"{scans} scans{rate}, {span}, {contents['detections'] / scans:.1f} detections in each")
    if contents["gap_count"]:
        places = ", ".join(
            f"{gap['length']:.4g}{unit} at {gap['at'] - start:.4g}{unit}"
            for gap in contents["gaps"][:_MAX_GAPS_SHOWN]
        )
        left = contents["gap_count"] - min(_MAX_GAPS_SHOWN, contents["gap_count"])
        print_line(f"gaps: {places}" + (f" and {left} more" if left else ""), "yellow")
    if contents["out_of_order"]:
        count = contents["out_of_order"]
        rows = "row is earlier than the one before" if count == 1 else "rows are earlier than those before"
        print_line(f"{count} {rows}", "yellow")
    if contents["not_finite"]:
        print_line(f"{contents['not_finite']} detections are not finite numbers", "yellow")
    for remark in contents["remarks"]:
        print_line(remark, "yellow")
