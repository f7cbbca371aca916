"""What `gcs track` reads: detections with the model to track them by, and the truth where it is known.

- NPZ: `meas` with rows (k, x, y, ...), and optionally the model (`F, sigma_v, sigma_z, pS, pD, lambda_c`,
  `region, birth_mean, birth_std, r_birth, K`; state order px, vx, py, vy) and `truth` with rows
  (k, id, px, vx, py, vy).
- CSV: rows k,x,y; more columns are ignored. Its model is another file: such an NPZ, or TOML (`ModelTable`).
  With the titles t_s,x,y or t_ns,x,y the first column is the time of the scan: in seconds from some
  beginning, or nanoseconds since the Unix epoch. A row without x and y is a scan without detections. Titles
  also say which column is the sensor of each row and what a range/bearing sensor measured (`columns`).
- A recording of ours: its scans with what their sensors say of themselves, births from its mission file.

Scans are numbered; one without detections is a scan as well. The region of an NPZ is where its clutter is;
the probability of detection is the same everywhere, as in the model that the sets were drawn from (with a
sensor blind beyond the region, clutter that drifted out would live on there). Columns that say where a
detection truly came from are never read, and `truth` only to judge the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs.config import parse
from gcs.config.tables import AnywhereTable
from gcs.errors import ConfigError, RecordingError
from gcs.io.detections.columns import TIMES, columns, which
from gcs.io.detections.model_file import MOST_SCANS, ModelTable, model_of, read_model, sensors_of
from gcs.io.detections.sanity import doubts
from gcs.io.detections.tables import MOST_NUMBERS, Numbers, read_csv, read_npz
from gcs.io.detections.truth import TruthRows, by_scan, read_truth, truth_rows
from gcs.io.zenoh.scans import MAX_DETECTIONS
from gcs.model import NS_PER_S, FloatArray, Scan, Sensor, Truth, read_only
from gcs.tracking.glmb.filter import Birth, GlmbParams
from gcs.tracking.metrics import Tracks

_ROW = "rows of numbers k,x,y: the scan, counted from 0 or 1, and a detection in metres"
_LATEST_NS = 4.2e18
_MOST_EMPTY, _MOST_EMPTY_EACH = 10_000, 100
"""Scans without a row, beside so many for each with one: more are a mistake of the column."""
_LEAST_SPAN_NS = 1e6
"""Of the scans of a sensor: in less, none looks twice."""


@dataclass(frozen=True, slots=True)
class Look:
    """One scan as the tracker gets it."""

    t_ns: int
    sensor: Sensor
    z_m: FloatArray
    origin: FloatArray | None = None
    """(m,) number of the true object of each detection, 0 for clutter; None if the file does not have it."""


@dataclass(frozen=True, slots=True)
class Detections:
    """Everything to track."""

    params: GlmbParams
    births: tuple[Birth, ...]
    anywhere: AnywhereTable
    """Births where no place is known."""
    birth_again_probability: float | None
    """What a place gives birth with after an object of it was estimated; None: as before."""
    looks: tuple[Look, ...]
    number: Mapping[int, int]
    """Which scan (k) was measured at a time."""
    truth: dict[int, Tracks[object]] = field(default_factory=dict)
    """Where the objects truly were, by k; empty where it is not known."""
    absolute: bool = False
    """Whether times are since the Unix epoch; if not, since something that the file does not say."""
    timed: bool = True
    """Whether the file says times; if not, it counts scans."""
    remarks: tuple[str, ...] = ()
    """What the user should know, such as where a damaged file ends."""


def load(
    path: Path, model: Path | None, truth: Path | None, progress: Callable[[int], None] | None = None
) -> Detections:
    """Read detections with their model and their truth.

    `progress` is told now and then how many bytes of a recording have been read.

    Raises
    ------
    ConfigError
        When a file is not what it should be: which, and what was expected.
    RecordingError
        When a recording cannot be read.
    """
    if path.is_dir() or path.suffix == ".mcap":
        return _of_recording(path, model, truth, progress)
    if path.suffix.lower() == ".npz":
        arrays = read_npz(path)
        if "meas" not in arrays:
            raise ConfigError(str(path), "meas", f"is missing; expected {_ROW}")
        table = model_of(path, arrays) if model is None else read_model(model)
        numbers = Numbers((), arrays["meas"])
        if truth is None and "truth" in arrays:
            return _with_model(path, numbers, table, truth_rows(path, Numbers((), arrays["truth"])))
    else:
        numbers = read_csv(path, _ROW)
        if not numbers.titles and not numbers.rows.size:
            raise ConfigError(str(path), "", f"holds no row; expected {_ROW}")
        if model is None:
            raise ConfigError(
                str(path), "", "a CSV has no model: expected --model with an NPZ or TOML that says it"
            )
        table = read_model(model)
    return _with_model(path, numbers, table, None if truth is None else read_truth(truth))


def _with_model(path: Path, numbers: Numbers, table: ModelTable, truth: TruthRows | None) -> Detections:
    """Scans of a table of detections, made by the sensors of a model."""
    rows = _rows(path, numbers.rows, 3, _ROW)
    found = columns(path, numbers)
    sensors = sensors_of(table, path.name)
    number = which(path, replace(numbers, rows=rows), found, sensors)
    places = np.empty((len(rows), 2))
    for i, sensor in enumerate(sensors):
        places[number == i] = found.places(rows[number == i], sensor)
    is_plain = found.time == "k" and found.sensor is None and found.polar is None
    made = np.ones(len(rows), np.bool_) if is_plain else found.measured(rows)
    origin = None if found.origin is None else rows[:, found.origin]
    seen = _Seen(rows[:, 0], number, places, made, origin)
    if found.time in TIMES:
        times, looks = _timed(path, found.time, seen, sensors)
    else:
        times, looks = _numbered(path, seen, sensors, table, truth)
    if not looks:
        raise ConfigError(str(path), found.time, f"holds no scan; expected {_ROW}, or scans in the model")
    most = max(len(look.z_m) for look in looks)
    if most > MAX_DETECTIONS:
        what = f"expected scans of at most {MAX_DETECTIONS} detections, found one of {most}"
        raise ConfigError(str(path), found.time, what)
    params, births = _motion(table)
    true, remarks = ({}, ()) if truth is None else by_scan(truth, times)
    remarks = (*numbers.remarks, *doubts(table, sensors, looks), *remarks)
    is_absolute = found.time == "t_ns"
    return Detections(
        params,
        births,
        table.anywhere,
        None,
        looks,
        times,
        true,
        absolute=is_absolute,
        timed=found.time in TIMES,
        remarks=remarks,
    )


class _Seen(NamedTuple):
    """Rows of a table of detections."""

    first: FloatArray
    """(n,) scan or time."""
    sensor: npt.NDArray[np.int64]
    """(n,) which one."""
    z_m: FloatArray
    """(n, 2) east/north."""
    made: npt.NDArray[np.bool_]
    """(n,) whether it is a detection; if not, it only says that the sensor looked."""
    origin: FloatArray | None
    """(n,) number of the true object."""

    def look(self, t_ns: int, sensor: Sensor, rows: npt.NDArray[np.int64]) -> Look:
        """Return a scan of the rows that are detections."""
        rows = rows[self.made[rows]]
        origin = None if self.origin is None else read_only(self.origin[rows])
        return Look(t_ns, sensor, read_only(self.z_m[rows]), origin)


def _timed(
    path: Path,
    title: str,
    seen: _Seen,
    sensors: tuple[Sensor, ...],
) -> tuple[dict[int, int], tuple[Look, ...]]:
    """Scans at the times of a first column, numbered from 1; a sensor looked when it has a row."""
    t_ns = seen.first * TIMES[title]
    if not (np.isfinite(t_ns).all() and (abs(t_ns) < _LATEST_NS).all()):
        raise ConfigError(str(path), title, "expected a time in every row, before the year 2100")
    if title == "t_ns" and t_ns.size and 0.0 < np.ptp(t_ns) < _LEAST_SPAN_NS:
        raise ConfigError(
            str(path), title, f"expected nanoseconds; all scans lie within {np.ptp(t_ns):.4g} ns"
        )
    order = np.lexsort((seen.sensor, t_ns))
    is_next = np.ones(order.size, np.bool_)
    is_next[1:] = (np.diff(t_ns[order]) > 0.0) | (np.diff(seen.sensor[order]) > 0)
    if np.count_nonzero(is_next) > MOST_SCANS:
        raise ConfigError(str(path), title, f"expected at most {MOST_SCANS} scans")
    looks = tuple(
        seen.look(round(t_ns[rows[0]]), sensors[seen.sensor[rows[0]]], rows)
        for rows in np.split(order, np.flatnonzero(is_next)[1:])
        if rows.size
    )
    return {t_ns: k for k, t_ns in enumerate(dict.fromkeys(look.t_ns for look in looks), 1)}, looks


def _numbered(
    path: Path,
    seen: _Seen,
    sensors: tuple[Sensor, ...],
    table: ModelTable,
    truth: TruthRows | None,
) -> tuple[dict[int, int], tuple[Look, ...]]:
    """Scans from 1 (or 0, where one says so) to the last, at regular times, each of every sensor."""
    scan = seen.first
    if not (np.isfinite(scan).all() and (scan == np.floor(scan)).all() and (scan >= 0).all()):
        what = "expected whole numbers from 0 on; a column of times has the title t_s or t_ns"
        raise ConfigError(str(path), "k", what)
    known = np.empty(0, np.int64) if truth is None else truth.scans
    if truth is not None and known.size and scan.size and not np.isin(known, scan).any():
        problem = f"its scans {known[0]} to {known[-1]} are none of those of {path.name}; expected its truth"
        raise ConfigError(str(truth.path), "k", problem)
    first = 0 if (scan == 0).any() or 0 in known else 1
    last = int(max(scan.max(initial=0.0), table.scans or 0, known.max(initial=0)))
    n = len(sensors)
    if last * n > MOST_SCANS:
        raise ConfigError(str(path), "k", f"expected at most {MOST_SCANS} scans, found number {last}")
    named = np.union1d(scan, known).size
    if last > _MOST_EMPTY + _MOST_EMPTY_EACH * named:
        raise ConfigError(
            str(path),
            "k",
            f"expected scans counted one by one, found numbers up to {last} and rows of {named} of them; a "
            "column of times has the title t_s or t_ns",
        )
    slot = (scan - first) * n + seen.sensor
    order = np.argsort(slot, kind="stable")
    edges = np.searchsorted(slot[order], np.arange((last - first + 1) * n + 1))
    times = {round(k * table.dt_s * NS_PER_S): k for k in range(first, last + 1)}
    looks = tuple(
        seen.look(t_ns, sensor, order[begin:end])
        for (t_ns, sensor), begin, end in zip(product(times, sensors), edges[:-1], edges[1:], strict=True)
    )
    return times, looks


def _motion(table: ModelTable) -> tuple[GlmbParams, tuple[Birth, ...]]:
    """How objects move, and where they appear."""
    params = GlmbParams(
        accel_std_m_s2=table.accel_std_m_s2,
        acceleration=table.acceleration,
        turn_rate_std_rad_s=math.radians(table.turn_rate_std_deg_s),
        turn_time_s=table.turn_time_s,
        survival_probability_per_s=table.survival_probability ** (1.0 / table.dt_s),
    )
    births = tuple(
        _appeared(
            _birth((b.x_m, b.y_m, b.vx_m_s, b.vy_m_s), b.std_m, b.speed_std_m_s, b.probability), table.dt_s
        )
        for b in table.births
    )
    return params, births


def _of_recording(
    path: Path, model: Path | None, truth: Path | None, progress: Callable[[int], None] | None
) -> Detections:
    """Scans of a recorded run; one tracker for agents and targets, which moves as the agents may."""
    from gcs.io.recording.reader import Damage, read, read_info

    if model is not None:
        raise ConfigError(str(model), "", "a recording has its own model: expected no --model with it")
    text = read_info(path).config_text
    if not text:
        raise RecordingError(str(path), "holds no mission file, so it is not known where objects appear")
    config = parse(text, f"{path}: mission file")
    looks: list[Look] = []
    truths: list[Truth] = []
    sensors: dict[tuple[object, ...], Sensor] = {}
    remarks: tuple[str, ...] = ()
    numbers = 0
    for record in read(path, progress, only=(Scan, Truth)):
        value = record.value
        if isinstance(value, Damage):
            remarks = (f"The recording breaks off: {value.problem}.",)
        elif isinstance(value, Scan):
            said = value.sensor  # again with every scan; one is kept
            what = (said.detection_probability, said.clutter_density_per_m2, said.field_of_view_m, said.polar)
            sensor = sensors.setdefault((said.name, said.noise_cov_m2.tobytes(), *what), said)
            looks.append(Look(value.measured_t_ns, sensor, value.z_m))
            numbers += value.z_m.size
        elif isinstance(value, Truth):
            truths.append(value)
        if numbers > MOST_NUMBERS or len(looks) > MOST_SCANS:
            raise RecordingError(
                str(path), f"holds more than {MOST_SCANS} scans or {MOST_NUMBERS // 2} detections"
            )
    if not looks:
        raise RecordingError(str(path), "holds no scan" + "".join(f": {text}" for text in remarks))
    tracking = config.tracking
    turning = max(tracking.agents, tracking.targets, key=lambda table: table.turn_rate_std_deg_s)
    params = GlmbParams(
        accel_std_m_s2=math.sqrt(max(tracking.agents.accel_psd_m2_s3, tracking.targets.accel_psd_m2_s3)),
        turn_rate_std_rad_s=math.radians(turning.turn_rate_std_deg_s),
        turn_time_s=turning.turn_time_s,
        survival_probability_per_s=tracking.survival_probability_per_s,
        max_hypotheses=tracking.max_hypotheses,
        gate_chi2=tracking.gate_chi2,
        lost_std_m=tracking.lost_std_m,
    )
    births = [
        _birth(
            (agent.east_m, agent.north_m, 0.0, 0.0),
            tracking.agent_birth_std_m,
            tracking.agent_birth_speed_std_m_s,
            tracking.agents.birth_probability,
        )
        for agent in config.agents
    ]
    births += [
        _birth(
            (b.east_m, b.north_m, b.v_east_m_s, b.v_north_m_s),
            b.std_m,
            b.speed_std_m_s,
            tracking.targets.birth_probability,
        )
        for b in config.births
    ]
    kinds = (tracking.agents.anywhere, tracking.targets.anywhere)
    anywhere = max(kinds, key=lambda table: table.per_s)
    again = max(tracking.agents.birth_again_probability, tracking.targets.birth_again_probability)
    number = {t_ns: k for k, t_ns in enumerate(sorted({look.t_ns for look in looks}), 1)}
    if truth is None:
        true = _true_tracks(truths, number)
    else:
        true, more = by_scan(read_truth(truth), number)
        remarks = (*remarks, *more)
    return Detections(
        params, tuple(births), anywhere, again, tuple(looks), number, true, absolute=True, remarks=remarks
    )


def _true_tracks(truths: list[Truth], number: Mapping[int, int]) -> dict[int, Tracks[object]]:
    return {
        number[truth.t_ns]: {
            (o.kind, o.id): read_only([o.east_m, o.north_m]) for o in truth.objects if o.alive
        }
        for truth in truths
        if truth.t_ns in number
    }


def _birth(
    mean: tuple[float, float, float, float], std_m: float, speed_std_m_s: float, probability: float
) -> Birth:
    cov = np.diag([std_m**2, std_m**2, speed_std_m_s**2, speed_std_m_s**2])
    return Birth(read_only(mean), read_only(cov), probability)


def _appeared(birth: Birth, dt_s: float) -> Birth:
    """Where an object is at a scan that appeared at its place at some time since the scan before.

    Its age is uniform between 0 and `dt_s`, its velocity v constant meanwhile: the moments of p + v age.
    """
    velocity, spread = birth.mean[2:], birth.cov[2:, 2:]
    mean, cov = birth.mean.copy(), birth.cov.copy()
    mean[:2] += velocity * dt_s / 2.0
    cov[:2, :2] += spread * dt_s**2 / 3.0 + np.outer(velocity, velocity) * dt_s**2 / 12.0
    cov[:2, 2:] += spread * dt_s / 2.0
    cov[2:, :2] = cov[:2, 2:].T
    return Birth(read_only(mean), read_only(cov), birth.probability)


def _rows(path: Path, table: FloatArray, columns: int, expected: str) -> FloatArray:
    if table.size == 0:
        return np.empty((0, max(columns, table.shape[-1])))
    if table.ndim != 2 or table.shape[1] < columns:
        raise ConfigError(str(path), "", f"expected {expected}; found the shape {table.shape}")
    return table
