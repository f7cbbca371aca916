"""Campaigns: many missions on virtual time, over seeds, settings and planners, in many processes.

A campaign is a list of jobs. A job is the plain data of one mission and gives one row. Rows are appended to
``runs.jsonl`` in the campaign's folder: an interrupted campaign continues, and more seeds or values add rows.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Literal, cast

import msgspec
from rich.console import Console

from gcs.cli.warm_up_progress import LINKS, PLANNING, TRACKING, load_kernels
from gcs.config import read_text
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.errors import RecordingError
from gcs.io.recording.folder import versions
from gcs.model import Effect, Truth
from gcs.report.run.evaluation import evaluator_of
from sim_vehicles.campaign.ground_truth_trackers import GroundTruthTrackers
from sim_vehicles.campaign.loss_detection import LossWatch
from sim_vehicles.campaign.results import Row
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import parse_scenario

ROWS_NAME = "runs.jsonl"
Planner = Literal["own", "truth"]
"""Input of the planner: the tracks, or the ground truth."""


@dataclass(frozen=True, slots=True)
class Job:
    """One mission to fly."""

    text: str
    """Mission file with the settings."""
    scenario: str
    value: str
    """Value of the swept key; empty without a sweep."""
    seed: int
    planner: Planner
    loss: float

    @property
    def digest(self) -> str:
        """Digest of all inputs except software versions."""
        inputs = f"{self.text}\0{self.seed}\0{self.planner}\0{self.loss}"
        return hashlib.sha256(inputs.encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Campaign:
    """Missions of a campaign: all combinations of scenario, value, seed and planner."""

    scenarios: tuple[str, ...]
    runs: int
    seed: int = 1
    settings: tuple[str, ...] = ()
    sweep_key: str = ""
    sweep_values: tuple[str, ...] = ("",)
    loss: float = 0.0
    planners: tuple[Planner, ...] = ("own", "truth")

    def jobs(self) -> list[Job]:
        """Return all jobs, seed by seed, so that early results cover all scenarios.

        Raises
        ------
        ConfigError
            When a scenario, a setting or a value is wrong.
        """
        texts = []
        for scenario in self.scenarios:
            for value in self.sweep_values:
                swept = (f"{self.sweep_key}={value}",) if self.sweep_key else ()
                text, source = read_text(scenario, [*self.settings, *swept])
                name = parse_scenario(text, source).config.name
                texts.append((text, name, value))
        return [
            Job(text, name, value, seed, planner, self.loss)
            for seed in range(self.seed, self.seed + self.runs)
            for text, name, value in texts
            for planner in self.planners
        ]


def warm_up() -> None:
    """Load the compiled kernels without output."""
    load_kernels(Console(quiet=True), TRACKING, PLANNING, LINKS)


def fly(job: Job) -> Row:
    """Fly and evaluate one mission."""
    scenario = parse_scenario(job.text, job.scenario)
    config = scenario.config
    evaluator = evaluator_of(config)
    losses = LossWatch()
    truths = GroundTruthTrackers(config)
    run = VirtualRun(scenario, job.seed, loss=job.loss)

    def on_effect(_t_ns: int, effect: Effect) -> None:
        evaluator.add_effect(effect)
        losses.add_effect(effect)

    def on_truth(truth: Truth) -> None:
        truths.truth = truth
        evaluator.add_truth(truth)
        losses.add_truth(truth)

    run.on_effect = on_effect
    run.on_truth = on_truth
    if job.planner == "truth":
        run.engine.stages.trackers = trackers = cast("MultiSensorTracker", truths)
        run.engine.stages.planning_inputs = replace(run.engine.stages.planning_inputs, trackers=trackers)
    duration_s = run.run()
    summary = evaluator.summary(
        scenario=config.name,
        seed=job.seed,
        duration_s=duration_s,
        scan_ms_p99=0.0,
        plan_ms_p99=0.0,
        recording="",
    )
    return Row.of(job.value, job.planner, job.digest, summary, losses)


class Store:
    """Rows of a campaign, in its folder.

    Raises
    ------
    RecordingError
        When the folder has a campaign of other software versions, or cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / ROWS_NAME
        self.rows: dict[str, Row] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._check_versions(folder)
            self._read()
            self._file: IO[bytes] = self._path.open("ab")
        except OSError as error:
            raise RecordingError(str(folder), f"cannot be written to: {error}") from None

    def add(self, row: Row) -> None:
        """Append a row and flush it."""
        self.rows[row.digest] = row
        self._file.write(msgspec.json.encode(row) + b"\n")
        self._file.flush()

    def close(self) -> None:
        """Write all rows to the disk."""
        os.fsync(self._file.fileno())
        self._file.close()

    def _check_versions(self, folder: Path) -> None:
        path = folder / "versions.json"
        now = versions()
        with suppress(FileNotFoundError, json.JSONDecodeError):
            then = json.loads(path.read_text(encoding="utf-8"))
            changed = [
                f"{name} {then.get(name)} -> {now.get(name)}" for name in now if then.get(name) != now[name]
            ]
            if changed and self._path.exists():
                raise RecordingError(
                    str(folder),
                    f"was flown with other software ({', '.join(changed)}): choose another folder",
                )
        path.write_text(json.dumps(now, indent=1) + "\n", encoding="utf-8")

    def _read(self) -> None:
        """Read the stored rows; a truncated last line is removed."""
        if not self._path.exists():
            return
        whole = 0
        with self._path.open("rb") as file:
            for line in file:
                try:
                    row = msgspec.json.decode(line, type=Row) if line.endswith(b"\n") else None
                except msgspec.DecodeError:
                    row = None
                if row is None:
                    break
                self.rows[row.digest] = row
                whole += len(line)
        os.truncate(self._path, whole)


def fly_all(jobs: Sequence[Job], workers: int) -> Iterator[Row]:
    """Fly jobs in `workers` processes, or in this one; yield rows as they come."""
    if workers == 1:
        warm_up()
        yield from map(fly, jobs)
        return
    with ProcessPoolExecutor(workers, initializer=warm_up) as pool:
        futures = [pool.submit(fly, job) for job in jobs]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def fly_on_dask(jobs: Sequence[Job], address: str, timeout_s: float = 10.0) -> Iterator[Row]:
    """Fly jobs on a Dask cluster with this project installed; yield rows as they come.

    Raises
    ------
    RecordingError
        When dask.distributed is not installed, or the address does not answer.
    """
    try:
        from distributed import Client
        from distributed import as_completed as completed
    except ImportError:
        raise RecordingError(address, "needs Dask: pip install 'swarm-gcs[campaign]'") from None
    try:
        client = Client(address, timeout=timeout_s)
    except (OSError, ValueError) as error:
        raise RecordingError(address, f"no Dask scheduler answers there: {error}") from None
    with client:
        futures = client.map(fly, jobs, pure=False)
        for _, row in completed(futures, with_results=True):
            yield row
