"""`gcs export`: write the map of a run in a format of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.arguments import command_app
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def export(
    run: Annotated[
        Path, typer.Argument(help="A recording, or a log (.tlog, .bin of ArduPilot, .ulg of PX4).")
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="File to write; its ending is the format: .kml, .geojson, .gpx or .mcap.",
        ),
    ],
    config: Annotated[str | None, typer.Option(help="Mission file, for a recording without its own.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Write flown paths, routes, targets and losses as KML, GeoJSON, GPX or for Foxglove.

    Targets have their 95 % ellipses. A log has flown paths only. Heights are metres above mean sea level.

    - .kml for Google Earth and QGroundControl;
    - .geojson for QGIS, geopandas and web maps;
    - .gpx for GPS tools: targets and losses are waypoints;
    - .mcap for Foxglove: map, 3-D scene and log over time.
    """
    from gcs.cli.analyse.export_files import write_export

    with exit_on_error():
        write_export(run, out, console_for(), config=config, force=force)
