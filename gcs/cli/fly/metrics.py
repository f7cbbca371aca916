"""`gcs metrics`: metrics of a running service for Prometheus, with or without its console."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from gcs.cli.arguments import (
    ConsoleAccessOption,
    MissionOption,
    ZenohOption,
    ZenohTlsOption,
    command_app,
)
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

_ADDRESS: Final = "127.0.0.1:9480"

app = command_app()


@app.command()
def metrics(
    zenoh: ZenohOption = None,
    mission: MissionOption = None,
    zenoh_tls: ZenohTlsOption = None,
    listen: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Address at which Prometheus reads.")
    ] = _ADDRESS,
    page_access: ConsoleAccessOption = None,
) -> None:
    """Serve metrics of a running service for Prometheus, until Ctrl-C.

    They are those that a console has at `/metrics`; this address has nothing else: no page and no orders.
    The service is one on this machine, also with `--console off`, or that of `--zenoh`.

    In prometheus.yml: `static_configs: [{targets: ["127.0.0.1:9480"]}]`. The values are made when Prometheus
    reads them, and cost the flight as much as an open page.
    """
    from gcs.cli.console_options import PageOptions
    from gcs.cli.console_process import serve_console

    options = PageOptions(listen, page_access)
    with exit_on_error():
        serve_console(zenoh, mission, zenoh_tls, options, console_for(), is_metrics_only=True)
