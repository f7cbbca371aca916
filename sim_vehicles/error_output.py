"""What a vehicle's process tells on standard error; a terminal that nobody reads stops no vehicle."""

from __future__ import annotations

import contextlib
import os
import threading

_STDERR = 2
_writer: threading.Thread | None = None


def tell(text: str) -> None:
    """Write a line to standard error on a thread; it is lost if the line before is still to be written."""
    global _writer
    if _writer is None or not _writer.is_alive():
        _writer = threading.Thread(target=_write, args=(f"{text}\n".encode(),), daemon=True)
        _writer.start()


def _write(line: bytes) -> None:
    with contextlib.suppress(OSError):  # nobody is there any more
        os.write(_STDERR, line)
