"""The course of a run, gathered into what a figure shows: paths, estimates, clutter, events."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gcs.model import (
    NS_PER_S,
    Fate,
    FloatArray,
    Kind,
    Picture,
    Plan,
    Scan,
    Tick,
    Truth,
    UploadReport,
    read_only,
)
from gcs.report.judge import Judge, OspaSeries

_CLUTTER_SIGMAS = 4.0
"""A detection farther than this from everything alive is clutter."""


@dataclass(frozen=True, slots=True)
class Path:
    """Where one object truly was, scan by scan."""

    t_s: FloatArray
    """(n,) since the start of the run, while it was alive."""
    points_m: FloatArray
    """(n, 2)."""
    dies: bool
    """It was gone before the run ended."""


@dataclass(frozen=True, slots=True)
class Course:
    """A run, ready to be drawn. Times are seconds since its start."""

    paths: dict[Kind, dict[int, Path]]
    estimates: dict[Kind, tuple[tuple[float, FloatArray], ...]]
    """(when, (n, 2) of confirmed tracks in metres), for each scan in order."""
    clutter_m: FloatArray
    """(n, 2) detections of nothing that is known."""
    routes: tuple[tuple[int, float, FloatArray], ...]
    """(vehicle, when, (k, 2) points) of each route that was newly planned."""
    uploads: tuple[tuple[int, float, bool], ...]
    """(vehicle, when, whether it succeeded)."""
    fates: tuple[tuple[int, float, str], ...]
    """(vehicle, when, fate)."""
    ospa: dict[Kind, OspaSeries]
    start_t_ns: int
    duration_s: float
    area_m: tuple[float, float, float, float]
    """east_min, north_min, east_max, north_max of everything."""


def gather(values: Iterable[object]) -> Course:
    """Gather the course of a run from its events, effects and truths; others are passed over."""
    truths: dict[int, Truth] = {}
    pictures: dict[tuple[Kind, int], Picture] = {}
    scans: list[Scan] = []
    plans: list[Plan] = []
    marks: list[UploadReport | Fate] = []
    times: list[int] = []
    judge = Judge(0.0, ())
    for value in values:
        match value:
            case Truth():
                truths[value.t_ns] = value
                judge.truth(value)
            case Picture():
                pictures[value.kind, value.scan_t_ns] = value
                judge.effect(value)
            case Scan():
                scans.append(value)
            case Plan():
                plans.append(value)
            case UploadReport() | Fate():
                marks.append(value)
            case Tick():
                times = [min([value.t_ns, *times]), max([value.t_ns, *times])]
    times += [*truths, *(t_ns for _, t_ns in pictures)]
    start = min(times, default=0)
    paths: dict[Kind, dict[int, Path]] = {kind: _paths(truths, kind, start) for kind in ("agents", "targets")}
    estimates = {kind: _estimates(pictures, kind, start) for kind in paths}
    since = [(mark, (mark.t_ns - start) / NS_PER_S) for mark in marks]
    return Course(
        paths=paths,
        estimates=estimates,
        clutter_m=_clutter(scans, truths),
        routes=tuple(_routes(plans, paths["agents"], start)),
        uploads=tuple((mark.vehicle, t_s, mark.ok) for mark, t_s in since if isinstance(mark, UploadReport)),
        fates=tuple((mark.vehicle, t_s, mark.fate) for mark, t_s in since if isinstance(mark, Fate)),
        ospa={kind: judge.ospa(kind) for kind in paths},
        start_t_ns=start,
        duration_s=(max(times, default=start) - start) / NS_PER_S,
        area_m=_area(scans, paths, estimates),
    )


def _paths(truths: dict[int, Truth], kind: Kind, start_t_ns: int) -> dict[int, Path]:
    rows: dict[int, list[tuple[float, float, float]]] = {}
    living: set[int] = set()
    for t_ns in sorted(truths):
        living = set()
        for thing in truths[t_ns].objects:
            if thing.kind == kind and thing.alive:
                living.add(thing.id)
                row = ((t_ns - start_t_ns) / NS_PER_S, thing.east_m, thing.north_m)
                rows.setdefault(thing.id, []).append(row)
    arrays = {number: read_only(rows[number]) for number in sorted(rows)}
    return {n: Path(a[:, 0], a[:, 1:], dies=n not in living) for n, a in arrays.items()}


def _estimates(
    pictures: dict[tuple[Kind, int], Picture], kind: Kind, start_t_ns: int
) -> tuple[tuple[float, FloatArray], ...]:
    found = []
    for t_ns in sorted(t_ns for picture_kind, t_ns in pictures if picture_kind == kind):
        confirmed = [t.mean[:2] for t in pictures[kind, t_ns].tracks if t.estimated]
        found.append(((t_ns - start_t_ns) / NS_PER_S, read_only(np.reshape(confirmed, (-1, 2)))))
    return tuple(found)


def _clutter(scans: list[Scan], truths: dict[int, Truth]) -> FloatArray:
    found = [np.empty((0, 2))]
    for scan in scans:
        z_m = scan.z_m
        truth = truths.get(scan.measured_t_ns)
        living = [(t.east_m, t.north_m) for t in truth.objects if t.alive] if truth is not None else []
        if living and len(z_m):
            gaps_m = np.linalg.norm(z_m[:, np.newaxis] - np.array(living)[np.newaxis], axis=2).min(axis=1)
            z_m = z_m[gaps_m > _CLUTTER_SIGMAS * float(np.sqrt(scan.sensor.noise_cov_m2.trace()))]
        found.append(z_m)
    return read_only(np.concatenate(found))


def _routes(
    plans: list[Plan], agents: dict[int, Path], start_t_ns: int
) -> Iterable[tuple[int, float, FloatArray]]:
    for plan in plans:
        t_s = (plan.t_ns - start_t_ns) / NS_PER_S
        for route in plan.routes:
            if route.vehicle not in plan.changed:
                continue
            points = route.points_m
            path = agents.get(route.vehicle)
            if path is not None:
                here = [np.interp(t_s, path.t_s, path.points_m[:, axis]) for axis in (0, 1)]
                points = read_only(np.vstack([here, points]))
            yield route.vehicle, t_s, points


def _area(
    scans: list[Scan],
    paths: dict[Kind, dict[int, Path]],
    estimates: dict[Kind, tuple[tuple[float, FloatArray], ...]],
) -> tuple[float, float, float, float]:
    corners = [
        np.reshape(sensor.field_of_view_m, (2, 2))
        for sensor in {s.sensor.name: s.sensor for s in scans}.values()
    ]
    corners += [path.points_m for kind in paths.values() for path in kind.values()]
    if not scans:
        corners += [points for scans_of_kind in estimates.values() for _, points in scans_of_kind]
    points = np.concatenate([np.empty((0, 2)), *corners])
    if not len(points):
        return (0.0, 0.0, 1000.0, 1000.0)
    (west, south), (east, north) = points.min(axis=0), points.max(axis=0)
    return (float(west), float(south), float(east), float(north))
