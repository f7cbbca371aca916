"""`gcs track`: a tracker alone on recorded detections, judged where the truth is known.

Three estimators of the same filter: "filtered" is what one knew at each scan, "recovered" the whole paths
from their association histories, each state by the detections up to it, and "smoothed" these by all
detections (see `gcs.tracking.trajectories.recovery`).
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from gcs.cli.warm_up_progress import HISTORIES, TRACKING, load_kernels
from gcs.errors import ConfigError, RecordingError
from gcs.io.detections.readers import Detections, load
from gcs.model import FloatArray, Label
from gcs.report.plots.tracking import Drawing, draw_tracking
from gcs.tracking.glmb.filter import Birth, Glmb
from gcs.tracking.metrics import Tracks, cardinality_error, gospa, identity_switches, ospa, ospa2
from gcs.tracking.models.adaptive_birth import AdaptiveBirth

Estimator: TypeAlias = Literal["filtered", "recovered", "smoothed"]
States: TypeAlias = dict[Label, FloatArray]
"""(4,) state by label at one scan."""

WINDOW_SCANS = 10
"""Of OSPA(2)."""
_SEED = 1
_PICTURES = (".png", ".pdf", ".svg")


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """What the command line says."""

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
    """What came out of it."""

    states: dict[int, States]
    """By scan number k."""
    existence: dict[int, dict[Label, float]]
    """As the filter saw it at k."""
    scan_ms: list[float]
    late_scans: int
    bad_detections: int


@dataclass(frozen=True, slots=True)
class Scores:
    """The result in numbers; None where the truth is not known."""

    scans: int
    ospa_mean_m: float | None
    ospa2_mean_m: float | None
    gospa_mean_m: float | None
    cardinality_error_mean: float | None
    id_switches: int | None
    scan_ms_mean: float
    scan_ms_p99: float


def run_track(options: TrackOptions, console: Console) -> None:
    """Read, track, write, and print how good and how fast it was.

    Raises
    ------
    GcsError
        When a file is not what it should be, or the result cannot be written.
    """
    if options.plot is not None and options.plot.suffix.lower() not in _PICTURES:
        raise ConfigError(str(options.plot), "", f"expected a name that ends in {', '.join(_PICTURES)}")
    if options.lag_scans is not None and options.estimator != "smoothed":
        raise ConfigError(
            "--lag-scans", "", "a lag is of smoothed paths: expected --estimator smoothed with it"
        )
    _check_outputs(options)
    detections = _loaded(options, console)
    if not detections.births and detections.anywhere.per_s <= 0.0:
        where = str(options.model or options.path)
        raise ConfigError(where, "births", "expected places where objects appear, or anywhere.per_s > 0")
    load_kernels(console, TRACKING, HISTORIES)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("tracking", total=len(detections.looks))
        tracked = track(detections, options.estimator, lambda: progress.advance(task), options.lag_scans)
    scores, per_scan = score(detections, tracked)
    if options.out is not None:
        _write(options.out, tracked, detections)
    if options.plot is not None:
        with console.status("drawing"):
            _draw(options, detections, tracked, scores, per_scan)
    _show(options, tracked, scores, console)
    for remark in detections.remarks:
        console.print(remark, style="yellow", highlight=False, markup=False, soft_wrap=True)
    if options.as_json:
        print(json.dumps(asdict(scores) | {"remarks": list(detections.remarks)}), flush=True)  # noqa: T201  the promised last line


def _check_outputs(options: TrackOptions) -> None:
    """Refuse to write over what is read, two results to one file, or where nothing can be written."""
    names = {path.resolve(): what for what, path in _inputs(options)}
    for what, path in (("-o", options.out), ("--plot", options.plot)):
        if path is None:
            continue
        if path.resolve() in names:
            raise ConfigError(str(path), what, f"is {names[path.resolve()]} as well; expected another file")
        names[path.resolve()] = what
        there = next(place for place in (path.absolute(), *path.absolute().parents) if place.exists())
        if there.is_dir() == (there == path.absolute()):
            is_what = "a directory" if there.is_dir() else "no directory"
            raise ConfigError(str(path), what, f"cannot be written: {there} is {is_what}")
        if not os.access(there, os.W_OK):
            raise ConfigError(str(path), what, f"cannot be written: no permission for {there}")


def _inputs(options: TrackOptions) -> list[tuple[str, Path]]:
    detections = options.path / "run.mcap" if options.path.is_dir() else options.path
    named = (("the file of detections", detections), ("--model", options.model), ("--truth", options.truth))
    return [(what, path) for what, path in named if path is not None]


def _loaded(options: TrackOptions, console: Console) -> Detections:
    if not options.path.is_dir() and options.path.suffix != ".mcap":
        return load(options.path, options.model, options.truth)
    # Here, since what reads recordings knows all that is in them.
    from gcs.cli.analyse.info import reading_progress
    from gcs.io.recording.reader import recording_bytes

    with reading_progress(console, options.path, recording_bytes(options.path)) as advance:
        return load(options.path, options.model, options.truth, advance)


def track(
    detections: Detections,
    estimator: Estimator,
    advance: Callable[[], object] = lambda: None,
    lag_scans: int | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Tracked:
    """Run the filter over all scans; `advance` is called after each, `clock` (seconds) before and after.

    With `lag_scans`, a smoothed state knows the detections of so many later scans, else of all.
    """
    anywhere, accel_std_m_s2 = detections.anywhere, detections.params.accel_std_m_s2
    tracker = Glmb(
        "targets",
        detections.params,
        _SEED,
        keep_histories=estimator != "filtered",
        summarise_detections=anywhere.per_s > 0.0,
    )
    unknown = AdaptiveBirth(anywhere.per_s, anywhere.speed_std_m_s, anywhere.most_probability, accel_std_m_s2)
    places = detections.births
    states: dict[int, States] = {k: {} for k in detections.number.values()}
    existence: dict[int, dict[Label, float]] = {k: {} for k in states}
    number_of_scan: list[int] = []
    scan_ms: list[float] = []
    for look in detections.looks:
        k = detections.number[look.t_ns]
        again = bool(number_of_scan) and number_of_scan[-1] == k
        begin = clock()
        # Places keep their numbers: at the same moment they do not give birth again.
        born = tuple(replace(place, probability=0.0) for place in places) if again else places
        if anywhere.per_s > 0.0:
            born = (*born, *unknown.births(look.t_ns))
        tracker.update(look.t_ns, look.z_m, look.sensor, born)
        if tracker.detection_summary is not None:
            unknown.add_scan(look.t_ns, look.z_m, look.sensor, tracker.detection_summary.explained)
        found = tracker.estimates()
        scan_ms.append((clock() - begin) * 1e3)
        advance()
        if tracker.scans == len(number_of_scan):
            continue  # refused as late
        number_of_scan.append(k)
        labels = [(scan, place) for scan, place in found.label.tolist()]
        states[k] = {labels[i]: found.mean[i] for i in np.flatnonzero(found.estimated)}
        existence[k] = dict(zip(labels, found.existence.tolist(), strict=True))
        if detections.birth_again_probability is not None:
            places = _again(places, states[k], detections.birth_again_probability)
    if tracker.histories is not None:
        states = {k: {} for k in states}
        for path in tracker.histories.paths(smooth=estimator == "smoothed", lag_scans=lag_scans):
            for scan, mean in zip(path.scan, path.mean, strict=True):
                states[number_of_scan[scan]][path.label] = mean
    return Tracked(states, existence, scan_ms, tracker.late_scans, tracker.bad_detections)


def _again(places: tuple[Birth, ...], states: States, probability: float) -> tuple[Birth, ...]:
    """Let places where somebody was born give birth again so probably; the same tuple if nothing changes."""
    once = {place for _, place in states if place < len(places) and places[place].probability != probability}
    if not once:
        return places
    return tuple(replace(p, probability=probability) if i in once else p for i, p in enumerate(places))


def score(detections: Detections, tracked: Tracked) -> tuple[Scores, FloatArray]:
    """Return the scores, and OSPA and number found and true (n, 3) of each scan that has a truth."""
    times = tracked.scan_ms or [0.0]
    speed = (float(np.mean(times)), float(np.percentile(times, 99)))
    judged = [k for k in tracked.states if k in detections.truth]
    if not judged:
        return Scores(len(tracked.states), None, None, None, None, None, *speed), np.empty((0, 3))
    found = [{label: state[:2] for label, state in tracked.states[k].items()} for k in judged]
    true = [detections.truth[k] for k in judged]
    near = [ospa(_points(x), _points(y)).total_m for x, y in zip(found, true, strict=True)]
    windows = [slice(max(0, k - WINDOW_SCANS + 1), k + 1) for k in range(len(judged))]
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
    """Labels as whole numbers from 1, in the order of their births."""
    labels = sorted({label for states in tracked.states.values() for label in states})
    return {label: n for n, label in enumerate(labels, 1)}


def _write(path: Path, tracked: Tracked, detections: Detections) -> None:
    number = _numbers(tracked)
    # Where scans are counted, k is all there is to say.
    times = {k: f",{t_ns}" if detections.timed else "" for t_ns, k in detections.number.items()}
    lines = ["k,label,x,y,vx,vy,existence" + (",t_ns" if detections.timed else "")]
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
    drawing = Drawing(
        title,
        detections_k=np.repeat(
            [float(detections.number[look.t_ns]) for look in detections.looks],
            [len(look.z_m) for look in detections.looks],
        ),
        detections_m=np.concatenate([np.empty((0, 2)), *(look.z_m for look in detections.looks)]),
        found=tracked.states,
        true=detections.truth,
        ospa_m=dict(zip((k for k in tracked.states if k in detections.truth), per_scan[:, 0], strict=True)),
    )
    try:
        options.plot.parent.mkdir(parents=True, exist_ok=True)
        draw_tracking(drawing, options.plot)
    except OSError as error:
        raise RecordingError(str(options.plot), f"cannot be written: {error.strerror}") from None


def _show(options: TrackOptions, tracked: Tracked, scores: Scores, console: Console) -> None:
    table = Table(show_header=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    table.add_row("detections", str(options.path))
    table.add_row("estimator", options.estimator)
    table.add_row("scans", str(scores.scans))
    table.add_row("objects", str(len(_numbers(tracked))))
    if scores.ospa_mean_m is None:
        table.add_row("scores", "none: the truth is not known (--truth)")
    else:
        table.add_row("OSPA (c 100 m, p 1)", f"{scores.ospa_mean_m:.2f} m")
        table.add_row(f"OSPA(2), window {WINDOW_SCANS}", f"{scores.ospa2_mean_m:.2f} m")
        table.add_row("GOSPA (c 50 m, p 2)", f"{scores.gospa_mean_m:.2f} m")
        table.add_row("cardinality error", f"{scores.cardinality_error_mean:.3f}")
        table.add_row("identity switches", str(scores.id_switches))
    table.add_row("time per scan", f"{scores.scan_ms_mean:.2f} ms, 99 % {scores.scan_ms_p99:.2f} ms")
    if tracked.late_scans or tracked.bad_detections:
        table.add_row("not used", f"{tracked.late_scans} late scans, {tracked.bad_detections} bad detections")
    for name, path in (("estimates", options.out), ("picture", options.plot)):
        if path is not None:
            table.add_row(name, str(path))
    console.print(table)
