"""`gcs scenarios`: list the shipped scenarios."""

from __future__ import annotations

from rich.table import Table

from gcs.cli.arguments import command_app
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def scenarios() -> None:
    """List the shipped scenarios."""
    from gcs.config import load, scenario_names  # Loads numpy.

    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for name in scenario_names():
        table.add_row(name, load(name).description)
    console_for().print(table)
