"""`gcs keys ca` and `gcs keys node`: certificates for zenoh, and for how long they are valid."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

_DAYS = "Validity in days, from now."


def make_ca(
    folder: Annotated[Path, typer.Argument(help="Folder of the CA.", metavar="FOLDER")] = Path("ca"),
    days: Annotated[int, typer.Option(min=1, max=36_500, help=_DAYS)] = 3650,
) -> None:
    """Make a certificate authority for the zenoh nodes of a swarm.

    Keep FOLDER/ca.key off the machines that fly: its holder can make certificates of every role.
    """
    from gcs.io.zenoh.certificate_authority import make_certificate_authority

    with exit_on_error():
        make_certificate_authority(folder, days)
    next_step = f"gcs keys node NAME --role ROLE --ca {folder}"
    _say(f"{folder}: certificate authority made, valid for {days} days. Next: {next_step}")


def make_node_certificate(
    name: Annotated[
        str,
        typer.Argument(help="Name of the node: a sensor's is that of its scans.", metavar="NAME"),
    ],
    role: Annotated[
        Literal["sensor", "viewer", "operator", "bridge", "command"],
        typer.Option(help="What it may do (docs/security.md)."),
    ],
    ca: Annotated[Path, typer.Option(help="Folder of the CA.", metavar="FOLDER")] = Path("ca"),
    host: Annotated[
        list[str] | None,
        typer.Option(
            help="Name or address at which others connect to it, for command nodes and sensors that listen. "
            "localhost is always included. Can be repeated."
        ),
    ] = None,
    days: Annotated[int, typer.Option(min=1, max=3650, help=_DAYS)] = 365,
) -> None:
    """Make the certificate of a zenoh node, and admit the node in nodes.toml.

    The folder FOLDER/ROLE.NAME goes to the node's machine: `zenoh_tls` under `[links]` of a mission file, or
    `--zenoh-tls`.
    """
    from gcs.io.zenoh.certificate_authority import make_node

    with exit_on_error():
        folder = make_node(ca, name, role, host or [], days)
    _say(f"{folder}: certificate {folder.name} made, valid for {days} days. Copy this folder to its machine.")
    nodes = ca / "nodes.toml"
    _say(f"{nodes} lists it: command nodes and bridges need a copy of that file, and a new start.")


def _say(text: str) -> None:
    console_for(stderr=True).print(text, highlight=False, markup=False, soft_wrap=True)
