"""Run of `gcs simulate`: evaluated missions on virtual time, and their table."""

from __future__ import annotations

import json
import time
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich import box
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from gcs.cli.warm_up_progress import flying, load_kernels
from gcs.io.recording.folder import Run, versions
from gcs.io.recording.recorder import DiskBudget, Recorder
from gcs.io.terminal import console_for
from gcs.model import Effect, Event, Truth
from gcs.report.run.evaluation import Summary, evaluator_of, summary_json
from gcs.report.run.summary import print_summary
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import Scenario, load


@dataclass(frozen=True, slots=True)
class SimulateOptions:
    """The options of `gcs simulate`."""

    scenario: str
    seed: int
    runs: int = 1
    as_json: bool = False
    out: str | None = None
    """Folder of the recordings; None: no recording."""
    loss: float = 0.0
    duration_s: float | None = None
    """Time limit of a run; None: that of the scenario."""


def simulate(options: SimulateOptions) -> bool:
    """Fly missions with successive seeds; return True if all were complete.

    Raises
    ------
    GcsError
        When the scenario is wrong, or the folder cannot be used.
    """
    scenario = load(options.scenario)
    seed = options.seed
    runs = options.runs
    out = None if options.out is None else Path(options.out)
    console = console_for(stderr=options.as_json)
    load_kernels(console, *flying(scenario.config))
    started = time.perf_counter()
    summaries = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=runs == 1) as progress:
        task = progress.add_task(scenario.config.name, total=runs)
        for one_seed in range(seed, seed + runs):
            folder = out if out is None or runs == 1 else out / f"{scenario.config.name}-{one_seed}"
            summaries.append(fly(scenario, one_seed, folder, options.loss, options.duration_s))
            progress.advance(task)
    wall_s = time.perf_counter() - started
    complete = sum(summary.outcome == "complete" for summary in summaries)
    ratio = sum(summary.duration_s for summary in summaries) / wall_s
    if runs == 1:
        print_summary(summaries[0], console)
    else:
        console.print(seeds_table(summaries))
    console.print(f"{complete} of {runs} complete; {ratio:.0f} times real time", highlight=False)
    if options.as_json:
        one = summary_json(summaries[0])
        many = {
            "scenario": scenario.config.name,
            "runs": [json.loads(summary_json(s)) for s in summaries],
            "complete": complete,
        }
        print(one if runs == 1 else json.dumps(many), flush=True)  # noqa: T201  the output of --json
    return complete == runs


def fly(
    scenario: Scenario,
    seed: int,
    folder: Path | None = None,
    loss: float = 0.0,
    duration_s: float | None = None,
) -> Summary:
    """Fly and evaluate one mission; record it in `folder` if given."""
    config = scenario.config
    evaluator = evaluator_of(config)
    budget = DiskBudget(int(config.recording.rotate_mb * 1e6))
    with (
        nullcontext()
        if folder is None
        else Recorder(folder, scenario.text, versions(), Run(config.name, seed), budget) as recorder
    ):

        def on_event(event: Event) -> None:
            if recorder is not None:
                recorder.record_event(event)

        def on_effect(t_ns: int, effect: Effect) -> None:
            evaluator.add_effect(effect)
            if recorder is not None:
                recorder.record_effect(t_ns, effect)

        def on_truth(truth: Truth) -> None:
            evaluator.add_truth(truth)
            if recorder is not None:
                recorder.record_truth(truth)

        run = VirtualRun(scenario, seed, on_event, on_effect, on_truth, loss)
        run.on_snapshot = None if recorder is None else recorder.record_snapshot
        flown_s = run.run(duration_s)
    timings = run.timings
    return evaluator.summary(
        scenario=config.name,
        seed=seed,
        duration_s=flown_s,
        scan_ms_p99=float(np.percentile(timings.scan_ms, 99)) if timings.scan_ms else 0.0,
        plan_ms_p99=float(np.percentile(timings.plan_ms, 99)) if timings.plan_ms else 0.0,
        recording="" if folder is None else str(folder),
    )


def seeds_table(summaries: list[Summary]) -> Table:
    """Return a table with a row for each seed, and the reasons of incomplete missions below."""
    reasons = [f"seed {s.seed}: {s.reason}" for s in summaries if s.outcome != "complete"]
    table = Table(
        title=f"{summaries[0].scenario}: {len(summaries)} seeds",
        caption="\n".join(reasons),
        title_justify="left",
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        padding=0,
        show_edge=False,
    )
    table.add_column("seed", justify="right")
    table.add_column("outcome", justify="left", no_wrap=True)
    for name in ("time\ns", "arrived", "lost", "targets", "re-tasks", "uploads"):
        table.add_column(name, justify="right")
    for kind in ("agents", "targets"):
        table.add_column(f"OSPA m\n{kind}", justify="right")
    for s in summaries:
        statuses = [agent.status for agent in s.agents]
        table.add_row(
            str(s.seed), s.outcome, f"{s.duration_s:.1f}", str(statuses.count("arrived")),
            str(statuses.count("lost")), f"{s.targets_reached}/{s.targets_total}", str(s.retasks),
            str(s.uploads), f"{s.ospa_agents_mean_m:.2f}", f"{s.ospa_targets_mean_m:.2f}",
        )  # fmt: skip
    return table
