"""The ``gcs`` command. Each command has a file: its arguments, its work and its output.

- ``fly``: ``demo``, ``run``, ``console``, ``metrics``, ``status``, ``order``, ``simulate``, ``montecarlo``.
- ``prepare``: mission files, plans, vehicles and keys before a flight.
- ``analyse``: recordings and logs after a flight.
- `arguments`, `errors`: arguments of several commands; error messages and exit codes.
- `run_setup`, `warm_up_progress`: recorder, display and compiled kernels of a run.
- `live_view`, `link_table`, `status_tables`: what an operator sees.

A command's module is imported when the command is given, so that ``gcs order`` and ``gcs --help`` start
at once.

Exit codes: 0 success; 1 the mission, or a vehicle, did not do what it should; 2 a mistake in arguments or
files; 130 interrupted.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys
from importlib import import_module
from typing import Annotated, Any, Final

import typer
import typer.core

_COMMANDS: Final[dict[str, dict[str, tuple[str, str]]]] = {
    "Fly": {
        "demo": (
            "gcs.cli.fly.demo",
            "Fly a mission with simulated vehicles, over real MAVLink and real zenoh.",
        ),
        "simulate": ("gcs.cli.fly.simulate", "Fly simulated missions as fast as the machine can."),
        "montecarlo": (
            "gcs.cli.fly.montecarlo",
            "Fly many simulated missions and report success rates with confidence intervals.",
        ),
        "run": ("gcs.cli.fly.run", "Run central command on the links of a mission file, until Ctrl-C."),
        "console": (
            "gcs.cli.fly.console",
            "Serve the console of a service that runs elsewhere, until Ctrl-C.",
        ),
        "metrics": (
            "gcs.cli.fly.metrics",
            "Serve metrics of a running service for Prometheus, until Ctrl-C.",
        ),
        "foxglove": ("gcs.cli.fly.foxglove", "Show a running service in Foxglove, until Ctrl-C."),
        "tak": (
            "gcs.cli.fly.tak",
            "Show a running service on TAK (ATAK, WinTAK, a TAK server), until Ctrl-C.",
        ),
        "status": ("gcs.cli.fly.status", "Print the agents, targets and sensors of a running service."),
        "order": ("gcs.cli.fly.order", "Give orders to a running service (`gcs run` or `gcs demo`)."),
    },
    "Before a flight": {
        "scenarios": ("gcs.cli.prepare.scenarios", "List the shipped scenarios."),
        "warm-up": (
            "gcs.cli.prepare.warm_up",
            "Compile the kernels now, so that the first flight starts at once.",
        ),
        "init": ("gcs.cli.prepare.init", "Write a first mission file from a plan, a map, a log, or a link."),
        "doctor": (
            "gcs.cli.prepare.doctor",
            "Check this machine before it flies: clock, disk, ports, serial rights, kernels, versions.",
        ),
        "schema": ("gcs.cli.prepare.schema", "Print the JSON Schema of the mission file."),
        "check": ("gcs.cli.prepare.check", "Validate a mission file and print what it means."),
        "preflight": ("gcs.cli.prepare.preflight", "Check every vehicle, link and sensor before a flight."),
        "plan": ("gcs.cli.prepare.plan", "Plan routes once, without a flight."),
        "fence": (
            "gcs.cli.prepare.fence",
            "Upload, show or clear the fence and the rally points of vehicles.",
        ),
        "param": ("gcs.cli.prepare.param", "Read and set parameters of vehicles."),
        "keys": ("gcs.cli.prepare.keys", "Make keys for MAVLink 2 signing, and certificates for zenoh."),
    },
    "Recordings": {
        "replay": ("gcs.cli.analyse.replay", "Play a recording through central command again."),
        "report": ("gcs.cli.analyse.report", "Write a page about a run: maps, tracks, plans and times."),
        "export": (
            "gcs.cli.analyse.export",
            "Write flown paths, routes, targets and losses as KML, GeoJSON, GPX or for Foxglove.",
        ),
        "info": ("gcs.cli.analyse.info", "Summarise a recording, a log or a table of detections."),
        "track": ("gcs.cli.analyse.track", "Track recorded detections and score the result."),
    },
}
"""By help panel and command: its module, and its line in ``gcs --help``."""


class _LazyGroup(typer.core.TyperGroup):
    """Imports the module of a command when the command is given."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the name of the command in `args`, the command itself, and its own arguments."""
        name, _, rest = super().resolve_command(ctx, args)
        modules = {name: module for panel in _COMMANDS.values() for name, (module, _) in panel.items()}
        if name is None:
            return None, None, rest
        return name, typer.main.get_command(import_module(modules[name]).app), rest


app = typer.Typer(
    cls=_LazyGroup,
    help="""Central command for a swarm of fixed-wing vehicles.

    Tracks agents and targets through clutter, plans routes, uploads MAVLink missions, and re-tasks the agents
    that are left.

    Start with **gcs demo**.""",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)

for _panel, _commands in _COMMANDS.items():
    for _name, (_, _help) in _commands.items():
        app.command(_name, help=_help, rich_help_panel=_panel)(lambda: None)


def _show_version(is_wanted: bool) -> None:
    if is_wanted:
        import importlib.metadata

        typer.echo(f"gcs {importlib.metadata.version('swarm-gcs')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    pass


_GC_THRESHOLD: Final = 250_000
"""Objects allocated between garbage collections. Python's 700 costs an eighth of the start-up time."""

_SINGLE_THREADED: Final = ("order", "scenarios")
"""Commands that compute nothing. The threads of numpy's BLAS cost them a tenth of their time."""


def main() -> None:
    """Run the ``gcs`` command."""
    if sys.argv[1:2] and sys.argv[1] in _SINGLE_THREADED:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    atexit.register(gc.freeze)  # Skips Python's last collection.
    gc.set_threshold(_GC_THRESHOLD, *gc.get_threshold()[1:])
    app()
