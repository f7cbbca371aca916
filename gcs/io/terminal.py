"""Consoles for commands: full terminal width; unbroken lines in files and pipes."""

from __future__ import annotations

import codecs
import io
import os
import sys
from typing import Final

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderableType, RenderHook, RenderResult
from rich.segment import Segment

from gcs.io.log_output import LogConsole, is_journal
from gcs.safe_text import printable

ERRORS: Final = "gcs.ascii"
"""Name of the error handler that replaces characters by ASCII."""
_ASCII: Final = {
    "→": "->", "–": "-", "—": "-", "…": "...", "·": ".", "▒": "#", "◆": "*", "✗": "x", "×": "x", "°": " deg",
    "²": "2", "±": "+/-", "≥": ">=", "≤": "<=", "σ": "sigma", "µ": "u",
}  # fmt: skip
_FILE_COLUMNS = 200
"""Table width in a file; rich's default of 80 would break words."""


class Printable:
    """A renderable without control characters other than rich's own."""

    def __init__(self, renderable: RenderableType) -> None:
        self._renderable = renderable

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for segment in console.render(self._renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                yield Segment(printable(segment.text, keep="\n"), segment.style)


class _PrintableHook(RenderHook):
    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        return [Printable(renderable) for renderable in renderables]


def console_for(*, stderr: bool = False, as_json: bool = False) -> Console:
    """Return a console on stdout or stderr; `COLUMNS` in the environment sets the width for files.

    Parameters
    ----------
    as_json : bool
        True: each message is a JSON object (`gcs.io.log_output`).
    """
    stream = sys.stderr if stderr else sys.stdout
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors=ERRORS)
    has_priorities = is_journal(stream)
    if as_json or has_priorities:
        console: Console = LogConsole(stderr=stderr, as_json=as_json, has_priorities=has_priorities)
    else:
        console = Console(stderr=stderr)
        if not console.is_terminal and "COLUMNS" not in os.environ:
            console.width = _FILE_COLUMNS
    console.push_render_hook(_PrintableHook())
    return console


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    """Replace characters that an encoding lacks by ASCII."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return "".join(_ASCII.get(character, "?") for character in lacking), error.end


codecs.register_error(ERRORS, _in_ascii)
