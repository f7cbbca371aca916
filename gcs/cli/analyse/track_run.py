"""`gcs track`: tracking of recorded detections, scores, output files and picture.

The estimators use the same filter. "filtered" is the estimate at each scan. "recovered" are whole paths from
the association histories, each state from the detections up to it. "smoothed" are these paths from all
detections (see `gcs.tracking.trajectories.recovery`).
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from gcs.cli.analyse.info import reading_progress
from gcs.cli.analyse.track import Estimator
from gcs.cli.arguments import check_picture
from gcs.cli.warm_up_progress import HISTORIES, TRACKING, load_kernels
from gcs.errors import ConfigError, RecordingError
from gcs.io.detections.readers import Detections, load
from gcs.io.recording.mcap_file import recording_bytes
from gcs.model import FloatArray, Label
from gcs.report.plots.track_figure import TrackingDrawing, draw_tracking
from gcs.tracking.glmb.filter import Birth, Glmb
from gcs.tracking.metrics import Tracks, cardinality_error, gospa, identity_switches, ospa, ospa2
from gcs.tracking.models.adaptive_birth import AdaptiveBirth

States: TypeAlias = dict[Label, FloatArray]
"""State (4,) by label at one scan."""

OSPA2_WINDOW_SCANS: Final = 10
_SEED: Final = 1


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """The options of `gcs track`."""

    path: Path
    model: Path | None
    truth: Path | None
    estimator: Estimator
    lag_scans: int | None
    out: Path | None
    plot: Path | None
    as_json: bool


@dataclass(frozen=True, slots=True)
class Tracked:
    """Estimates of all scans."""

    states: dict[int, States]
    """By scan number k."""
    existence: dict[int, dict[Label, float]]
    """Existence probability by scan number and label."""
    scan_ms: list[float]
    late_scans: int
    bad_detections: int


@dataclass(frozen=True, slots=True)
class Scores:
    """Scores of the estimates; None without ground truth."""

    scans: int
    ospa_mean_m: float | None
    ospa2_mean_m: float | None
    gospa_mean_m: float | None
    cardinality_error_mean: float | None
    id_switches: int | None
    scan_ms_mean: float
    scan_ms_p99: float


def run_track(options: TrackOptions, console: Console) -> None:
    """Read and track the detections; write and print the result.

    Raises
    ------
    GcsError
        When a file is invalid, or the result cannot be written.
    """
    check_picture(options.plot)
    if options.lag_scans is not None and options.estimator != "smoothed":
        raise ConfigError("--lag-scans", "", "is for smoothed paths: expected --estimator smoothed with it")
    _check_outputs(options)
    detections = _load_detections(options, console)
    if not detections.births and detections.anywhere.per_s <= 0.0:
        where = str(options.model or options.path)
        raise ConfigError(where, "births", "expected birth components, or anywhere.per_s > 0")
    load_kernels(console, TRACKING, HISTORIES)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("tracking", total=len(detections.scans))
        tracked = track_detections(
            detections, options.estimator, lambda: progress.advance(task), options.lag_scans
        )
    scores, per_scan = score(detections, tracked)
    if options.out is not None:
        _write(options.out, tracked, detections)
    if options.plot is not None:
        with console.status("drawing"):
            _draw(options, detections, tracked, scores, per_scan)
    _print_result(options, tracked, scores, console)
    for remark in detections.remarks:
        console.print(remark, style="yellow", highlight=False, markup=False, soft_wrap=True)
    if options.as_json:
        print(json.dumps(asdict(scores) | {"remarks": list(detections.remarks)}), flush=True)  # noqa: T201  the output of --json


def _check_outputs(options: TrackOptions) -> None:
    """Refuse an output that is also an input or another output, or that cannot be written."""
    used = {path.resolve(): role for role, path in _inputs(options)}
    for option, path in (("-o", options.out), ("--plot", options.plot)):
        if path is None:
            continue
        if path.resolve() in used:
            raise ConfigError(str(path), option, f"is {used[path.resolve()]} as well; expected another file")
        used[path.resolve()] = option
        existing = next(part for part in (path.absolute(), *path.absolute().parents) if part.exists())
        if existing.is_dir() == (existing == path.absolute()):
            kind = "a directory" if existing.is_dir() else "no directory"
            raise ConfigError(str(path), option, f"cannot be written: {existing} is {kind}")
        if not os.access(existing, os.W_OK):
            raise ConfigError(str(path), option, f"cannot be written: no permission for {existing}")


def _inputs(options: TrackOptions) -> list[tuple[str, Path]]:
    detections = options.path / "run.mcap" if options.path.is_dir() else options.path
    named = (("the file of detections", detections), ("--model", options.model), ("--truth", options.truth))
    return [(role, path) for role, path in named if path is not None]


def _load_detections(options: TrackOptions, console: Console) -> Detections:
    if not options.path.is_dir() and options.path.suffix != ".mcap":
        return load(options.path, options.model, options.truth)
    with reading_progress(console, options.path, recording_bytes(options.path)) as advance:
        return load(options.path, options.model, options.truth, advance)


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
        Fixed lag of the smoother; None: all detections.
    clock
        Time in seconds, for the time of a scan.
    """
    anywhere = detections.anywhere
    params = detections.params
    tracker = Glmb(
        "targets",
        params,
        _SEED,
        keep_histories=estimator != "filtered",
        summarise_detections=anywhere.per_s > 0.0,
    )
    unknown = AdaptiveBirth(
        anywhere.per_s, anywhere.speed_std_m_s, anywhere.max_probability, params.process_noise
    )
    places = detections.births
    states: dict[int, States] = {k: {} for k in detections.scan_numbers.values()}
    existence: dict[int, dict[Label, float]] = {k: {} for k in states}
    number_of_scan: list[int] = []
    scan_ms: list[float] = []
    for scan in detections.scans:
        k = detections.scan_numbers[scan.t_ns]
        is_same_epoch = bool(number_of_scan) and number_of_scan[-1] == k
        begin = clock()
        # Components keep their numbers: a second scan at one epoch has no births.
        births = tuple(replace(place, probability=0.0) for place in places) if is_same_epoch else places
        if anywhere.per_s > 0.0:
            births = (*births, *unknown.births(scan.t_ns))
        tracker.update(scan.t_ns, scan.z_m, scan.sensor, births)
        if tracker.detection_summary is not None:
            unknown.add_scan(scan.t_ns, scan.z_m, scan.sensor, tracker.detection_summary.explained)
        found = tracker.estimates()
        scan_ms.append((clock() - begin) * 1e3)
        advance()
        if tracker.scans == len(number_of_scan):
            continue  # Refused as late.
        number_of_scan.append(k)
        labels = [(born, place) for born, place in found.label.tolist()]
        states[k] = {labels[i]: found.mean[i] for i in np.flatnonzero(found.estimated)}
        existence[k] = dict(zip(labels, found.existence.tolist(), strict=True))
        if detections.birth_again_probability is not None:
            places = _renew_births(places, states[k], detections.birth_again_probability)
    if tracker.histories is not None:
        states = {k: {} for k in states}
        for path in tracker.histories.paths(smooth=estimator == "smoothed", lag_scans=lag_scans):
            for n, mean in zip(path.scan, path.mean, strict=True):
                states[number_of_scan[n]][path.label] = mean
    return Tracked(states, existence, scan_ms, tracker.late_scans, tracker.bad_detections)


def _renew_births(places: tuple[Birth, ...], states: States, probability: float) -> tuple[Birth, ...]:
    """Set the probability of components that had a birth; return the same tuple if nothing changes."""
    used = {place for _, place in states if place < len(places) and places[place].probability != probability}
    if not used:
        return places
    return tuple(replace(p, probability=probability) if i in used else p for i, p in enumerate(places))


def score(detections: Detections, tracked: Tracked) -> tuple[Scores, FloatArray]:
    """Return the scores, and for each scan with ground truth OSPA (m), found and true number (n, 3)."""
    times = tracked.scan_ms or [0.0]
    speed = (float(np.mean(times)), float(np.percentile(times, 99)))
    scored = [k for k in tracked.states if k in detections.truth]
    if not scored:
        return Scores(len(tracked.states), None, None, None, None, None, *speed), np.empty((0, 3))
    found = [{label: state[:2] for label, state in tracked.states[k].items()} for k in scored]
    true = [detections.truth[k] for k in scored]
    near = [ospa(_points(x), _points(y)).total_m for x, y in zip(found, true, strict=True)]
    windows = [slice(max(0, k - OSPA2_WINDOW_SCANS + 1), k + 1) for k in range(len(scored))]
    scores = Scores(
        len(tracked.states),
        float(np.mean(near)),
        float(np.mean([ospa2(found[w], true[w]).total_m for w in windows])),
        float(np.mean([gospa(_points(x), _points(y)).total_m for x, y in zip(found, true, strict=True)])),
        cardinality_error(found, true),
        identity_switches(found, true),
        *speed,
    )
    counts = [(len(x), len(y)) for x, y in zip(found, true, strict=True)]
    return scores, np.column_stack([near, counts])


def _points(tracks: Tracks[Label] | Tracks[object]) -> FloatArray:
    return np.reshape(list(tracks.values()), (-1, 2))


def _numbers(tracked: Tracked) -> dict[Label, int]:
    """Number the labels from 1, in the order of their births."""
    labels = sorted({label for states in tracked.states.values() for label in states})
    return {label: n for n, label in enumerate(labels, 1)}


def _write(path: Path, tracked: Tracked, detections: Detections) -> None:
    number = _numbers(tracked)
    # Without times, k is the only column.
    times = {k: f",{t_ns}" if detections.has_times else "" for t_ns, k in detections.scan_numbers.items()}
    lines = ["k,label,x,y,vx,vy,existence" + (",t_ns" if detections.has_times else "")]
    for k, states in sorted(tracked.states.items()):
        for label, state in sorted(states.items()):
            x, y, vx, vy = state
            existence = tracked.existence[k].get(label, 0.0)
            lines.append(f"{k},{number[label]},{x:.4f},{y:.4f},{vx:.4f},{vy:.4f},{existence:.6f}{times[k]}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise RecordingError(str(path), f"cannot be written: {error.strerror}") from None


def _draw(
    options: TrackOptions, detections: Detections, tracked: Tracked, scores: Scores, per_scan: FloatArray
) -> None:
    assert options.plot is not None
    title = f"{options.path.name}, {options.estimator}"
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
    )
    try:
        options.plot.parent.mkdir(parents=True, exist_ok=True)
        draw_tracking(drawing, options.plot)
    except OSError as error:
        raise RecordingError(str(options.plot), f"cannot be written: {error.strerror}") from None


def _print_result(options: TrackOptions, tracked: Tracked, scores: Scores, console: Console) -> None:
    table = Table(show_header=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    table.add_row("detections", str(options.path))
    table.add_row("estimator", options.estimator)
    table.add_row("scans", str(scores.scans))
    table.add_row("objects", str(len(_numbers(tracked))))
    for name, text in score_rows(scores):
        table.add_row(name, text)
    if tracked.late_scans or tracked.bad_detections:
        table.add_row("not used", f"{tracked.late_scans} late scans, {tracked.bad_detections} bad detections")
    for name, path in (("estimates", options.out), ("picture", options.plot)):
        if path is not None:
            table.add_row(name, str(path))
    console.print(table)


def score_rows(scores: Scores) -> list[tuple[str, str]]:
    """Return name and text of each score."""
    time_row = ("time per scan", f"{scores.scan_ms_mean:.2f} ms, 99 % {scores.scan_ms_p99:.2f} ms")
    if scores.ospa_mean_m is None:
        return [("scores", "none: no ground truth (--truth)"), time_row]
    return [
        ("OSPA (c 100 m, p 1)", f"{scores.ospa_mean_m:.2f} m"),
        (f"OSPA(2), window {OSPA2_WINDOW_SCANS}", f"{scores.ospa2_mean_m:.2f} m"),
        ("GOSPA (c 50 m, p 2)", f"{scores.gospa_mean_m:.2f} m"),
        ("cardinality error", f"{scores.cardinality_error_mean:.3f}"),
        ("identity switches", str(scores.id_switches)),
        time_row,
    ]
