"""Files and folders with access for their owner only."""

from __future__ import annotations

import os
from pathlib import Path

from gcs.errors import RecordingError


def private(path: str, flags: int) -> int:
    """Open a file with mode 600; an `opener` for `open`."""
    return os.open(path, flags, 0o600)


def make_private(folder: Path, *, exist_ok: bool = False) -> None:
    """Make a folder, and missing parents, with mode 700; existing ones are unchanged.

    Raises
    ------
    OSError
        It cannot be made.
    """
    if not folder.parent.exists():
        make_private(folder.parent, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=exist_ok)


def new_folder(parent: Path, name: str) -> Path:
    """Make a new folder for a run: NAME, NAME-2, ...

    Raises
    ------
    RecordingError
        It cannot be made.
    """
    for count in range(1, 10_000):
        folder = parent / (name if count == 1 else f"{name}-{count}")
        try:
            make_private(folder)
        except FileExistsError:
            continue
        except OSError as error:
            raise RecordingError(
                str(folder), f"cannot be made: {error.strerror}; choose a folder with --out"
            ) from None
        return folder
    raise RecordingError(str(parent / name), "thousands of runs of this name; clear some out")
