"""`gcs preflight`: check every vehicle, link and sensor before a flight."""

from __future__ import annotations

from typing import Annotated

import typer

from gcs.cli.arguments import ConfigArgument, JsonOption, LinkOption, MapSeedOption, command_app
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def preflight(
    config: ConfigArgument,
    wait: Annotated[float, typer.Option(min=1.0, help="Timeout for answers, in seconds.")] = 30.0,
    link: LinkOption = None,
    sensors: Annotated[bool, typer.Option(help="Wait for scans on zenoh as well.")] = True,
    brief: Annotated[bool, typer.Option("--brief", help="Show only checks that are not ok.")] = False,
    seed: MapSeedOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Check every vehicle, link and sensor before a flight.

    Changes nothing on a vehicle. Exit code 0: no check is refused; 1: do not fly; 2: a mistake in the mission
    file.
    """
    from gcs.cli.prepare.preflight_checks import run_preflight

    with exit_on_error(as_json=as_json):
        ok = run_preflight(
            config,
            console_for(stderr=as_json),
            wait_s=wait,
            link=link,
            sensors=sensors,
            brief=brief,
            seed=seed,
            as_json=as_json,
        )
    raise typer.Exit(0 if ok else 1)
