"""`gcs schema`: print the JSON Schema of the mission file, or its reference."""

from __future__ import annotations

from typing import Annotated

import typer

from gcs.cli.arguments import command_app

app = command_app()


@app.command()
def schema(
    toml: Annotated[
        bool, typer.Option("--toml", help="Print the commented reference with every key instead.")
    ] = False,
) -> None:
    """Print the JSON Schema of the mission file.

    Editors complete, explain and check keys with it. Save it beside your mission files and begin each with
    the line `#:schema mission-file.json` (Even Better TOML, taplo).
    """
    from gcs.config.json_schema import mission_file_schema, reference_text

    if toml:
        typer.echo(reference_text(), nl=False)
        return
    import msgspec

    typer.echo(msgspec.json.format(msgspec.json.encode(mission_file_schema())).decode())
