"""Where commands print: a terminal as wide as it is; a file or a pipe with lines that are not cut."""

from __future__ import annotations

import os

from rich.console import Console

_FILE_COLUMNS = 200
"""Of tables in a file; rich would take 80, and break words and sentences for nobody."""


def console_for(*, stderr: bool = False) -> Console:
    """Return a console on stdout or stderr; `COLUMNS` in the environment says another width for files."""
    console = Console(stderr=stderr)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = _FILE_COLUMNS
    return console
