"""Tables as Parquet files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from numpy.typing import ArrayLike

from gcs.errors import RecordingError


def write_parquet(columns: Mapping[str, ArrayLike], path: Path) -> None:
    """Write the columns of a table, all of one length.

    Raises
    ------
    RecordingError
        If pyarrow is not installed or the file cannot be written.
    """
    try:
        from pyarrow import Table
        from pyarrow.parquet import write_table
    except ImportError:
        raise RecordingError(str(path), "needs pyarrow: pip install 'swarm-gcs[tables]'") from None
    try:
        write_table(Table.from_pydict(dict(columns)), path)
    except OSError as error:
        raise RecordingError(str(path), f"cannot be written: {error}") from None
