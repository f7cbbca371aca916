"""Many seeds are read in a terminal: a row that is cut off says nothing."""

import io
import json
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from gcs.report.run.evaluation import AgentOutcome, Summary
from sim_vehicles.campaign.simulate import seeds_table


def summary(seed: int, outcome: str) -> Summary:
    return Summary(
        scenario="swarm-50",
        seed=seed,
        outcome=outcome,
        reason="the mission did not end: agents 1, 2 still flying",
        duration_s=1234.5,
        agents=tuple(AgentOutcome(n, "arrived", n) for n in range(1, 51)),
        targets_total=60,
        targets_reached=50,
        retasks=1234,
        retask_list=(),
        uploads=1234,
        upload_failures=0,
        ospa_agents_mean_m=12.34,
        ospa_targets_mean_m=23.45,
        loss_delays_s=(),
        losses=0,
        false_losses=0,
        scan_ms_p99=4.5,
        plan_ms_p99=31.0,
        recording="",
    )


@pytest.mark.parametrize("outcome", ["complete", "incomplete"])
def test_a_table_of_seeds_fits_a_terminal_of_eighty_columns(outcome: str) -> None:
    file = io.StringIO()
    Console(file=file, width=80, color_system=None).print(
        seeds_table([summary(99, outcome), summary(100, "complete")])
    )
    shown = file.getvalue()
    assert "…" not in shown
    for word in ("seed", "arrived", "lost", "targets", outcome, "1234.5", "50/60", "12.34", "23.45"):
        assert word in shown
    assert ("seed 99: the mission did not end" in shown) == (outcome == "incomplete")


def test_the_installed_package_flies_wherever_it_is_called(tmp_path: Path) -> None:
    for name in ("gcs", "sim_vehicles", "numba"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise SystemExit('of the working directory')\n")
    command = [sys.executable, "-P", "-c", "from gcs.cli import main; main()"]
    command += ["simulate", "prescribed", "--duration", "2", "--json"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100)
    assert json.loads(done.stdout)["outcome"] == "incomplete", done.stderr
