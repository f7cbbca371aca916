"""The frames of a bridge, as telemetry logs (``.tlog``) of bounded size: the oldest part goes for a new one.

A bridge runs while central command is dead, and what it receives then is in no other recording. Parts are
named by the time at which they begin, and begin anew with each start of the bridge. Writing may block: a
bridge writes on a thread.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Final, TypeAlias

from gcs.io.private_files import make_private, private
from gcs.io.recording.tlog import tlog_entries
from gcs.model import NS_PER_S

_PARTS: Final = 8
"""Of a whole log; one of them is lost with each new one."""

Datagrams: TypeAlias = Sequence[tuple[int, bytes]]
"""Times since the Unix epoch in nanoseconds, and datagrams."""


class FrameLog:
    """Logs in one folder.

    Parameters
    ----------
    folder : Path
        Made when it is needed.
    max_bytes : int
        Size of all parts together.
    min_free_bytes : int
        Space that is left on the disk; with less, nothing is written.
    """

    def __init__(self, folder: Path, max_bytes: int, min_free_bytes: int) -> None:
        self.problem = ""
        """Why the last datagrams are not kept."""
        self._folder = folder
        self._max_bytes = max_bytes
        self._min_free_bytes = min_free_bytes
        self._file: IO[bytes] | None = None
        self._size = 0

    def write(self, datagrams: Datagrams) -> None:
        """Append datagrams; `problem` is set if they are not kept, and the next ones are tried again."""
        try:
            self._append(b"".join(tlog_entries(t_ns, data) for t_ns, data in datagrams), datagrams[0][0])
        except OSError as error:
            self.problem = error.strerror or str(error)
            self.close()
        else:
            self.problem = ""

    def _append(self, entries: bytes, t_ns: int) -> None:
        if self._file is None or self._size + len(entries) > self._max_bytes // _PARTS:
            self.close()
            self._file = self._next_part(t_ns)
        disk = os.statvfs(self._folder)
        if disk.f_bavail * disk.f_frsize < self._min_free_bytes + len(entries):
            raise OSError(0, f"{self._folder} has little space left (recording.min_free_mb)")
        self._file.write(entries)
        self._size += len(entries)

    def _next_part(self, t_ns: int) -> IO[bytes]:
        """Begin a part; delete the oldest ones for it."""
        make_private(self._folder, exist_ok=True)
        before = sorted(self._folder.glob("*.tlog"))
        sizes = [part.stat().st_size for part in before]
        for part in before:
            if sum(sizes) <= self._max_bytes - self._max_bytes // _PARTS:
                break
            sizes.pop(0)
            part.unlink()
        self._size = 0
        began = datetime.fromtimestamp(t_ns / NS_PER_S, UTC)
        path = self._folder / f"{began:%Y%m%d-%H%M%S-%f}.tlog"
        return open(path, "ab", buffering=0, opener=private)

    def close(self) -> None:
        """End the part."""
        if self._file is not None:
            self._file.close()
        self._file = None
