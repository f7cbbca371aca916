"""Data of the charts: how objects, existence, OSPA, links, batteries and computing times went over the run.

Times are in bins of equal width. When the run grows out of the bins, their width doubles, so that memory is
bounded however long the run is.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np

from gcs.console.view.page_records import ChartsReply, Series, Work
from gcs.mavlink.fleet.telemetry_table import BATTERY_PERCENT, FRAMES, LOST, NONE
from gcs.model import FloatArray, IntArray, Kind, Picture, Truth, track_name, vehicle_name

BINS: Final = 480
_MIN_WIDTH_S: Final = 0.5
_KINDS: Final[tuple[Kind, ...]] = ("agents", "targets")
_RATE_S: Final = 2.0
"""Rates are of this time, or of a bin if that is longer."""
MAX_TRACKS: Final = 64
"""Tracks of each kind whose existence is shown: those that existed most."""
_MIN_EXISTENCE: Final = 0.3
"""A track is shown once its existence was that large."""
_MAX_WAITING: Final = 40
"""Pictures that wait for the truth."""
_MAX_TRUTHS: Final = 4 * BINS


class _Line:
    """Sum, number and maximum of the values in each bin."""

    def __init__(self) -> None:
        self.total = np.zeros(BINS)
        self.count = np.zeros(BINS)
        self.peak = np.full(BINS, -np.inf)

    def add(self, index: int, value: float) -> None:
        """Add a value to a bin."""
        self.total[index] += value
        self.count[index] += 1
        self.peak[index] = max(self.peak[index], value)

    def halve(self) -> None:
        """Merge each two bins."""
        for name in ("total", "count"):
            merged = getattr(self, name).reshape(-1, 2).sum(axis=1)
            setattr(self, name, np.concatenate([merged, np.zeros(BINS // 2)]))
        self.peak = np.concatenate([self.peak.reshape(-1, 2).max(axis=1), np.full(BINS // 2, -np.inf)])

    def mean(self) -> FloatArray:
        """Return the mean of each bin; NaN for an empty one."""
        with np.errstate(invalid="ignore"):
            return np.where(self.count > 0, self.total / np.maximum(self.count, 1), np.nan)

    def max(self) -> FloatArray:
        """Return the maximum of each bin; NaN for an empty one."""
        return np.where(self.count > 0, self.peak, np.nan)


class ChartData:
    """Lines of all charts."""

    def __init__(self) -> None:
        self.width_s = _MIN_WIDTH_S
        """Width of a bin."""
        self._lines: dict[tuple[str, str], _Line] = {}
        self._used = 0
        self._last_s: dict[Kind, float] = {}
        """Time of the last picture of each kind."""
        self._truths: dict[int, Truth] = {}
        self._waiting: dict[tuple[Kind, int], tuple[float, FloatArray]] = {}

    def add_picture(self, t_s: float, picture: Picture) -> None:
        """Add the number of objects, and the existence of each track; some pictures a bin are enough."""
        kind = picture.kind
        if 0.0 <= t_s - self._last_s.get(kind, -np.inf) < self.width_s / 4.0:
            return
        self._last_s[kind] = t_s
        numbers = np.arange(len(picture.cardinality))
        mean = float(picture.cardinality @ numbers)
        self._add("objects", kind, t_s, mean)
        self._add("spread", kind, t_s, float(np.sqrt(picture.cardinality @ (numbers - mean) ** 2)))
        added = 0
        for track in picture.tracks:
            name = track_name(kind, track.label)
            is_new = (kind, name) not in self._lines
            if is_new and (track.existence < _MIN_EXISTENCE or added == MAX_TRACKS):
                continue
            added += is_new
            self._add(kind, name, t_s, track.existence)
        self._forget_tracks(kind)
        places = np.reshape([track.mean[:2] for track in picture.tracks if track.estimated], (-1, 2))
        self._waiting[kind, picture.scan_t_ns] = (t_s, places)
        self._compare(picture.scan_t_ns)

    def add_truth(self, truth: Truth) -> None:
        """Add the ground truth of a simulation."""
        self._truths[truth.t_ns] = truth
        self._compare(truth.t_ns)

    def add_telemetry(self, t_s: float, vehicles: Iterable[int], table: IntArray) -> None:
        """Add message counters and batteries."""
        for vehicle, row in zip(vehicles, table, strict=True):
            if row[FRAMES]:
                name = vehicle_name(vehicle)
                self._add("time", name, t_s, t_s)
                self._add("frames", name, t_s, float(row[FRAMES]))
                self._add("lost", name, t_s, float(row[LOST]))
                if row[BATTERY_PERCENT] != NONE:
                    self._add("battery", name, t_s, float(row[BATTERY_PERCENT]))

    def add_work(self, t_s: float, work: Work, took_ms: float) -> None:
        """Add the computing time of a scan or of a plan."""
        self._add("work", work, t_s, took_ms)

    def build(self, *, is_complete: bool) -> ChartsReply:
        """Return all lines; `is_complete` says that a recording was read to its end."""
        used = self._used
        rates = {name: self._rates(name) for name in self._names("frames")}
        return ChartsReply(
            width_s=self.width_s,
            bins=used,
            objects=self._means("objects"),
            spread=self._means("spread"),
            true=self._means("true"),
            ospa=self._means("ospa"),
            existence={kind: self._means(kind) for kind in _KINDS},
            rate={name: rate for name, (rate, _) in rates.items()},
            loss={name: loss for name, (_, loss) in rates.items()},
            battery=self._means("battery"),
            work={name: _listed(self._lines["work", name].max()[:used]) for name in self._names("work")},
            complete=is_complete,
        )

    def ospa_m(self, t_s: float) -> dict[Kind, float]:
        """Return the OSPA of each kind at the last scan until a time, as far as it is known."""
        found: dict[Kind, float] = {}
        for kind in _KINDS:
            line = self._lines.get(("ospa", kind), _Line())
            known = np.flatnonzero(line.count[: int(t_s / self.width_s) + 1])
            if len(known):
                found[kind] = round(float(line.mean()[known[-1]]), 2)
        return found

    def _add(self, chart: str, name: str, t_s: float, value: float) -> None:
        if t_s < 0.0 or not np.isfinite(value):
            return
        while t_s >= self.width_s * BINS:
            self.width_s *= 2.0
            self._used = (self._used + 1) // 2
            for line in self._lines.values():
                line.halve()
        index = int(t_s / self.width_s)
        self._used = max(self._used, index + 1)
        self._lines.setdefault((chart, name), _Line()).add(index, value)

    def _names(self, chart: str) -> list[Any]:
        return [name for of, name in self._lines if of == chart]

    def _means(self, chart: str) -> dict[Any, Series]:
        return {name: _listed(self._lines[chart, name].mean()[: self._used]) for name in self._names(chart)}

    def _rates(self, name: str) -> tuple[Series, Series]:
        """Return messages per second, and the percentage of messages lost, of a vehicle."""
        time_s, frames, lost = (
            self._lines[one, name].max()[: self._used] for one in ("time", "frames", "lost")
        )
        known = [-BINS]
        for index in np.flatnonzero(np.isfinite(time_s)).tolist():
            if (index - known[-1]) * self.width_s >= _RATE_S:
                known.append(index)
        del known[0]
        rate = np.full(self._used, np.nan)
        loss = np.full(self._used, np.nan)
        came = np.diff(frames[known])
        missed = np.diff(lost[known])
        with np.errstate(divide="ignore", invalid="ignore"):
            rate[known[1:]] = came / np.diff(time_s[known])
            loss[known[1:]] = 100.0 * np.maximum(missed, 0.0) / (came + np.maximum(missed, 0.0))
        return _listed(rate), _listed(loss)

    def _forget_tracks(self, kind: Kind) -> None:
        names = self._names(kind)
        if len(names) > MAX_TRACKS:
            for name in sorted(names, key=lambda one: self._lines[kind, one].total.sum())[:-MAX_TRACKS]:
                del self._lines[kind, name]

    def _compare(self, scan_t_ns: int) -> None:
        truth = self._truths.get(scan_t_ns)
        for kind in _KINDS if truth is not None else ():
            if (kind, scan_t_ns) not in self._waiting:
                continue
            t_s, places = self._waiting.pop((kind, scan_t_ns))
            assert truth is not None
            living = [(one.east_m, one.north_m) for one in truth.objects if one.kind == kind and one.alive]
            self._add("true", kind, t_s, len(living))
            self._add("ospa", kind, t_s, _ospa_m(np.reshape(living, (-1, 2)), places))
        while len(self._truths) > _MAX_TRUTHS:
            del self._truths[next(iter(self._truths))]
        while len(self._waiting) > _MAX_WAITING:
            del self._waiting[next(iter(self._waiting))]


def _ospa_m(truth_m: FloatArray, places_m: FloatArray) -> float:
    """Return the OSPA with the settings of reports."""
    # These load scipy, which would delay each console.
    from gcs.report.run.evaluation import OSPA_CUTOFF_M, OSPA_ORDER
    from gcs.tracking.metrics import ospa

    return ospa(truth_m, places_m, OSPA_CUTOFF_M, OSPA_ORDER).total_m


def _listed(values: FloatArray) -> Series:
    """Return a JSON array's values; None for NaN."""
    return [None if value != value else value for value in values.round(2).tolist()]
