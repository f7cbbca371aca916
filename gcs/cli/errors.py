"""How an error of ours is shown to whoever called a command, and the exit code that goes with it."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from gcs.errors import GcsError, InterruptedRunError
from gcs.io.console import console_for


def complain(error: GcsError, console: Console | None = None) -> int:
    """Print an error as one line, on stderr unless told where; return 130 after Ctrl-C, else 2.

    What it says is not read as markup: file names may have brackets.
    """
    if isinstance(error, InterruptedRunError):
        line = Text.assemble(("interrupted: ", "yellow"), str(error))
    else:
        line = Text.assemble(("error: ", "bold red"), str(error))
    (console or console_for(stderr=True)).print(line, highlight=False, soft_wrap=True)
    return 130 if isinstance(error, InterruptedRunError) else 2
