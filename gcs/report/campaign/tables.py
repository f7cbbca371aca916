"""A campaign's rows as files that other tools read: CSV, and Parquet where pyarrow is installed."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import msgspec

from gcs.errors import RecordingError
from gcs.report.campaign.results import Row


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """Write one line a mission; lists are joined by spaces.

    Raises
    ------
    RecordingError
        When the file cannot be written.
    """
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(Row.__struct_fields__)
            for row in rows:
                values = msgspec.to_builtins(row).values()
                writer.writerow([" ".join(map(str, v)) if isinstance(v, list) else v for v in values])
    except OSError as error:
        raise RecordingError(str(path), f"cannot be written: {error.strerror}") from None


def write_parquet(rows: Sequence[Row], path: Path) -> None:
    """Write the rows as Parquet, lists as lists.

    Raises
    ------
    RecordingError
        When pyarrow is not installed or the file cannot be written.
    """
    try:
        from pyarrow import Table
        from pyarrow.parquet import write_table
    except ImportError:
        raise RecordingError(str(path), "needs pyarrow: pip install 'swarm-gcs[campaign]'") from None
    try:
        write_table(Table.from_pylist([msgspec.to_builtins(row) for row in rows]), path)
    except OSError as error:
        raise RecordingError(str(path), f"cannot be written: {error}") from None
