"""Messages on standard error that never block."""

from __future__ import annotations

import contextlib
import os
import threading

_STDERR = 2
_writer: threading.Thread | None = None


def print_message(text: str) -> None:
    """Write a line to standard error on a thread; drop it while the last one is written."""
    global _writer
    if _writer is None or not _writer.is_alive():
        _writer = threading.Thread(target=_write, args=(f"{text}\n".encode(),), daemon=True)
        _writer.start()


def _write(line: bytes) -> None:
    with contextlib.suppress(OSError):  # Standard error is closed.
        os.write(_STDERR, line)
