"""What all commands share: arguments, tab completion, and how an error is shown."""

from __future__ import annotations

from typing import Annotated

import typer

from gcs.cli.errors import complain
from gcs.errors import GcsError, InterruptedRunError


def complete_scenario(incomplete: str) -> list[str]:
    """Names of shipped scenarios for tab completion."""
    from gcs.config import scenario_names

    return [name for name in scenario_names() if name.startswith(incomplete)]


ScenarioArgument = Annotated[
    str,
    typer.Argument(
        help="Name of a shipped scenario (see `gcs scenarios`) or a mission file.",
        autocompletion=complete_scenario,
    ),
]
ConfigArgument = Annotated[
    str,
    typer.Argument(
        help="A mission file, or the name of a shipped scenario.",
        metavar="CONFIG",
        autocompletion=complete_scenario,
    ),
]
SeedOption = Annotated[
    int, typer.Option(min=0, help="Makes everything random: obstacles, deaths, targets, noise.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="End with one JSON object on its own line.")]


class errors_shown:  # noqa: N801  reads as a statement
    """Turn an error of ours into one readable line and an exit code."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, _type: object, error: BaseException | None, _trace: object) -> None:
        if isinstance(error, GcsError):
            raise typer.Exit(complain(error)) from None
        if isinstance(error, MemoryError):
            raise typer.Exit(complain(GcsError("this needs more memory than there is"))) from None
        if isinstance(error, KeyboardInterrupt):
            raise typer.Exit(complain(InterruptedRunError("it was not done yet"))) from None
