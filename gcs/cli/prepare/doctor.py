"""`gcs doctor`: check this machine before it flies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Final

import typer

from gcs.cli.arguments import JsonOption, command_app, complete_scenario
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gcs.io.machine_checks import Finding

app = command_app()

_STYLE: Final = {"ok": "green", "warning": "yellow", "problem": "bold red"}


@app.command()
def doctor(
    config: Annotated[
        str | None,
        typer.Argument(
            help="A mission file, or the name of a shipped scenario, whose ports are checked, too.",
            metavar="[CONFIG]",
            autocompletion=complete_scenario,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check this machine before it flies: clock, disk, ports, serial rights, kernels, versions.

    Changes nothing and sends nothing. Exit code 0: no problem; 1: a problem that has to be solved; 2: a
    mistake in the mission file.
    """
    import msgspec

    with exit_on_error(as_json=as_json):
        findings = list(_findings(config))
    console = console_for(stderr=as_json)
    for one in findings:
        console.print(
            f"[{_STYLE[one.level]}]{one.level:8}[/] [bold]{one.check}[/]: {one.found}", soft_wrap=True
        )
        if one.remedy:
            console.print(f"{'':9}{one.remedy}", soft_wrap=True, highlight=False)
    problems = sum(one.level == "problem" for one in findings)
    if as_json:
        result = {"ok": not problems, "problems": problems, "findings": findings}
        print(msgspec.json.encode(result).decode(), flush=True)  # noqa: T201  the output of --json
    raise typer.Exit(1 if problems else 0)


def _findings(scenario: str | None) -> Iterator[Finding]:
    from gcs.config import load
    from gcs.config.schema import RecordingTable
    from gcs.io.machine_checks import check_links, check_machine
    from gcs.io.recording.folder import RUNS_FOLDER

    config = None if scenario is None else load(scenario)
    recording = RecordingTable() if config is None else config.recording
    yield from check_machine(RUNS_FOLDER, recording.min_free_mb)
    yield _kernels()
    if config is not None:
        yield from check_links(config)


def _kernels() -> Finding:
    from gcs import jit
    from gcs.cli.warm_up_progress import ALL
    from gcs.io.machine_checks import Finding

    if all(map(jit.is_cached, ALL)):
        return Finding("kernels", "ok", "are compiled")
    return Finding(
        "kernels", "warning", "are not compiled yet", "gcs warm-up: half a minute on two free cores, once"
    )
