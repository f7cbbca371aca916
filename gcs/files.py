"""Reading of files that a user names: regular files only, within a size limit.

A named pipe may block, opening a device may have effects, and a file may be larger than memory. A refusal is
an `OSError` whose `strerror` gives the reason.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def open_regular(path: Path, max_bytes: int | None = None) -> BinaryIO:
    """Open a regular file for reading, without blocking.

    Raises
    ------
    OSError
        It cannot be opened, is not a regular file, or has more than `max_bytes`.
    """
    _check(path, path.stat(), max_bytes)  # before it is opened: opening a device can have effects
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        _check(path, os.fstat(descriptor), max_bytes)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """Return the content of a regular file.

    Raises
    ------
    OSError
        As `open_regular`.
    """
    with open_regular(path, max_bytes) as file:
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:  # it grows, or does not say its size
        raise _too_large(path, max_bytes)
    return content


def read_text(path: Path, max_bytes: int) -> str:
    """Return the text (UTF-8) of a regular file; line ends become newlines.

    Raises
    ------
    OSError
        As `open_regular`.
    UnicodeDecodeError
        When it is no text.
    """
    text = read_bytes(path, max_bytes).decode()
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _check(path: Path, status: os.stat_result, max_bytes: int | None) -> None:
    if not stat.S_ISREG(status.st_mode):
        kind = next((name for is_kind, name in _KINDS if is_kind(status.st_mode)), "no regular file")
        raise OSError(errno.EINVAL, f"it is {kind}; expected a regular file", str(path))
    if max_bytes is not None and status.st_size > max_bytes:
        raise _too_large(path, max_bytes)


def _too_large(path: Path, max_bytes: int) -> OSError:
    return OSError(errno.EFBIG, f"it is larger than {max_bytes / 1e6:.0f} MB", str(path))
