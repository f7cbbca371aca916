"""Scores of `gcs track`: of one data set, and their mean, deviation and interval over several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final, TypeAlias

import numpy as np

from gcs.io.detections.track_input import Detections
from gcs.model import FloatArray, Label
from gcs.tracking.metrics import Tracks, cardinality_error, gospa, identity_switches, ospa, ospa2

States: TypeAlias = dict[Label, FloatArray]
"""State (4,) by label at one scan."""

OSPA2_WINDOW_SCANS: Final = 10
CUTOFF_M: Final = 100.0
"""Cut-off c of OSPA and OSPA(2). That of GOSPA, and of pairs for identity switches, is half of it."""


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
    labels_per_object: float | None
    """Different labels over different true objects."""
    scan_ms_mean: float
    scan_ms_p99: float


def score(detections: Detections, tracked: Tracked, cutoff_m: float = CUTOFF_M) -> tuple[Scores, FloatArray]:
    """Return the scores, and for each scan with ground truth OSPA (m), found and true number (n, 3)."""
    times = tracked.scan_ms or [0.0]
    speed = (float(np.mean(times)), float(np.percentile(times, 99)))
    scored = [k for k in tracked.states if k in detections.truth]
    if not scored:
        return Scores(len(tracked.states), None, None, None, None, None, None, *speed), np.empty((0, 3))
    found = [{label: state[:2] for label, state in tracked.states[k].items()} for k in scored]
    true = [detections.truth[k] for k in scored]
    pairs = [(_points(x), _points(y)) for x, y in zip(found, true, strict=True)]
    near = [ospa(x, y, cutoff_m).total_m for x, y in pairs]
    windows = [slice(max(0, k - OSPA2_WINDOW_SCANS + 1), k + 1) for k in range(len(scored))]
    scores = Scores(
        len(tracked.states),
        float(np.mean(near)),
        float(np.mean([ospa2(found[w], true[w], cutoff_m).total_m for w in windows])),
        float(np.mean([gospa(x, y, cutoff_m / 2.0).total_m for x, y in pairs])),
        cardinality_error(found, true),
        identity_switches(found, true, cutoff_m / 2.0),
        len(set().union(*found)) / max(1, len(set().union(*true))),
        *speed,
    )
    counts = [(len(x), len(y)) for x, y in zip(found, true, strict=True)]
    return scores, np.column_stack([near, counts])


def _points(tracks: Tracks[Label] | Tracks[object]) -> FloatArray:
    return np.reshape(list(tracks.values()), (-1, 2))


def _names(cutoff_m: float) -> dict[str, tuple[str, str]]:
    """Return title and format of each score."""
    return {
        "ospa_mean_m": (f"OSPA (c {cutoff_m:g} m, p 1)", "{:.2f} m"),
        "ospa2_mean_m": (f"OSPA(2), window {OSPA2_WINDOW_SCANS}", "{:.2f} m"),
        "gospa_mean_m": (f"GOSPA (c {cutoff_m / 2.0:g} m, p 2)", "{:.2f} m"),
        "cardinality_error_mean": ("cardinality error", "{:.3f}"),
        "id_switches": ("identity switches", "{:g}"),
        "labels_per_object": ("labels per object", "{:.2f}"),
    }


def score_rows(scores: Scores, cutoff_m: float = CUTOFF_M) -> list[tuple[str, str]]:
    """Return name and text of each score."""
    time_row = ("time per scan", f"{scores.scan_ms_mean:.2f} ms, 99 % {scores.scan_ms_p99:.2f} ms")
    if scores.ospa_mean_m is None:
        return [("scores", "none: no ground truth (--truth)"), time_row]
    rows = [(name, form.format(getattr(scores, key))) for key, (name, form) in _names(cutoff_m).items()]
    return [*rows, time_row]


@dataclass(frozen=True, slots=True)
class Spread:
    """A score over several data sets."""

    mean: float
    std: float | None
    """Sample standard deviation; None for one set."""
    interval_95: tuple[float, float] | None
    """95 % confidence interval of the mean, by Student's t; None for one set."""


def spread_of(scores: Sequence[Scores]) -> dict[str, Spread | None]:
    """Return the spread of each score over the sets that have it; None if none has."""
    rows = [asdict(one) for one in scores]
    values = {name: [row[name] for row in rows if row[name] is not None] for name in rows[0]}
    return {name: _spread(np.array(found, np.float64)) if found else None for name, found in values.items()}


def _spread(values: FloatArray) -> Spread:
    from scipy.special import stdtrit

    mean = float(values.mean())
    n = values.size
    if n < 2:
        return Spread(mean, None, None)
    std = float(values.std(ddof=1))
    half = float(stdtrit(n - 1, 0.975)) * std / np.sqrt(n)
    return Spread(mean, std, (mean - float(half), mean + float(half)))


def spread_rows(
    spread: Mapping[str, Spread | None], cutoff_m: float = CUTOFF_M
) -> list[tuple[str, str, str, str]]:
    """Return name, mean, standard deviation and interval of each score, as texts."""
    named = {**_names(cutoff_m), "scan_ms_mean": ("time per scan", "{:.2f} ms")}
    rows = []
    for key, (name, form) in named.items():
        one = spread[key]
        if one is None:
            continue
        form = form.replace("{:g}", "{:.2f}")
        std = "" if one.std is None else form.format(one.std)
        interval = "" if one.interval_95 is None else " to ".join(form.format(x) for x in one.interval_95)
        rows.append((name, form.format(one.mean), std, interval))
    return rows
