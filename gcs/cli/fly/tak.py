"""`gcs tak`: show a running service on TAK."""

from __future__ import annotations

from typing import Annotated

import typer

from gcs.cli.arguments import MissionOption, ZenohOption, ZenohTlsOption, command_app
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def tak(
    url: Annotated[
        str,
        typer.Argument(
            metavar="URL",
            help="Where TAK listens: tcp://HOST:8087 or tls://HOST:8089 of a server, udp://239.2.3.1:6969 "
            "for ATAK and WinTAK on this network, or udp://HOST:PORT.",
        ),
    ],
    zenoh: ZenohOption = None,
    mission: MissionOption = None,
    zenoh_tls: ZenohTlsOption = None,
    target_type: Annotated[
        str,
        typer.Option(
            metavar="TYPE", help="CoT type of the targets: a-u-G unknown, a-h-G hostile, on the ground."
        ),
    ] = "a-u-G",
    geoid_m: Annotated[
        float,
        typer.Option(
            min=-120.0,
            max=120.0,
            metavar="M",
            help="Height of the geoid above the WGS84 ellipsoid at the mission: TAK counts heights from the "
            "ellipsoid, vehicles from the geoid.",
        ),
    ] = 0.0,
    alarms: Annotated[
        bool, typer.Option("--alarms/--no-alarms", help="Send alarms as TAK emergency alerts.")
    ] = True,
) -> None:
    """Show a running service on TAK (ATAK, WinTAK, a TAK server), until Ctrl-C.

    Vehicles, targets with their uncertainty, routes and alarms go out once a second as Cursor on Target. What
    comes in is not read: no vehicle is commanded over TAK. It is a process of its own: when TAK is slow or
    gone, nothing of the flight waits.

    It needs pytak: `pip install 'swarm-gcs[tak]'`. For tls:// the environment has PYTAK_TLS_CLIENT_CERT,
    PYTAK_TLS_CLIENT_KEY, PYTAK_TLS_CLIENT_CAFILE: files in PEM.
    """
    with exit_on_error():
        from gcs.cli.fly.tak_link import TakLink
        from gcs.cli.following import followed
        from gcs.report.export.cot import CotStyle

        link = TakLink(url)
        with followed(zenoh, mission, zenoh_tls) as source:
            link.serve(source, CotStyle(target_type, geoid_m), console_for(), has_alarms=alarms)
