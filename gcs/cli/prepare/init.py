"""`gcs init`: write a first mission file from a plan, a map, a log, or a link."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.arguments import command_app
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def init(
    source: Annotated[
        Path | None,
        typer.Argument(
            help="A .plan of QGroundControl, a .kml, a log (.tlog, .bin, .ulg), or a recording of gcs.",
            show_default=False,
        ),
    ] = None,
    listen: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT", help="Use the vehicles heard on this link, such as udpin:0.0.0.0:14550."
        ),
    ] = None,
    wait: Annotated[float, typer.Option(min=1.0, max=600.0, help="Seconds to listen.")] = 10.0,
    name: Annotated[str | None, typer.Option(help="Mission name.  [default: from the source]")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write.  [default: NAME.toml]")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Write a first mission file from a plan, a map, a log, or a link.

    Waypoints of a plan and points of a KML become target births. Points named "agent" or "vehicle" become
    starts. Polygons become a fence: the one named "fence", "boundary" or "border", or the one around the
    starts, is to stay in, the others are to stay out of. Logs and links give the vehicles. Nothing on a
    vehicle is changed.
    """
    from gcs.cli.prepare.first_mission_file import write_mission_file

    with exit_on_error():
        write_mission_file(source, listen, console_for(), wait_s=wait, name=name, out=out, force=force)
