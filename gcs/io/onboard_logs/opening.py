"""Telemetry logs and onboard logs of any kind, opened as a ``.tlog``."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import BinaryIO, Final, Literal, TypeAlias, cast

from gcs.files import open_regular
from gcs.io.onboard_logs.dataflash import HEAD, read_dataflash
from gcs.io.onboard_logs.onboard_telemetry import OnboardTelemetry
from gcs.io.onboard_logs.ulog import read_ulog
from gcs.io.recording.tlog import check_log

LogKind: TypeAlias = Literal["tlog", "DataFlash log", "ULog"]

_READERS: Final[dict[LogKind, Callable[[Path], OnboardTelemetry]]] = {
    "DataFlash log": read_dataflash,
    "ULog": read_ulog,
}
_ULOG: Final = b"ULog\x01\x12\x35"
_IN_MEMORY_BYTES: Final = 64 * 1024 * 1024


@contextmanager
def open_telemetry(path: Path) -> Iterator[BinaryIO]:
    """Open a log as a ``.tlog``; what is not of an autopilot is opened as it is, and checked.

    Raises
    ------
    RecordingError
        If it is no log, or of an autopilot and without positions.
    OSError
        If it cannot be read.
    """
    read = _READERS.get(log_kind(path))
    if read is None:
        with open_regular(path) as file:
            check_log(file, str(path))
            yield file
        return
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):  # libraries print what they skip
        telemetry = read(path)
    with tempfile.SpooledTemporaryFile(max_size=_IN_MEMORY_BYTES) as file:
        for entry in telemetry.entries(str(path)):
            file.write(entry)
        file.seek(0)
        yield cast(BinaryIO, file)


def log_kind(path: Path) -> LogKind:
    """Return the kind of a log by its first bytes.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    with open_regular(path) as file:
        head = file.read(len(_ULOG))
    if head.startswith(HEAD):
        return "DataFlash log"
    return "ULog" if head.startswith(_ULOG) else "tlog"
