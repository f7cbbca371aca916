"""`gcs run`: central command on the links of a mission file."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.arguments import (
    ConfigArgument,
    ConsoleAccessOption,
    ConsoleMapOption,
    ConsoleOption,
    HeadlessOption,
    LogFormat,
    LogFormatOption,
    MapSeedOption,
    OpenOption,
    command_app,
)
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


class Role(StrEnum):
    """Part of a service that a process is."""

    SERVICE = "service"
    BRIDGE = "bridge"
    STANDBY = "standby"


@app.command()
def run(
    config: ConfigArgument,
    seed: MapSeedOption = 1,
    headless: HeadlessOption = False,
    log_format: LogFormatOption = LogFormat.TEXT,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the recording.  [default: runs/NAME-TIME]")
    ] = None,
    resume: Annotated[
        bool | None,
        typer.Option(
            "--resume/--no-resume",
            help="Restore the state of a service that ended or was killed. Vehicles keep their missions.  "
            "[default: when its journal is less than 15 minutes old]",
        ),
    ] = None,
    journal: Annotated[
        Path | None, typer.Option(help="Journal to resume from.  [default: runs/NAME.journal]")
    ] = None,
    page: ConsoleOption = None,
    page_access: ConsoleAccessOption = None,
    page_map: ConsoleMapOption = None,
    open_page: OpenOption = False,
    role: Annotated[
        Role,
        typer.Option(
            help="*service*: all parts, on this machine.  *bridge*: only the MAVLink endpoints of "
            "a bridge in `links.bridges`.  *standby*: follow the service, and take over when it is gone."
        ),
    ] = Role.SERVICE,
    bridge: Annotated[
        str | None, typer.Option(help="With `--role bridge`: its name, where the mission file has several.")
    ] = None,
    clock: Annotated[str | None, typer.Option(hidden=True, metavar="EPOCH_NS,SPEED")] = None,
) -> None:
    """Run central command on the links of a mission file, until Ctrl-C.

    To try it, start `sim-vehicles run SCENARIO` in a second terminal with the same scenario and seed.

    After Ctrl-C the vehicles fly their missions to the end. Started again, the service resumes.
    """
    output = console_for(as_json=log_format is LogFormat.JSON)
    with exit_on_error(output if log_format is LogFormat.JSON else None):
        if role is Role.BRIDGE:  # without the engine, which takes a second to import
            from gcs.cli.fly.live_bridge import serve_bridge

            serve_bridge(config, bridge, output)
            return
        from gcs.cli.console_options import PageOptions
        from gcs.cli.fly.live_service import RunStorage, serve
        from gcs.io.clock import RunClock

        run_clock = RunClock()
        if clock is not None:  # A simulation faster than real time.
            epoch_ns, _, speed = clock.partition(",")
            run_clock = RunClock(int(epoch_ns), int(epoch_ns), float(speed))
        serve(
            config,
            seed,
            output,
            headless=headless,
            storage=RunStorage(out, journal, resume),
            clock=run_clock,
            page=PageOptions(page, page_access, open_page, page_map),
            is_standby=role is Role.STANDBY,
        )
