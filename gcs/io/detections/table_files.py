"""Tables of numbers from NPZ and CSV files, read in bounded memory.

The first line of a CSV has the titles of the columns, the time first. It may be a comment, as `numpy.savetxt`
writes it (``# k,x,y``). Other lines that begin with # are comments. Cells are separated by commas.
"""

from __future__ import annotations

import io
import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TextIO

import numpy as np

from gcs.errors import ConfigError
from gcs.files import open_regular
from gcs.io.detections.arrays import ArraysError, read_arrays
from gcs.mistake_codes import MistakeCode
from gcs.model import FloatArray

MAX_NUMBERS: Final = 40_000_000
"""Numbers in a file: 320 MB."""
_MAX_FILE_BYTES: Final = 10 * MAX_NUMBERS
_MAX_LINE_CHARACTERS: Final = 100_000
_MAX_WORDS: Final = 100_000
_MAX_WORD_CHARACTERS: Final = 256
ENDINGS: Final = (".npz", ".csv")
"""Endings of the names of detection files; other kinds of files are found by content."""
TIME_UNIT_NS: Final = {"t_s": 1e9, "t_ns": 1.0}
"""Titles of a column of times, and the nanoseconds of their unit."""
TIME_TITLES: Final = ("k", *TIME_UNIT_NS)
"""Titles of the first column: scan number or time."""
SENSOR: Final = "sensor"
"""Title of a column with the name of the sensor."""
ORIGIN: Final = "src"
"""Title of a column with the number of a detection's true object, 0 for clutter."""
LOG_RATIO: Final = "log_ratio"
"""Title of a column with the log-likelihood ratio of what else was measured of a detection."""
DETECTION_TITLES: Final = (
    "k, t_s or t_ns first; x and y, or range_m and bearing_deg or bearing_rad; sensor, log_ratio and src "
    "where known"
)
_ARRAY_TITLES: Final = {"meas": ("k", "x", "y", ORIGIN), "truth": ("k", "id", "px", "vx", "py", "vy")}


@dataclass(frozen=True, slots=True)
class Table:
    """Content of a table."""

    path: Path
    titles: tuple[str, ...]
    rows: FloatArray
    """(n, len(titles)), NaN for an empty cell; a word is its number in `words`."""
    words: tuple[str, ...] = ()
    """Different words of the column of words."""
    remarks: tuple[str, ...] = ()
    """Remarks for the user, such as that a last line was cut off."""

    def column(self, titles: Sequence[str]) -> int | None:
        """Return the number of the first of several columns that the table has, None for none."""
        return next((self.titles.index(title) for title in titles if title in self.titles), None)

    def pair(self, x: str, y: str) -> tuple[int, int] | None:
        """Return the numbers of two columns, None if one is missing."""
        if x not in self.titles or y not in self.titles:
            return None
        return self.titles.index(x), self.titles.index(y)


def title_error(path: Path, expected: str, found: str) -> ConfigError:
    """Return the error for missing titles."""
    return ConfigError(
        str(path),
        "titles",
        MistakeCode.MISSING_KEY,
        f"expected {expected}; found {found[:200]}: rename the columns in the first line",
    )


def read_npz(path: Path) -> dict[str, FloatArray]:
    """Return the arrays of an NPZ; nothing in it is executed.

    Raises
    ------
    ConfigError
        The file is not an NPZ of numbers, or unpacks to too many.
    """
    try:
        with open_regular(path, _MAX_FILE_BYTES) as file:
            return read_arrays(file, MAX_NUMBERS)
    except OSError as error:
        raise _unreadable(path, error) from None
    except ArraysError as error:
        raise ConfigError(
            str(path), "", MistakeCode.INVALID_FILE, f"expected an NPZ of numbers: {error}"
        ) from None


def array_table(path: Path, arrays: Mapping[str, FloatArray], name: str) -> Table:
    """Return the array `meas` or `truth` of an NPZ as a table.

    Raises
    ------
    ConfigError
        The array is missing or has another shape.
    """
    titles = _ARRAY_TITLES[name]
    needed = len(titles) - titles.count(ORIGIN)
    if name not in arrays:
        raise ConfigError(
            str(path), name, MistakeCode.MISSING_KEY, f"is missing; expected rows {','.join(titles[:needed])}"
        )
    rows = arrays[name]
    if rows.size == 0:
        rows = np.empty((0, needed))
    if rows.ndim != 2 or rows.shape[1] < needed:
        raise ConfigError(
            str(path),
            name,
            MistakeCode.WRONG_TYPE,
            f"expected rows {','.join(titles[:needed])}; found the shape {rows.shape}",
        )
    titles = titles[: rows.shape[1]]
    return Table(path, titles, rows[:, : len(titles)])


def read_csv(path: Path, expected: str, word_titles: tuple[str, ...] = (SENSOR,)) -> Table:
    """Return the content of a CSV.

    A last line that breaks off (without line end, fewer cells) is left out, with a remark.

    Parameters
    ----------
    expected
        The titles, for errors.
    word_titles
        The first column with one of these titles has words.

    Raises
    ------
    ConfigError
        The file cannot be read, has no titles, has a line that is no row, or is too large.
    """
    try:
        with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", newline="") as file:
            return _read_rows(path, file, expected, word_titles)
    except UnicodeDecodeError:
        raise ConfigError(
            str(path), "", MistakeCode.INVALID_FILE, "is not text; expected a CSV, or an NPZ by its name"
        ) from None
    except OSError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: OSError) -> ConfigError:
    if isinstance(error, FileNotFoundError):
        return ConfigError(str(path), "", MistakeCode.NOT_FOUND, "there is no such file")
    return ConfigError(str(path), "", MistakeCode.NO_ACCESS, f"cannot be read: {error.strerror or error}")


def _lines(path: Path, file: TextIO) -> Iterator[tuple[int, str]]:
    """Yield the lines with their numbers."""
    number = 0
    while line := file.readline(_MAX_LINE_CHARACTERS):
        number += 1
        if len(line) == _MAX_LINE_CHARACTERS:
            what = f"expected lines of less than {_MAX_LINE_CHARACTERS} characters"
            raise ConfigError(f"{path}, line {number}", "", MistakeCode.TOO_LARGE, what)
        yield number, line


def _read_titles(path: Path, lines: Iterator[tuple[int, str]], expected: str) -> tuple[str, ...]:
    for _, line in lines:
        text = line.replace('"', "").strip()
        titles = tuple(title.strip() for title in text.lstrip("#").split(","))
        if titles[0] in TIME_TITLES:
            return titles
        if text and not text.startswith("#"):
            raise title_error(path, expected, text)
    raise ConfigError(str(path), "titles", MistakeCode.MISSING_KEY, f"are missing; expected {expected}")


def _read_rows(path: Path, file: TextIO, expected: str, word_titles: tuple[str, ...]) -> Table:
    lines = _lines(path, file)
    titles = _read_titles(path, lines, expected)
    word_column = next((titles.index(title) for title in word_titles if title in titles), None)
    values = array("d")
    words = dict[str, int]()
    remarks: tuple[str, ...] = ()
    for number, line in lines:
        text = line.split("#", 1)[0].replace('"', "").strip()
        if not text:
            continue
        row = _row(text.split(","), word_column, words)
        if len(row) != len(titles):
            if not line.endswith(("\n", "\r")):
                remarks = (f"Line {number}, the last, breaks off and is left out.",)
                break
            problem = f"expected {len(titles)} numbers, as the titles {','.join(titles)} say"
            raise ConfigError(f"{path}, line {number}", "", MistakeCode.WRONG_TYPE, problem)
        values.extend(row)
        if len(words) > _MAX_WORDS:
            raise ConfigError(
                str(path),
                "",
                MistakeCode.WRONG_TYPE,
                f"expected numbers, or at most {_MAX_WORDS} different names",
            )
        if len(values) > MAX_NUMBERS:
            problem = f"holds more than {MAX_NUMBERS} numbers; split it into several files"
            raise ConfigError(str(path), "", MistakeCode.TOO_LARGE, problem)
    rows = np.frombuffer(values, np.float64).reshape(-1, len(titles))
    return Table(path, titles, rows, tuple(words), remarks)


def _row(cells: list[str], word_column: int | None, words: dict[str, int]) -> list[float]:
    """Return the numbers of a line, none if a cell is no number; add a new word to `words`."""
    word = None
    if word_column is not None and word_column < len(cells):
        word = cells[word_column].strip()[:_MAX_WORD_CHARACTERS]
        cells[word_column] = ""
    try:
        row = [float(cell) if cell.strip() else math.nan for cell in cells]
    except ValueError:
        return []
    if word is not None and word_column is not None:
        row[word_column] = words.setdefault(word, len(words))
    return row
