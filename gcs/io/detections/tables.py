"""Numbers from NPZ and CSV files of others, read in bounded memory."""

from __future__ import annotations

import io
import math
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TextIO

import numpy as np

from gcs.errors import ConfigError
from gcs.files import open_regular
from gcs.io.detections.arrays import ArraysError, read_arrays
from gcs.model import FloatArray

MOST_NUMBERS: Final = 40_000_000
"""In one file: 320 MB."""
_MOST_FILE_BYTES: Final = 10 * MOST_NUMBERS
_MOST_LINE: Final = 100_000
_MOST_WORDS: Final = 100_000
_MOST_NAME: Final = 256
"""Characters of a name that count."""
ENDINGS: Final = (".npz", ".csv")
"""Of the names of such files; other kinds of files are told by content."""
FIRST: Final = ("k", "t_s", "t_ns")
"""Titles of a first column: the number of a scan, or its time."""
SENSOR: Final = "sensor"
"""Title of a column of words."""
_SPLIT: Final = "expected less: split it into several files"


@dataclass(frozen=True, slots=True)
class Numbers:
    """What a CSV holds."""

    titles: tuple[str, ...]
    """Of the line above the first row, or of a comment there that begins with k, t_s or t_ns."""
    rows: FloatArray
    words: tuple[str, ...] = ()
    """What stands in the column of words; in `rows` it is their place here, counted from 0."""
    remarks: tuple[str, ...] = ()
    """What the user should know, such as a last line that was cut off."""


def read_npz(path: Path) -> dict[str, FloatArray]:
    """Return the numbers in an NPZ; nothing in it is executed.

    Raises
    ------
    ConfigError
        When it is none, or unpacks to more than memory should hold.
    """
    try:
        with open_regular(path, _MOST_FILE_BYTES) as file:
            return read_arrays(file, MOST_NUMBERS)
    except FileNotFoundError:
        raise ConfigError(str(path), "", "there is no such file") from None
    except OSError as error:
        raise ConfigError(str(path), "", f"cannot be read: {error.strerror or error}") from None
    except ArraysError as error:
        raise ConfigError(str(path), "", f"expected an NPZ of numbers: {error}") from None


def read_csv(path: Path, expected: str, words: tuple[str, ...] = (SENSOR,)) -> Numbers:
    """Return the numbers of a CSV below its line of titles; lines that begin with # are comments.

    An empty cell is NaN; cells of the first column with a title of `words` are words. A last line that breaks
    off (without line end, fewer cells) is left out, with a remark.

    Raises
    ------
    ConfigError
        When it cannot be read, a line is no row, or it holds more than memory should.
    """
    try:
        with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", newline="") as file:
            return _numbers(path, file, expected, words)
    except FileNotFoundError:
        raise ConfigError(str(path), "", "there is no such file") from None
    except UnicodeDecodeError:
        raise ConfigError(
            str(path), "", f"is no text; expected an NPZ (by its name) or a CSV: {expected}"
        ) from None
    except OSError as error:
        raise ConfigError(str(path), "", f"cannot be read: {error.strerror}") from None


def _numbers(path: Path, file: TextIO, expected: str, titles_of_words: tuple[str, ...]) -> Numbers:
    values, columns, number = array("d"), 0, 0
    titles: tuple[str, ...] = ()
    words: dict[str, int] = {}
    remarks: tuple[str, ...] = ()
    word, titles_may_come = -1, True
    while line := file.readline(_MOST_LINE):
        number += 1
        if len(line) == _MOST_LINE:
            what = f"expected lines of less than {_MOST_LINE} characters"
            raise ConfigError(f"{path}, line {number}", "", what)
        cells = line.split("#", 1)[0].replace('"', "").strip()
        if titles_may_come:
            titles = _titles(line if cells else line.lstrip().lstrip("#"), is_comment=not cells) or titles
            word = next((i for i, title in enumerate(titles) if title in titles_of_words), -1)
        if not cells:
            continue
        if ";" in cells:
            if "," in cells:
                what = "expected commas or semicolons between cells, not both; and decimal points"
                raise ConfigError(f"{path}, line {number}", "", what)
            cells = cells.replace(";", ",")
        row = _row(cells) if word < 0 else _row(cells, word, words)
        if row is not None and (not columns or len(row) == columns):
            columns = len(row)
            values.extend(row)
        elif columns and not line.endswith(("\n", "\r")) and not file.read(1):
            remarks = (f"Line {number}, the last, breaks off and is left out.",)
        elif not titles_may_come:
            raise ConfigError(f"{path}, line {number}", "", f"expected {expected}")
        titles_may_come = False
        if len(words) > _MOST_WORDS:
            what = f"expected numbers, or at most {_MOST_WORDS} different names"
            raise ConfigError(str(path), titles[word], what)
        if len(values) > MOST_NUMBERS:
            raise ConfigError(str(path), "", f"holds more than {MOST_NUMBERS} numbers; {_SPLIT}")
    rows = np.frombuffer(values, np.float64).reshape(-1, columns) if columns else np.empty((0, 3))
    return Numbers(titles, rows, tuple(words), remarks)


def _titles(line: str, *, is_comment: bool) -> tuple[str, ...]:
    """Return the titles in a line; none of a row, nor of a comment that says something else."""
    cells = line.split("#", 1)[0].replace('"', "").replace(";", ",").strip()
    titles = tuple(cell.strip() for cell in cells.split(","))
    if titles[0] not in FIRST if is_comment else _row(cells) is not None:
        return ()
    return titles


def _row(cells: str, column: int = -1, words: dict[str, int] | None = None) -> list[float] | None:
    """Return the numbers of a line, None where it holds anything else.

    What stands in `column` is a word: its number in `words`, to which a new one is added.
    """
    parts = cells.split(",")
    word = None
    if words is not None and column < len(parts):
        word, parts[column] = parts[column].strip()[:_MOST_NAME], "0"
    try:
        row = [float(cell) if cell.strip() else math.nan for cell in parts]
    except ValueError:
        return None
    if words is not None and word is not None:
        row[column] = words.setdefault(word, len(words))
    return row
