"""Arrays of an NPZ, read in bounded memory and without executing anything in it.

An NPZ is a ZIP archive of arrays (https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html).
`numpy.load` allocates what the header of an array claims, and `zipfile` unpacks with any method. Here the
archive's directory, each array's header and the claimed sizes are checked before anything is unpacked. Arrays
have numbers, stored or deflated, as `numpy.savez` writes them.
"""

from __future__ import annotations

import math
import os
import tokenize
import zipfile
import zlib
from typing import IO, BinaryIO, Final

import numpy as np

from gcs.model import FloatArray

_MAX_DIRECTORY_BYTES: Final = 1_000_000
_TAIL_BYTES: Final = 22 + 65_535
"""The end of a ZIP archive with the longest comment."""
_MAX_RATIO: Final = 200
_FREE_BYTES: Final = 32_000_000
"""Unpacked size that is allowed at any ratio; numbers of sensors compress to a tenth at best."""
_METHODS: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED: Final = 0x1
_KINDS: Final = "biuf"
"""Kinds of numpy's numbers: bool, int, unsigned, float."""
_BROKEN: Final = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    KeyError,
    MemoryError,
    NotImplementedError,
    OverflowError,
    RecursionError,
    RuntimeError,
    SyntaxError,
    tokenize.TokenError,
    TypeError,
    ValueError,
)
"""Errors of `zipfile` and numpy on damaged or hostile files."""


class ArraysError(Exception):
    """A file is not an NPZ of numbers, or unpacks to too many."""


def read_arrays(file: BinaryIO, max_numbers: int) -> dict[str, FloatArray]:
    """Return the arrays of an NPZ by name.

    Raises
    ------
    ArraysError
        It is damaged, holds anything but numbers, or more than `max_numbers`.
    OSError
        It cannot be read.
    """
    try:
        _check_directory(file)
        with zipfile.ZipFile(file) as archive:
            left = max_numbers
            found = {}
            _check_entries(archive.infolist(), max_numbers)
            for entry in archive.infolist():
                with archive.open(entry) as member:
                    array = _array(member, entry, left)
                left -= array.size
                found[entry.filename.removesuffix(".npy")] = array
            return found
    except _BROKEN as error:
        raise ArraysError(str(error) or type(error).__name__) from None


def _check_directory(file: BinaryIO) -> None:
    """Refuse a directory that would fill the memory when it is read."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - _TAIL_BYTES))
    tail = file.read()
    at = tail.rfind(b"PK\x05\x06")
    if at < 0:
        raise ArraysError("it is no ZIP archive")
    is_zip64 = tail[max(0, at - 20) : at].startswith(b"PK\x06\x07")
    if is_zip64 or int.from_bytes(tail[at + 12 : at + 16], "little") > _MAX_DIRECTORY_BYTES:
        raise ArraysError("its directory is larger than that of an NPZ")


def _check_entries(entries: list[zipfile.ZipInfo], max_numbers: int) -> None:
    for entry in entries:
        if entry.flag_bits & _ENCRYPTED:
            raise ArraysError(f"{entry.filename} is encrypted")
        if entry.compress_type not in _METHODS:
            raise ArraysError(f"{entry.filename} is neither stored nor deflated")
    packed = sum(entry.compress_size for entry in entries)
    unpacked = sum(entry.file_size for entry in entries)
    if unpacked > 8 * max_numbers + 1000 * len(entries):  # with their headers
        raise ArraysError(f"it unpacks to {unpacked / 1e6:.0f} MB; split it into several files")
    if unpacked > _FREE_BYTES + _MAX_RATIO * packed:
        raise ArraysError(f"it unpacks to {unpacked / 1e6:.0f} MB, more than {_MAX_RATIO} times its size")


def _array(member: IO[bytes], entry: zipfile.ZipInfo, max_numbers: int) -> FloatArray:
    version = np.lib.format.read_magic(member)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read_header is None:  # the third has names of fields, which numbers have not
        raise ArraysError(f"{entry.filename} has version {version} of the format, which numbers do not need")
    shape, is_fortran, dtype = read_header(member)
    if dtype.hasobject or dtype.kind not in _KINDS:
        raise ArraysError(f"{entry.filename} holds {str(dtype)[:40]}, no numbers")
    count = math.prod(shape)
    if min(shape, default=0) < 0 or count * dtype.itemsize > entry.file_size:
        raise ArraysError(f"{entry.filename} has not the {count} numbers that its header claims")
    if count > max_numbers:
        raise ArraysError(f"more than {max_numbers} numbers; split it into several files")
    content = member.read(count * dtype.itemsize)
    if len(content) < count * dtype.itemsize:
        raise ArraysError(f"{entry.filename} breaks off")
    numbers = np.frombuffer(content, dtype).astype(np.float64)
    return numbers.reshape(shape, order="F" if is_fortran else "C")
