"""Run of `gcs montecarlo`: a campaign with its progress, results and report."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as Shown

from gcs.cli.warm_up_progress import LINKS, PLANNING, TRACKING, load_kernels
from gcs.errors import InterruptedRunError
from gcs.io.parquet import write_parquet
from gcs.io.terminal import console_for
from gcs.report.run.tables import Table
from sim_vehicles.campaign.campaign import Campaign, Job, Store, fly_all, fly_on_dask
from sim_vehicles.campaign.campaign_page import failures, overviews, write_report
from sim_vehicles.campaign.results import groups, write_csv


@dataclass(frozen=True, slots=True)
class MontecarloOptions:
    """The options of `gcs montecarlo`."""

    campaign: Campaign
    folder: str
    workers: int
    dask: str
    parquet: bool
    as_json: bool


def run_montecarlo(options: MontecarloOptions) -> bool:
    """Fly the missing missions; return True if all were complete.

    Raises
    ------
    GcsError
        When a scenario or setting is wrong, or the folder cannot be used.
    InterruptedRunError
        On Ctrl-C. Flown missions are kept; the same command continues.
    """
    console = console_for(stderr=options.as_json)
    folder = Path(options.folder)
    jobs = options.campaign.jobs()
    with closing(Store(folder)) as store:
        missing = [job for job in jobs if job.digest not in store.rows]
        if len(missing) < len(jobs):
            console.print(
                f"{len(jobs) - len(missing)} of {len(jobs)} missions were flown before", highlight=False
            )
        try:
            _fly(missing, options, store, console)
        except KeyboardInterrupt:
            left = sum(job.digest not in store.rows for job in jobs)
            raise InterruptedRunError(
                f"{left} missions are left: the same command goes on with them"
            ) from None
        rows = [store.rows[job.digest] for job in jobs]
    found = groups(rows)
    key = options.campaign.sweep_key
    write_csv(rows, folder / "results.csv")
    if options.parquet:
        fields = [msgspec.to_builtins(row) for row in rows]
        columns = {name: [row[name] for row in fields] for name in fields[0]}
        write_parquet(columns, folder / "results.parquet")
    with console.status("writing the report"):
        page = write_report(found, rows, key, options.campaign.settings, folder)
    for table in overviews(found, key):
        console.print(_shown(table))
    if any(row.outcome != "complete" for row in rows):
        console.print(_shown(failures(rows, key)))
    console.print(f"report: {page}", highlight=False, markup=False, soft_wrap=True)
    if options.as_json:
        # NaN becomes null: JSON has no NaN.
        print(msgspec.json.encode(found).decode(), flush=True)  # noqa: T201  the promised last line
    return all(row.outcome == "complete" for row in rows)


def _fly(jobs: Sequence[Job], options: MontecarloOptions, store: Store, console: Console) -> None:
    """Fly jobs and store their rows; show progress and failures."""
    if not jobs:
        return
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        TextColumn("{task.fields[failed]}"),
    )  # fmt: skip
    if not options.dask:
        load_kernels(console, TRACKING, PLANNING, LINKS)  # once, not in every worker
    rows = fly_on_dask(jobs, options.dask) if options.dask else fly_all(jobs, options.workers)
    failed = 0
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("missions", total=len(jobs), failed="")
        for row in rows:
            store.add(row)
            failed += row.outcome != "complete"
            progress.update(task, advance=1, failed=f"{failed} not complete" if failed else "")


def _shown(table: Table) -> Shown:
    """Return a table for the terminal."""
    shown = Shown(title=table.title, title_justify="left", caption=table.note or None, caption_justify="left")
    for column in table.columns:
        shown.add_column(column, justify="left" if column in table.left else "right")
    for row in table.rows:
        shown.add_row(*row)
    return shown
