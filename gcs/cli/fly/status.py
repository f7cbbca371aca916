"""`gcs status`: the agents, targets and sensors of a running service, at a glance."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.arguments import JsonOption, MissionOption, ZenohOption, ZenohTlsOption, command_app
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

if TYPE_CHECKING:
    from gcs.model import SwarmStatus

app = command_app()


@app.command()
def status(
    watch: Annotated[
        float | None,
        typer.Option(metavar="S", min=0.5, help="Print again every S seconds, until Ctrl-C."),
    ] = None,
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    zenoh_tls: ZenohTlsOption = None,
    timeout: Annotated[float, typer.Option(min=1.0, help="Time to wait for the service, in seconds.")] = 5.0,
    as_json: JsonOption = False,
) -> None:
    """Print the agents, targets and sensors of a running service.

    A `gcs run` or `gcs demo` on this machine is found without further options. Agents that need attention
    come first. Nothing is changed or sent to a vehicle.
    """
    from gcs.io.zenoh.discovery import choose_service
    from gcs.io.zenoh.order_client import request_status

    with exit_on_error(as_json=as_json):
        address = choose_service(mission, zenoh, zenoh_tls)
        while True:
            _print(request_status(address, timeout), address.mission, as_json=as_json)
            if watch is None:
                return
            time.sleep(watch)


def _print(found: SwarmStatus, mission: str, *, as_json: bool) -> None:
    from gcs.cli.status_tables import status_tables
    from gcs.io.record_json import encode

    if as_json:
        print(encode(found).decode(), flush=True)  # noqa: T201  the output of --json
        return
    console = console_for()
    console.print(*status_tables(found, mission), sep="\n")
