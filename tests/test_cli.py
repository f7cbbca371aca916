"""The first screen of `gcs` shows its commands."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from gcs.cli import _COMMANDS, app, warm_up_progress


def test_version_is_that_of_the_package() -> None:
    shown = CliRunner().invoke(app, ["--version"])
    assert shown.exit_code == 0
    assert shown.stdout.strip() == f"gcs {importlib.metadata.version('swarm-gcs')}"


def test_help_lists_every_command_by_its_use() -> None:
    shown = CliRunner().invoke(app, ["--help"]).stdout
    places = [shown.index(title) for title in ("Fly", "Before a flight", "Recordings")]
    assert places == sorted(places)
    for command in ("demo", "montecarlo", "order", "preflight", "fence", "keys", "plan", "replay", "track"):
        assert f" {command} " in shown


@pytest.mark.parametrize(
    ("command", "module", "summary"),
    [(name, *row) for commands in _COMMANDS.values() for name, row in commands.items()],
)
def test_every_command_explains_itself_as_the_list_of_commands_does(
    command: str, module: str, summary: str
) -> None:
    shown = CliRunner().invoke(app, [command, "--help"])
    assert shown.exit_code == 0
    assert f"Usage: gcs {command} " in shown.stdout.replace("root", "gcs", 1)
    loaded = typer.main.get_command(importlib.import_module(module).app)
    assert (loaded.help or "").partition("\n")[0] == summary


def test_the_list_of_commands_loads_none_of_them() -> None:
    code = "import sys, gcs.cli; gcs.cli.app(['--help'], standalone_mode=False)\n"
    code += "print([name for name in ('numpy', 'zenoh', 'gcs.model', 'gcs.cli.fly') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_a_bridge_loads_no_engine() -> None:
    """That takes a second at each start of a bridge, and 60 MB."""
    code = "import sys, gcs.cli.fly.live_bridge\n"
    code += "heavy = ('gcs.core.engine', 'gcs.planning', 'gcs.tracking')\n"
    code += "print([name for name in heavy if name in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_the_help_of_a_command_loads_nothing_that_computes_or_flies() -> None:
    code = f"""
import sys
from gcs.cli import app
from sim_vehicles.cli import app as simulation

def check(command):
    heavy = ("numba", "scipy", "zenoh", "matplotlib", "gcs.core", "gcs.planning", "gcs.tracking.glmb")
    if loaded := [name for name in heavy if name in sys.modules]:
        sys.exit(f"{{command}} loads {{loaded}}")

for command in {[name for commands in _COMMANDS.values() for name in commands]}:
    app([command, "--help"], standalone_mode=False)
    check(command)
for command in ("run", "world", "simulate"):
    simulation([command, "--help"], standalone_mode=False)
    check(command)
"""
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_short_form_of_help_and_the_package_itself_are_understood() -> None:
    for arguments in (["-h"], ["order", "-h"], ["order", "hold", "-h"]):
        assert "Usage:" in CliRunner().invoke(app, arguments).stdout
    command = [sys.executable, "-P", "-m", "gcs", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("gcs ")


def test_warm_up_compiles_everything_and_a_flight_only_what_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, ...]] = []
    monkeypatch.setattr("gcs.jit.warm_up", lambda *modules, **_: asked.append(modules))
    shown = CliRunner().invoke(app, ["warm-up"])
    assert (shown.exit_code, shown.stdout.strip()) == (0, "all kernels are ready")
    warm_up_progress.load_kernels(Console(quiet=True))
    everything, flight = map(set, asked)
    more = {
        "gcs.tracking.trajectories.recovery",
        "gcs.tracking.state_space.filter",
        "gcs.planning.terrain.warm_up",
    }
    assert everything - flight == more, "for gcs track, and for missions over terrain"
    assert flight < everything


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in /proc")
def test_an_order_starts_no_threads_to_compute_with(tmp_path: Path) -> None:
    code = """
import os, sys
from gcs.cli import main
sys.argv = ["gcs", "order", "hold", "2"]
try:
    main()
except SystemExit as end:
    print(end.code, "numpy" in sys.modules, len(os.listdir("/proc/self/task")))
"""
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)}  # no service of others is found
    environment.pop("OPENBLAS_NUM_THREADS", None)
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.split() == ["1", "True", "1"], done.stderr


@pytest.mark.parametrize("option", [["--console", "here"], ["--sitl", "plane"]])
def test_a_wrong_option_is_refused_before_anything_starts(
    option: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["demo", *option])
    assert done.exit_code == 2
    assert "expected" in done.output
    assert "listens" not in done.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("typed", "expected"),
    [("gcs run --log-f", "--log-format"), ("gcs demo presc", "prescribed"), ("gcs order ho", "hold")],
)
def test_the_tab_key_completes_commands_options_and_scenarios(typed: str, expected: str) -> None:
    words = {"_GCS_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1)}
    command = [
        sys.executable,
        "-P",
        "-c",
        "import sys; sys.argv[0] = 'gcs'; from gcs.cli import main; main()",
    ]
    done = subprocess.run(command, env=os.environ | words, capture_output=True, text=True, check=False)
    assert done.stdout.split() == [expected]
