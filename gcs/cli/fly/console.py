"""`gcs console`: the console of a service that runs elsewhere, and the process of that of `gcs run`."""

from __future__ import annotations

from typing import Annotated

import typer

from gcs.cli.arguments import (
    ConsoleAccessOption,
    ConsoleMapOption,
    ConsoleOption,
    MissionOption,
    OpenOption,
    ZenohOption,
    ZenohTlsOption,
    command_app,
)
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def console(
    zenoh: ZenohOption = None,
    mission: MissionOption = None,
    zenoh_tls: ZenohTlsOption = None,
    page: ConsoleOption = None,
    page_access: ConsoleAccessOption = None,
    page_map: ConsoleMapOption = None,
    open_page: OpenOption = False,
    listener: Annotated[int | None, typer.Option(hidden=True, metavar="DESCRIPTOR")] = None,
    mission_file: Annotated[str | None, typer.Option(hidden=True, metavar="FILE")] = None,
) -> None:
    """Serve the console of a service that runs elsewhere, until Ctrl-C.

    `gcs run` and `gcs demo` serve one themselves; this is another one, on this machine or on one that reaches
    the service's zenoh endpoint: `gcs console --zenoh tls/10.0.0.5:7447 --zenoh-tls FOLDER`. It shows the
    same, and its orders go to the same service. It costs the flight nothing: end it, or start more of them,
    at any time.

    When the service ends, the pages say so; when it is back, they go on.
    """
    from gcs.cli.console_options import PageOptions
    from gcs.cli.console_process import serve_console, serve_for_parent

    options = PageOptions(page, page_access, open_page, page_map)
    with exit_on_error():
        if listener is not None:
            serve_for_parent(zenoh or "", mission or "", zenoh_tls, options, listener, mission_file)
        else:
            serve_console(zenoh, mission, zenoh_tls, options, console_for())
