"""The end of a run tells what happened, in a terminal and in a log."""

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from gcs.report.run.evaluation import AgentOutcome, Retask, Summary
from gcs.report.run.summary import print_summary

GOOD = Summary(
    scenario="prescribed",
    seed=4,
    outcome="complete",
    reason="1 of 2 agents arrived at distinct targets, agent 2 lost",
    duration_s=83.25,
    agents=(AgentOutcome(1, "arrived", 3), AgentOutcome(2, "lost", None)),
    targets_total=5,
    targets_reached=1,
    retasks=1,
    retask_list=(
        Retask(25.0, (1,), "agent 2 lost; target [0.3] moved 55 m", ("agent lost", "target moved")),
    ),
    uploads=4,
    upload_failures=1,
    ospa_agents_mean_m=3.456,
    ospa_targets_mean_m=float("nan"),
    loss_delays_s=(2.0,),
    losses=1,
    false_losses=0,
    scan_ms_p99=4.5,
    plan_ms_p99=31.0,
    recording="runs/prescribed-4",
)


def shown(summary: Summary, terminal: bool) -> str:
    console = Console(file=io.StringIO(), force_terminal=terminal, width=100, color_system=None)
    print_summary(summary, console, Path("runs/prescribed-4/run.png"), Path("runs/prescribed-4/firmware"))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


@pytest.mark.parametrize("terminal", [True, False])
def test_everything_a_user_asks_about_a_run_is_there(terminal: bool) -> None:
    text = shown(GOOD, terminal)
    for fact in (
        "prescribed, seed 4: complete after 83.2 s", "agent 2 lost", "arrived", "1 of 5",
        "1 of 1, after 2.0 s", "1 (1 agent lost, 1 target moved)",
        "4, 1 failed", "3.46 m", "not measured", "4.5 ms", "31.0 ms", "25.0 s",
        "target [0.3] moved 55 m", "runs/prescribed-4/run.png", "runs/prescribed-4/firmware",
        "gcs replay runs/prescribed-4", "gcs report runs/prescribed-4",
    ):  # fmt: skip
        assert fact in text, fact


def test_a_log_gets_plain_lines() -> None:
    assert all(ord(character) < 128 for character in shown(GOOD, terminal=False))
    assert "agent 1: arrived at target 3" in shown(GOOD, terminal=False)


@pytest.mark.parametrize("terminal", [True, False])
def test_a_large_swarm_fits_a_screen(terminal: bool) -> None:
    agents = tuple(AgentOutcome(n, "lost" if n % 5 == 0 else "arrived", None) for n in range(1, 51))
    retasks = tuple(Retask(float(n), (1, 2), "target 0.1 moved 60 m", ("target moved",)) for n in range(60))
    text = shown(replace(GOOD, agents=agents, retask_list=retasks, retasks=60), terminal)
    assert "and 45 more re-tasks" in text
    if terminal:
        assert "40 arrived" in text
        assert "10 lost" in text
        assert len(text.splitlines()) < 45


def test_false_losses_are_not_hidden() -> None:
    assert "; 2 false" in shown(replace(GOOD, false_losses=2), terminal=True)
