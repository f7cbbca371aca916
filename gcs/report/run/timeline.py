"""Timeline of a run: what figures, tables and claims need, gathered in one pass.

`TimelineBuilder` keeps positions and times as packed numbers, without covariances. Memory grows with scans
times objects: about 500 bytes for each object and scan with ground truth, most of it for the evaluator.
Detections are thinned beyond `MAX_DETECTIONS`.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Cause,
    FloatArray,
    Kind,
    Label,
    Notice,
    Picture,
    Plan,
    Scan,
    Tick,
    Truth,
    UploadReport,
    read_only,
)
from gcs.report.run.evaluation import Evaluator, OspaSeries
from gcs.report.run.separation_losses import SeparationLoss, SeparationLosses

KINDS: tuple[Kind, ...] = ("agents", "targets")
MAX_DETECTIONS = 40_000
_CLUTTER_SIGMAS = 4.0
"""A detection farther than this from every living object is clutter."""
_TRUTH_LATE_SCANS = 20
"""Number of scans that wait for their ground truth, which may arrive later."""
_MAX_NOTICES = 500


@dataclass(frozen=True, slots=True)
class Path:
    """True positions of one object, scan by scan."""

    t_s: FloatArray
    """(n,) since the start of the run, while the object was alive."""
    points_m: FloatArray
    """(n, 2)."""
    is_lost: bool
    """True if the object was gone before the run ended."""

    def until(self, t_s: float) -> Path:
        """Return the part up to a time. It is lost in it only if it was over by then."""
        count = int(np.searchsorted(self.t_s, t_s, side="right"))
        return Path(self.t_s[:count], self.points_m[:count], self.is_lost and count == len(self.t_s))


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimated tracks of a tracker at one scan."""

    t_s: float
    points_m: FloatArray
    """(n, 2)."""
    labels: tuple[Label, ...]


@dataclass(frozen=True, slots=True)
class Decision:
    """One plan, without its routes."""

    t_s: float
    changed: tuple[int, ...]
    """Vehicles with a new route."""
    targets: dict[int, Label]
    """Target of every vehicle with a route."""
    ends_m: dict[int, tuple[float, float]]
    """End of each new route."""
    reason: str
    triggers: tuple[Cause, ...]


@dataclass(frozen=True, slots=True)
class SensorTimeline:
    """Scans of one sensor."""

    t_s: FloatArray
    """(n,) time of each measurement."""
    delay_s: FloatArray
    """(n,) from measurement to arrival."""
    detections: FloatArray
    """(n,)."""


@dataclass(frozen=True, slots=True)
class Timeline:
    """A run, ready to be drawn. Times are seconds since its start."""

    paths: dict[Kind, dict[int, Path]]
    """Ground truth; empty if unknown."""
    estimates: dict[Kind, tuple[Estimate, ...]]
    """Estimates of each scan, in order."""
    clutter_m: FloatArray
    """(n, 2) detections of no known object; all detections without ground truth."""
    every: int
    """`clutter_m` has every n-th detection."""
    sensors: dict[str, SensorTimeline]
    routes: tuple[tuple[int, float, FloatArray], ...]
    """(vehicle, time, (k, 2) points) of each new route."""
    decisions: tuple[Decision, ...]
    uploads: tuple[tuple[float, UploadReport], ...]
    """(end time, report)."""
    statuses: tuple[tuple[int, float, str], ...]
    """(vehicle, time, status)."""
    notices: tuple[tuple[float, Notice], ...]
    """Warnings and alarms; the first ones if there are many."""
    losses: tuple[SeparationLoss, ...]
    """Losses of separation."""
    ospa: dict[Kind, OspaSeries]
    late_ospa: dict[Kind, OspaSeries]
    """Of the estimates some scans late; empty series without them."""
    start_t_ns: int
    duration_s: float
    area_m: tuple[float, float, float, float]
    """east_min, north_min, east_max, north_max of the map."""

    @property
    def has_truth(self) -> bool:
        """True if there is ground truth."""
        return any(self.paths.values())

    def seconds(self, t_ns: int) -> float:
        """Return a time of the run as seconds since its start."""
        return (t_ns - self.start_t_ns) / NS_PER_S


def gather(values: Iterable[object]) -> Timeline:
    """Gather the timeline of a run from its events, effects and ground truth; other values are ignored."""
    builder = TimelineBuilder()
    for value in values:
        builder.add(value)
    return builder.build()


@dataclass(slots=True)
class _Trail:
    """Times and positions of one object."""

    t_ns: array[int] = field(default_factory=lambda: array("q"))
    points_m: array[float] = field(default_factory=lambda: array("d"))


@dataclass(slots=True)
class _Heard:
    measured_t_ns: array[int] = field(default_factory=lambda: array("q"))
    delay_s: array[float] = field(default_factory=lambda: array("d"))
    detections: array[float] = field(default_factory=lambda: array("d"))


class TimelineBuilder:
    """Builds the timeline of a run, value by value.

    Parameters
    ----------
    evaluator : Evaluator, optional
        Gets the same values and provides the OSPA.
    """

    def __init__(self, evaluator: Evaluator | None = None) -> None:
        self.evaluator = evaluator if evaluator is not None else Evaluator(0.0, ())
        self._trails: dict[Kind, dict[int, _Trail]] = {kind: {} for kind in KINDS}
        self._truth_t_ns = [0, 0]
        """Of the first and the last truth."""
        self._estimates: dict[tuple[Kind, int], tuple[npt.NDArray[np.float64], tuple[Label, ...]]] = {}
        self._waiting: dict[int, list[Scan]] = {}
        self._living: dict[int, FloatArray] = {}
        self._detections = _Thinned()
        self._sensors: dict[str, _Heard] = {}
        self._fields_m: dict[str, tuple[float, float, float, float]] = {}
        self._plans: list[Plan] = []
        self._marks: list[UploadReport | AgentStatus | Notice] = []
        self._notices = 0
        self._losses = SeparationLosses()
        self._span_t_ns: tuple[int, int] | None = None

    @property
    def start_t_ns(self) -> int:
        """Earliest time so far; 0 before the first."""
        return self._span_t_ns[0] if self._span_t_ns is not None else 0

    def add(self, value: object) -> None:
        """Add an event, an effect or ground truth; other values are ignored."""
        if isinstance(value, Notice):
            self._losses.add(value)
        match value:
            case Truth():
                self._truth(value)
            case Picture():
                self._reach(value.scan_t_ns)
                self._picture(value)
            case Scan():
                self._scan(value)
            case Plan():
                self._plans.append(value)
                self.evaluator.add_effect(value)
            case UploadReport() | AgentStatus():
                self._marks.append(value)
                self.evaluator.add_effect(value)
            case Notice(level="warning" | "alarm") if self._notices < _MAX_NOTICES:
                self._notices += 1
                self._marks.append(value)
            case Tick():
                self._reach(value.t_ns)
            case _:
                self.evaluator.add_effect(value)  # type: ignore[arg-type]  # passes over what says nothing

    def _reach(self, t_ns: int) -> None:
        first, last = self._span_t_ns or (t_ns, t_ns)
        self._span_t_ns = min(first, t_ns), max(last, t_ns)

    def _truth(self, truth: Truth) -> None:
        self._reach(truth.t_ns)
        self.evaluator.add_truth(truth)
        self._truth_t_ns = [self._truth_t_ns[0] or truth.t_ns, max(truth.t_ns, self._truth_t_ns[1])]
        living = []
        for thing in truth.objects:
            if thing.alive:
                trail = self._trails[thing.kind].setdefault(thing.id, _Trail())
                trail.t_ns.append(truth.t_ns)
                trail.points_m.extend((thing.east_m, thing.north_m))
                living.append((thing.east_m, thing.north_m))
        self._living[truth.t_ns] = read_only(np.reshape(living, (-1, 2)))
        for scan in self._waiting.pop(truth.t_ns, ()):
            self._sort_out(scan)
        while len(self._living) > 2 * _TRUTH_LATE_SCANS:
            del self._living[next(iter(self._living))]

    def _picture(self, picture: Picture) -> None:
        shown = [track for track in picture.tracks if track.estimated]
        points = np.array([track.mean[:2] for track in shown]).reshape(-1, 2)
        key = (picture.kind, picture.scan_t_ns)
        self._estimates[key] = points, tuple(track.label for track in shown)
        self.evaluator.add_effect(picture)

    def _scan(self, scan: Scan) -> None:
        sensor = scan.sensor
        received = self._sensors.setdefault(sensor.name, _Heard())
        received.measured_t_ns.append(scan.measured_t_ns)
        received.delay_s.append((scan.t_ns - scan.measured_t_ns) / NS_PER_S)
        received.detections.append(len(scan.z_m))
        self._fields_m[sensor.name] = sensor.field_of_view_m
        if scan.measured_t_ns in self._living:
            self._sort_out(scan)
            return
        self._waiting.setdefault(scan.measured_t_ns, []).append(scan)
        if len(self._waiting) > _TRUTH_LATE_SCANS:
            for late in self._waiting.pop(next(iter(self._waiting))):
                self._sort_out(late)

    def _sort_out(self, scan: Scan) -> None:
        """Keep the detections of no living object; all without ground truth."""
        z_m = scan.z_m
        living_m = self._living.get(scan.measured_t_ns, ())
        if len(living_m) and len(z_m):
            gaps_m = np.linalg.norm(z_m[:, np.newaxis] - np.asarray(living_m)[np.newaxis], axis=2).min(axis=1)
            z_m = z_m[gaps_m > _CLUTTER_SIGMAS * float(np.sqrt(scan.sensor.noise_cov_m2.trace()))]
        self._detections.add(z_m)

    def build(self) -> Timeline:
        """Return the timeline of all values so far."""
        for scans in self._waiting.values():
            for scan in scans:
                self._sort_out(scan)
        self._waiting.clear()
        start, end = self._span_t_ns or (0, 0)
        paths = {kind: self._paths(kind, start) for kind in KINDS}
        estimates = {kind: self._estimated(kind, start) for kind in KINDS}
        since = [((mark.t_ns - start) / NS_PER_S, mark) for mark in self._marks]
        return Timeline(
            paths=paths,
            estimates=estimates,
            clutter_m=self._detections.points_m(),
            every=self._detections.every,
            sensors={name: _sensor(received, start) for name, received in sorted(self._sensors.items())},
            routes=tuple(_routes(self._plans, paths["agents"], start)),
            decisions=tuple(_decision(plan, start) for plan in self._plans),
            uploads=tuple((t_s, mark) for t_s, mark in since if isinstance(mark, UploadReport)),
            statuses=tuple(
                (mark.vehicle, t_s, mark.status) for t_s, mark in since if isinstance(mark, AgentStatus)
            ),
            notices=tuple((t_s, mark) for t_s, mark in since if isinstance(mark, Notice)),
            losses=self._losses.build(),
            ospa={kind: self.evaluator.ospa(kind) for kind in KINDS},
            late_ospa={kind: self.evaluator.late_ospa(kind) for kind in KINDS},
            start_t_ns=start,
            duration_s=(end - start) / NS_PER_S,
            area_m=self._area(paths, estimates),
        )

    def _paths(self, kind: Kind, start_t_ns: int) -> dict[int, Path]:
        found = {}
        for number, trail in sorted(self._trails[kind].items()):
            t_ns, first = np.unique(np.array(trail.t_ns, dtype=np.int64), return_index=True)
            points_m = np.array(trail.points_m).reshape(-1, 2)[first]
            is_lost = int(t_ns[-1]) < self._truth_t_ns[1]
            found[number] = Path(read_only((t_ns - start_t_ns) / NS_PER_S), read_only(points_m), is_lost)
        return found

    def _estimated(self, kind: Kind, start_t_ns: int) -> tuple[Estimate, ...]:
        rows = sorted((t_ns, row) for (of, t_ns), row in self._estimates.items() if of == kind)
        return tuple(
            Estimate((t_ns - start_t_ns) / NS_PER_S, read_only(p), labels) for t_ns, (p, labels) in rows
        )

    def _area(
        self, paths: dict[Kind, dict[int, Path]], estimates: dict[Kind, tuple[Estimate, ...]]
    ) -> tuple[float, float, float, float]:
        corners = [path.points_m for kind in paths.values() for path in kind.values()]
        fields_m = [np.reshape(field_m, (2, 2)) for field_m in self._fields_m.values()]
        if self._detections.seen and np.isfinite(fields_m).all():
            corners += fields_m
        else:  # no sensor, one without detections, or one without a field of view
            corners += [estimate.points_m for kind in estimates.values() for estimate in kind]
            corners.append(self._detections.points_m())
        return area_of(corners)


def area_of(corners: Iterable[npt.ArrayLike]) -> tuple[float, float, float, float]:
    """Return east_min, north_min, east_max, north_max of (n, 2) points; a square kilometre for none."""
    points = np.concatenate([np.empty((0, 2)), *(np.reshape(one, (-1, 2)) for one in corners)])
    if not len(points):
        return (0.0, 0.0, 1000.0, 1000.0)
    west, south = points.min(axis=0)
    east, north = points.max(axis=0)
    return (float(west), float(south), float(east), float(north))


class _Thinned:
    """Points of which every second is dropped each time there are too many."""

    def __init__(self) -> None:
        self.every = 1
        self.seen = 0
        self._points: list[FloatArray] = []
        self._kept = 0

    def add(self, points_m: FloatArray) -> None:
        """Add (n, 2) points."""
        kept = points_m[-self.seen % self.every :: self.every]
        self.seen += len(points_m)
        self._points.append(kept)
        self._kept += len(kept)
        if self._kept > MAX_DETECTIONS:
            self.every *= 2
            self._points = [np.concatenate(self._points)[::2]]
            self._kept = len(self._points[0])

    def points_m(self) -> FloatArray:
        """Return the remaining points."""
        return read_only(np.concatenate([np.empty((0, 2)), *self._points]))


def _sensor(received: _Heard, start_t_ns: int) -> SensorTimeline:
    t_s = (np.array(received.measured_t_ns, dtype=np.int64) - start_t_ns) / NS_PER_S
    return SensorTimeline(read_only(t_s), read_only(received.delay_s), read_only(received.detections))


def _decision(plan: Plan, start_t_ns: int) -> Decision:
    return Decision(
        t_s=(plan.t_ns - start_t_ns) / NS_PER_S,
        changed=plan.changed,
        targets={route.vehicle: route.target for route in plan.routes},
        ends_m={
            route.vehicle: route.target_point_m for route in plan.routes if route.vehicle in plan.changed
        },
        reason=plan.reason,
        triggers=plan.causes,
    )


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
