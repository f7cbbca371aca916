"""`gcs foxglove`: show a running service in Foxglove."""

from __future__ import annotations

from typing import Annotated

import typer

from gcs.cli.arguments import MissionOption, ZenohOption, ZenohTlsOption, command_app
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def foxglove(
    zenoh: ZenohOption = None,
    mission: MissionOption = None,
    zenoh_tls: ZenohTlsOption = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on this machine; 0: a free one.")] = 8765,
) -> None:
    """Show a running service in Foxglove, until Ctrl-C.

    In Foxglove: *Open connection → Foxglove WebSocket*, ws://localhost:8765, and the layout
    docs/foxglove-layout.json. Topics and schemas are those of `gcs export -o FILE.mcap`.

    Run it on the machine with Foxglove, and name the service by `--zenoh tls/HOST:7447 --zenoh-tls FOLDER`.
    It listens on this machine only. It is a process of its own, sees, and gives no orders.

    It needs foxglove-sdk: `pip install 'swarm-gcs[foxglove]'`.
    """
    with exit_on_error():
        from gcs.cli.fly.foxglove_server import FoxgloveServer, foxglove_sdk
        from gcs.cli.following import followed

        sdk = foxglove_sdk()
        with (
            followed(zenoh, mission, zenoh_tls) as source,
            FoxgloveServer(sdk, source.mission.name, port) as server,
        ):
            server.serve(source, console_for())
