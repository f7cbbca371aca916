"""`gcs warm-up`: compile the kernels."""

from __future__ import annotations

from gcs.cli.arguments import command_app
from gcs.cli.warm_up_progress import ALL, load_kernels
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def warm_up() -> None:
    """Compile the kernels now, so that the first flight starts at once."""
    console = console_for()
    load_kernels(console, *ALL)
    console.print("all kernels are ready")
