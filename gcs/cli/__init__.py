"""The ``gcs`` command: arguments in, exit codes out; the work is done elsewhere.

Exit codes: 0 done as it should be, 1 the mission did not end as it should (the reason is printed), 2 a
mistake in arguments or files, 130 interrupted.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys
from typing import Annotated

import typer

from gcs.cli import flying, preparing, recordings
from gcs.cli.fly.order import app as order_app
from gcs.cli.prepare.fence import app as fence_app
from gcs.cli.prepare.keys import app as keys_app
from gcs.cli.prepare.param import app as param_app

app = typer.Typer(
    help="""Central command for a swarm of fixed-wing vehicles.

    Tracks agents and targets through clutter, plans, uploads MAVLink missions, and re-tasks the survivors.

    Start with **gcs demo**.""",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)

app.add_typer(flying.app)
app.add_typer(order_app, name="order", rich_help_panel=flying.PANEL)
app.add_typer(preparing.app)
app.add_typer(fence_app, name="fence", rich_help_panel=preparing.PANEL)
app.add_typer(param_app, name="param", rich_help_panel=preparing.PANEL)
app.add_typer(keys_app, name="keys", rich_help_panel=preparing.PANEL)
app.add_typer(recordings.app)


def _show_version(wanted: bool) -> None:
    if wanted:
        import importlib.metadata

        typer.echo(f"gcs {importlib.metadata.version('swarm-gcs')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    pass


_COLLECT_AFTER = 250_000
"""Objects allocated between garbage collections. With the usual 700, an eighth of a start is spent on looking
through what was imported, time and again, and it all stays. So many are not allocated in a start."""

_SHORT = ("order", "scenarios")
"""Commands that compute nothing. Threads that numpy's BLAS starts when it is loaded cost them a tenth."""


def main() -> None:
    """Entry point."""
    if sys.argv[1:2] and sys.argv[1] in _SHORT:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    atexit.register(gc.freeze)  # Python's last collection would look through all of it once more
    gc.set_threshold(_COLLECT_AFTER, *gc.get_threshold()[1:])
    app()
