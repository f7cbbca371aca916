"""Run of `gcs track`: estimators, output files and picture.

`gcs.tracking.batch` tracks.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from gcs.cli.analyse.info import reading_progress
from gcs.cli.analyse.track_scores import Scores, States, Tracked, score, score_rows, spread_of, spread_rows
from gcs.cli.arguments import check_picture
from gcs.cli.warm_up_progress import HISTORIES, TRACKING, load_kernels
from gcs.errors import ConfigError, RecordingError
from gcs.io.detections.track_input import Detections, load
from gcs.io.parquet import write_parquet
from gcs.io.recording.mcap_file import recording_bytes
from gcs.mistake_codes import MistakeCode
from gcs.model import FloatArray, IntArray, Label
from gcs.report.plots.track_figure import TrackingDrawing, draw_tracking
from gcs.tracking import Estimator
from gcs.tracking.batch import SensorScan, track_scans

_CSV_FORMATS: Final = dict.fromkeys(("x", "y", "vx", "vy"), ".4f") | {"existence": ".6f"}


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """The options of `gcs track`."""

    paths: tuple[Path, ...]
    """One or more."""
    model: Path | None
    truth: Path | None
    estimator: Estimator
    lag_scans: int | None
    cutoff_m: float
    out: Path | None
    plot: Path | None
    as_json: bool


def run_track(options: TrackOptions, console: Console) -> None:
    """Read and track the detections; write and print the result.

    Raises
    ------
    GcsError
        When a file is invalid, or the result cannot be written.
    """
    check_picture(options.plot)
    if options.lag_scans is not None and options.estimator != "smoothed":
        raise ConfigError(
            "--lag-scans",
            "",
            MistakeCode.CONFLICT,
            "is for smoothed paths: expected --estimator smoothed with it",
        )
    if len(options.paths) > 1:
        for option, path in (("-o", options.out), ("--plot", options.plot), ("--truth", options.truth)):
            if path is not None:
                raise ConfigError(
                    str(path),
                    option,
                    MistakeCode.CONFLICT,
                    f"is for one file: got {len(options.paths)} files",
                )
        _run_several(options, console)
    else:
        _run_one(options, console)


def _run_one(options: TrackOptions, console: Console) -> None:
    (path,) = options.paths
    _check_outputs(options)
    detections = _load_detections(path, options, console)
    load_kernels(console, TRACKING, HISTORIES)
    tracked = _track_with_progress(detections, options, console)
    scores, per_scan = score(detections, tracked, options.cutoff_m)
    if options.out is not None:
        _write(options.out, tracked, detections)
    if options.plot is not None:
        with console.status("drawing"):
            _draw(options, detections, tracked, scores, per_scan)
    _print_result(options, tracked, scores, console)
    _print_remarks(detections.remarks, console)
    if options.as_json:
        _print_json(asdict(scores) | {"remarks": list(detections.remarks)})


def _run_several(options: TrackOptions, console: Console) -> None:
    """Track each file by itself; print the spread of the scores over the files."""
    load_kernels(console, TRACKING, HISTORIES)
    scores: list[Scores] = []
    remarks: list[str] = []
    for path in options.paths:
        detections = _load_detections(path, options, console)
        tracked = _track_with_progress(detections, options, console)
        scores.append(score(detections, tracked, options.cutoff_m)[0])
        remarks += [f"{path}: {text}" for text in detections.remarks]
    spread = spread_of(scores)
    table = Table("", "mean", "deviation", "95 % interval of the mean")
    table.title = f"{len(scores)} files, {options.estimator}"
    for row in spread_rows(spread, options.cutoff_m):
        table.add_row(*row)
    console.print(table)
    _print_remarks(remarks, console)
    if options.as_json:
        files = [{"file": str(path)} | asdict(one) for path, one in zip(options.paths, scores, strict=True)]
        figures = {name: None if one is None else asdict(one) for name, one in spread.items()}
        _print_json({"files": files, "spread": figures, "remarks": remarks})


def _track_with_progress(detections: Detections, options: TrackOptions, console: Console) -> Tracked:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("tracking", total=len(detections.scans))
        return track_detections(
            detections, options.estimator, lambda: progress.advance(task), options.lag_scans
        )


def _print_remarks(remarks: Sequence[str], console: Console) -> None:
    for remark in remarks:
        console.print(remark, style="yellow", highlight=False, markup=False, soft_wrap=True)


def _print_json(result: Mapping[str, Any]) -> None:
    print(json.dumps(result), flush=True)  # noqa: T201  the output of --json


def _check_outputs(options: TrackOptions) -> None:
    """Refuse an output that is also an input or another output, or that cannot be written."""
    used = {path.resolve(): role for role, path in _inputs(options)}
    for option, path in (("-o", options.out), ("--plot", options.plot)):
        if path is None:
            continue
        if path.resolve() in used:
            raise ConfigError(
                str(path),
                option,
                MistakeCode.DUPLICATE,
                f"is {used[path.resolve()]} as well; expected another file",
            )
        used[path.resolve()] = option
        existing = next(part for part in (path.absolute(), *path.absolute().parents) if part.exists())
        if existing.is_dir() == (existing == path.absolute()):
            kind = "a directory" if existing.is_dir() else "no directory"
            raise ConfigError(
                str(path), option, MistakeCode.NO_ACCESS, f"cannot be written: {existing} is {kind}"
            )
        if not os.access(existing, os.W_OK):
            raise ConfigError(
                str(path), option, MistakeCode.NO_ACCESS, f"cannot be written: no permission for {existing}"
            )


def _inputs(options: TrackOptions) -> list[tuple[str, Path]]:
    (path,) = options.paths
    detections = path / "run.mcap" if path.is_dir() else path
    named = (("the file of detections", detections), ("--model", options.model), ("--truth", options.truth))
    return [(role, path) for role, path in named if path is not None]


def _load_detections(path: Path, options: TrackOptions, console: Console) -> Detections:
    if not path.is_dir() and path.suffix != ".mcap":
        detections = load(path, options.model, options.truth)
    else:
        with reading_progress(console, path, recording_bytes(path)) as advance:
            detections = load(path, options.model, options.truth, advance)
    detections.tracking_model()  # raises, before the kernels are loaded
    return detections


def track_detections(
    detections: Detections,
    estimator: Estimator,
    advance: Callable[[], object] = lambda: None,
    lag_scans: int | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Tracked:
    """Run the filter over all scans.

    Parameters
    ----------
    advance
        Called after each scan.
    lag_scans
        As for `gcs.tracking.track`.
    clock
        Time in seconds, for the time of a scan.
    """
    scan_ms: list[float] = []
    begin = 0.0

    def timed_scans() -> Iterator[SensorScan]:
        nonlocal begin
        for scan in detections.scans:
            begin = clock()
            yield scan

    def end_scan() -> None:
        scan_ms.append((clock() - begin) * 1e3)
        advance()

    found = track_scans(timed_scans(), detections.tracking_model(), estimator, lag_scans, end_scan)
    states: dict[int, States] = {k: {} for k in detections.scan_numbers.values()}
    existence: dict[int, dict[Label, float]] = {k: {} for k in states}
    for one in found.trajectories:
        for t_ns, mean, probability in zip(one.t_ns.tolist(), one.mean, one.existence.tolist(), strict=True):
            k = detections.scan_numbers[t_ns]
            states[k][one.label] = mean
            existence[k][one.label] = probability
    return Tracked(states, existence, scan_ms, found.late_scans, found.bad_detections)


def _numbers(tracked: Tracked) -> dict[Label, int]:
    """Number the labels from 1, in the order of their births."""
    labels = sorted({label for states in tracked.states.values() for label in states})
    return {label: n for n, label in enumerate(labels, 1)}


def _columns(tracked: Tracked, detections: Detections) -> dict[str, FloatArray | IntArray]:
    """Return the estimates as a table by columns; without times, k is the only time."""
    number = _numbers(tracked)
    t_ns = {k: t_ns for t_ns, k in detections.scan_numbers.items()}
    at = [(k, label) for k, states in sorted(tracked.states.items()) for label in sorted(states)]
    state = np.reshape([tracked.states[k][label] for k, label in at], (-1, 4))
    existence = [tracked.existence[k].get(label, 0.0) for k, label in at]
    columns: dict[str, FloatArray | IntArray] = {
        "k": np.array([k for k, _ in at], np.int64),
        "label": np.array([number[label] for _, label in at], np.int64),
    }
    columns |= {name: state[:, i] for i, name in enumerate(("x", "y", "vx", "vy"))}
    columns["existence"] = np.array(existence, np.float64)
    if detections.has_times:
        columns["t_ns"] = np.array([t_ns[k] for k, _ in at], np.int64)
    return columns


def _write(path: Path, tracked: Tracked, detections: Detections) -> None:
    columns = _columns(tracked, detections)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix.lower() == ".parquet":
            write_parquet(columns, path)
        else:
            path.write_text(_csv(columns), encoding="utf-8")
    except OSError as error:
        raise RecordingError(str(path), f"cannot be written: {error.strerror or error}") from None


def _csv(columns: Mapping[str, FloatArray | IntArray]) -> str:
    formats = [_CSV_FORMATS.get(name, "d") for name in columns]
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = [",".join(format(value, form) for value, form in zip(row, formats, strict=True)) for row in rows]
    return "\n".join([",".join(columns), *lines]) + "\n"


def _draw(
    options: TrackOptions, detections: Detections, tracked: Tracked, scores: Scores, per_scan: FloatArray
) -> None:
    plot = options.plot
    assert plot is not None
    title = f"{options.paths[0].name}, {options.estimator}"
    if scores.ospa_mean_m is not None:
        title += f": OSPA {scores.ospa_mean_m:.1f} m, OSPA(2) {scores.ospa2_mean_m:.1f} m"
    drawing = TrackingDrawing(
        title,
        detections_k=np.repeat(
            [float(detections.scan_numbers[scan.t_ns]) for scan in detections.scans],
            [len(scan.z_m) for scan in detections.scans],
        ),
        detections_m=np.concatenate([np.empty((0, 2)), *(scan.z_m for scan in detections.scans)]),
        found=tracked.states,
        true=detections.truth,
        ospa_m=dict(zip((k for k in tracked.states if k in detections.truth), per_scan[:, 0], strict=True)),
        cutoff_m=options.cutoff_m,
    )
    try:
        plot.parent.mkdir(parents=True, exist_ok=True)
        draw_tracking(drawing, plot)
    except OSError as error:
        raise RecordingError(str(plot), f"cannot be written: {error.strerror}") from None


def _print_result(options: TrackOptions, tracked: Tracked, scores: Scores, console: Console) -> None:
    table = Table(show_header=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    table.add_row("detections", str(options.paths[0]))
    table.add_row("estimator", options.estimator)
    table.add_row("scans", str(scores.scans))
    table.add_row("objects", str(len(_numbers(tracked))))
    for name, text in score_rows(scores, options.cutoff_m):
        table.add_row(name, text)
    if tracked.late_scans or tracked.bad_detections:
        table.add_row("not used", f"{tracked.late_scans} late scans, {tracked.bad_detections} bad detections")
    for name, path in (("estimates", options.out), ("picture", options.plot)):
        if path is not None:
            table.add_row(name, str(path))
    console.print(table)
