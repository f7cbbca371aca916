"""Error messages and exit codes of the commands."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.text import Text

from gcs.errors import ConfigError, GcsError, InterruptedRunError, NoAnswerError, ReplacedError
from gcs.io.log_output import LogConsole
from gcs.io.terminal import console_for


def print_error(error: GcsError, console: Console | None = None) -> int:
    """Print an error as one line on a console, by default on stderr; return the exit code.

    The code is 130 after Ctrl-C, 1 when no service answers or another one commands, else 2. The text is not
    read as markup: file names may have brackets.
    """
    if isinstance(error, InterruptedRunError):
        line = Text.assemble(("interrupted: ", "yellow"), str(error))
    else:
        line = Text.assemble(("error: ", "bold red"), str(error))
    console = console or console_for(stderr=True)
    if isinstance(error, ConfigError) and isinstance(console, LogConsole) and console.as_json:
        console.print(line, highlight=False, soft_wrap=True, parameters={"mistakes": error.rows})
    else:
        console.print(line, highlight=False, soft_wrap=True)
    if isinstance(error, InterruptedRunError):
        return 130
    return 1 if isinstance(error, NoAnswerError | ReplacedError) else 2


@contextmanager
def exit_on_error(console: Console | None = None, *, as_json: bool = False) -> Iterator[None]:
    """Turn an expected error into one line on a console, by default on stderr, and an exit code.

    With `as_json`, the mistakes of a file are also a JSON object on stdout.
    """
    try:
        yield
    except GcsError as error:
        if as_json and isinstance(error, ConfigError):
            typer.echo(json.dumps({"mistakes": error.rows}))
        raise typer.Exit(print_error(error, console)) from None
    except MemoryError:
        raise typer.Exit(print_error(GcsError("this needs more memory than there is"), console)) from None
    except KeyboardInterrupt:
        raise typer.Exit(print_error(InterruptedRunError("the command did not finish"), console)) from None
