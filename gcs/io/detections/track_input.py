"""Input of `gcs track`: detections, the model to track them by, and the ground truth if it is known.

- NPZ: `meas`, and optionally a model and `truth`.
- CSV: the first column is a scan number or a time (`table_files`). The model is another file, NPZ or TOML.
- Recording of this project: its scans with their sensors, births and terrain from its mission file.

Scans are numbered; one without detections is a scan too. The region of an NPZ is where its clutter is. The
detection probability is the same everywhere, as in the model that the sets were drawn from: with a sensor
that is blind beyond the region, clutter that drifted out would live on there.

Ground truth is used for the scores only, the true objects of detections for a baseline only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from gcs.config import parse
from gcs.config.schema import AnywhereTable
from gcs.core.perception.terrain_sight import TerrainSight
from gcs.core.perception.tracking_model import (
    BIRTH_AGAIN_PROBABILITY,
    agent_births,
    birth,
    glmb_params,
    target_births,
)
from gcs.errors import ConfigError, RecordingError
from gcs.io.detections.columns import find_columns, sensor_of_rows
from gcs.io.detections.model_file import MAX_SCANS, ModelTable, npz_model, read_model, sensors_of
from gcs.io.detections.sanity import sanity_warnings
from gcs.io.detections.table_files import (
    DETECTION_TITLES,
    MAX_NUMBERS,
    TIME_UNIT_NS,
    Table,
    array_table,
    read_csv,
    read_npz,
)
from gcs.io.detections.truth import TruthRows, read_truth, truth_by_scan, truth_rows
from gcs.io.zenoh.scans import MAX_DETECTIONS
from gcs.mistake_codes import MistakeCode
from gcs.model import NS_PER_S, BoolArray, FloatArray, IntArray, Scan, Sensor, Truth, read_only
from gcs.tracking.batch import SensorScan, TrackingModel
from gcs.tracking.glmb.params import Birth, GlmbParams
from gcs.tracking.metrics import Tracks
from gcs.tracking.state_space.models import SwitchingMotion, constant_velocity

_MAX_T_NS: Final = 4.2e18
_MAX_EMPTY_SCANS = 10_000
_MAX_EMPTY_PER_SCAN = 100
"""Scans without a row, in all and for each scan with rows; more are a mistake in the column."""
_EXPECTED: Final = "expected detections (NPZ, CSV) or a recording"
_OTHER_KINDS: Final = {
    ".toml": f"is a mission file or a model: {_EXPECTED}; a model is named with --model",
    ".tlog": f"is a telemetry log, without detections: {_EXPECTED}; `gcs info` and `gcs report` read logs",
}
"""Kinds of files that are given by mistake, by the ending of their names."""
_MIN_SPAN_NS: Final = 1e6
"""Times of nanoseconds that lie closer are in another unit."""


@dataclass(frozen=True, slots=True)
class Detections:
    """Input of the tracker and of its scores."""

    model: TrackingModel | None
    """None where nothing can be born: such detections can be added to a log, but not tracked alone."""
    model_source: str
    """File of the model."""
    scans: tuple[SensorScan, ...]
    scan_numbers: Mapping[int, int]
    """Number k of each scan, by its time in nanoseconds."""
    truth: dict[int, Tracks[object]] = field(default_factory=dict)
    """True positions by k; empty if unknown."""
    is_unix_time: bool = False
    """True if times count from the Unix epoch; False if from an unknown epoch."""
    has_times: bool = True
    """True if the file has times; False if it numbers scans."""
    remarks: tuple[str, ...] = ()
    """Remarks for the user, such as where a damaged file ends."""

    def tracking_model(self) -> TrackingModel:
        """Return the model to track by.

        Raises
        ------
        ConfigError
            Nothing can be born.
        """
        if self.model is None:
            raise ConfigError(
                self.model_source,
                "births",
                MistakeCode.MISSING_KEY,
                "expected birth components, or anywhere.per_s > 0",
            )
        return self.model


def load(
    path: Path, model: Path | None, truth: Path | None, progress: Callable[[int], None] | None = None
) -> Detections:
    """Read detections with their model and their ground truth.

    `progress` is called with the bytes of a recording that have been read.

    Raises
    ------
    ConfigError
        A file is not what was expected.
    RecordingError
        A recording cannot be read.
    """
    if path.is_dir() or path.suffix == ".mcap":
        return _load_recording(path, model, truth, progress)
    if path.suffix.lower() in _OTHER_KINDS and path.is_file():
        raise ConfigError(str(path), "", MistakeCode.INVALID_FILE, _OTHER_KINDS[path.suffix.lower()])
    true = None if truth is None else read_truth(truth)
    if path.suffix.lower() == ".npz":
        arrays = read_npz(path)
        table = array_table(path, arrays, "meas")
        if true is None and "truth" in arrays:
            true = truth_rows(array_table(path, arrays, "truth"))
        found = npz_model(path, arrays) if model is None else read_model(model)
        return _detections(table, found, str(model or path), true)
    table = read_csv(path, DETECTION_TITLES)
    if model is None:
        raise ConfigError(
            str(path), "", MistakeCode.MISSING_KEY, "a CSV has no model: name one, NPZ or TOML, with --model"
        )
    return _detections(table, read_model(model), str(model), true)


def _detections(table: Table, model: ModelTable, source: str, truth: TruthRows | None) -> Detections:
    """Return the detections of a table, made by the sensors of a model."""
    columns = find_columns(table)
    sensors = sensors_of(model, table.path.name)
    sensor = sensor_of_rows(table, columns, sensors)
    z_m = np.empty((len(table.rows), 2))
    for i, one in enumerate(sensors):
        z_m[sensor == i] = columns.positions(table.rows[sensor == i], one)
    origin = None if columns.origin is None else table.rows[:, columns.origin]
    log_ratio = None if columns.log_ratio is None else table.rows[:, columns.log_ratio]
    is_detection = columns.is_detection(table.rows)
    rows = _Rows(table.path, table.rows[:, 0], sensor, z_m, is_detection, origin, log_ratio)
    has_times = columns.time in TIME_UNIT_NS
    if has_times:
        numbers, scans = _timed_scans(rows, columns.time, sensors)
    else:
        numbers, scans = _numbered_scans(rows, sensors, model, truth)
    if not scans:
        raise ConfigError(
            str(table.path), columns.time, MistakeCode.INVALID_FILE, "holds no scan; expected rows"
        )
    most = max(len(scan.z_m) for scan in scans)
    if most > MAX_DETECTIONS:
        problem = f"expected scans of at most {MAX_DETECTIONS} detections, found one of {most}"
        raise ConfigError(str(table.path), columns.time, MistakeCode.TOO_LARGE, problem)
    seen_m = [z_m[rows.is_detection & (sensor == i)] for i in range(len(sensors))]
    true, remarks = ({}, ()) if truth is None else truth_by_scan(truth, numbers)
    return Detections(
        _tracking_model(model),
        source,
        scans,
        numbers,
        true,
        is_unix_time=columns.time == "t_ns",
        has_times=has_times,
        remarks=(*table.remarks, *sanity_warnings(model, sensors, seen_m), *remarks),
    )


class _Rows(NamedTuple):
    """Rows of a table of detections."""

    path: Path
    first: FloatArray
    """(n,) scan number or time."""
    sensor: IntArray
    """(n,) number of the sensor."""
    z_m: FloatArray
    """(n, 2) east/north."""
    is_detection: BoolArray
    """(n,) False in a row that means an empty scan."""
    origin: FloatArray | None
    """(n,) number of the true object."""
    log_ratio: FloatArray | None
    """(n,) log-likelihood ratio of what else was measured."""

    def scan(self, t_ns: int, sensor: Sensor, rows: IntArray) -> SensorScan:
        """Return the scan of some rows."""
        rows = rows[self.is_detection[rows]]
        origin = None if self.origin is None else read_only(self.origin[rows])
        log_ratio = None if self.log_ratio is None else read_only(self.log_ratio[rows])
        return SensorScan(t_ns, sensor, read_only(self.z_m[rows]), origin, log_ratio)


def _timed_scans(
    rows: _Rows, title: str, sensors: tuple[Sensor, ...]
) -> tuple[dict[int, int], tuple[SensorScan, ...]]:
    """Return scan numbers from 1, and a scan for each time and sensor with a row."""
    path = str(rows.path)
    t_ns = rows.first * TIME_UNIT_NS[title]
    if not (np.isfinite(t_ns).all() and (abs(t_ns) < _MAX_T_NS).all()):
        raise ConfigError(
            path, title, MistakeCode.OUT_OF_RANGE, "expected a time in every row, before the year 2100"
        )
    if title == "t_ns" and t_ns.size and 0.0 < np.ptp(t_ns) < _MIN_SPAN_NS:
        raise ConfigError(
            path,
            title,
            MistakeCode.OUT_OF_RANGE,
            f"expected nanoseconds; all scans lie within {np.ptp(t_ns):.4g} ns",
        )
    order = np.lexsort((rows.sensor, t_ns))
    is_next = np.ones(order.size, np.bool_)
    is_next[1:] = (np.diff(t_ns[order]) > 0.0) | (np.diff(rows.sensor[order]) > 0)
    if np.count_nonzero(is_next) > MAX_SCANS:
        raise ConfigError(path, title, MistakeCode.TOO_LARGE, f"expected at most {MAX_SCANS} scans")
    scans = tuple(
        rows.scan(round(t_ns[group[0]]), sensors[rows.sensor[group[0]]], group)
        for group in np.split(order, np.flatnonzero(is_next)[1:])
        if group.size
    )
    return {t_ns: k for k, t_ns in enumerate(dict.fromkeys(scan.t_ns for scan in scans), 1)}, scans


def _numbered_scans(
    rows: _Rows, sensors: tuple[Sensor, ...], model: ModelTable, truth: TruthRows | None
) -> tuple[dict[int, int], tuple[SensorScan, ...]]:
    """Return scans of every sensor at regular times, from 1 (0 if a row or the truth has it) to the last."""
    path = str(rows.path)
    k = rows.first
    if not (np.isfinite(k).all() and (k == np.floor(k)).all() and (k >= 0).all()):
        problem = "expected whole numbers from 0 on; a column of times has the title t_s or t_ns"
        raise ConfigError(path, "k", MistakeCode.WRONG_TYPE, problem)
    true_k = np.empty(0, np.int64) if truth is None else truth.scans
    if truth is not None and true_k.size and k.size and not np.isin(true_k, k).any():
        problem = f"its scans {true_k[0]} to {true_k[-1]} are none of those of {rows.path.name}"
        raise ConfigError(str(truth.path), "k", MistakeCode.CONFLICT, problem)
    first = 0 if (k == 0).any() or 0 in true_k else 1
    last = int(max(k.max(initial=0.0), model.scans or 0, true_k.max(initial=0)))
    n = len(sensors)
    if last * n > MAX_SCANS:
        raise ConfigError(
            path, "k", MistakeCode.TOO_LARGE, f"expected at most {MAX_SCANS} scans, found number {last}"
        )
    with_rows = np.union1d(k, true_k).size
    if last > _MAX_EMPTY_SCANS + _MAX_EMPTY_PER_SCAN * with_rows:
        problem = f"expected scans counted one by one, found numbers up to {last} and rows of {with_rows}"
        raise ConfigError(
            path, "k", MistakeCode.OUT_OF_RANGE, f"{problem}; a column of times has the title t_s or t_ns"
        )
    slot = (k - first) * n + rows.sensor
    order = np.argsort(slot, kind="stable")
    edges = np.searchsorted(slot[order], np.arange((last - first + 1) * n + 1))
    numbers = {round(k * model.dt_s * NS_PER_S): k for k in range(first, last + 1)}
    scans = tuple(
        rows.scan(t_ns, sensor, order[begin:end])
        for (t_ns, sensor), begin, end in zip(product(numbers, sensors), edges[:-1], edges[1:], strict=True)
    )
    return numbers, scans


def _tracking_model(model: ModelTable) -> TrackingModel | None:
    """Return the motion and the births of a model."""
    params = GlmbParams(
        accel_psd_m2_s3=model.accel_psd_m2_s3,
        piecewise_accel_std_m_s2=model.piecewise_accel_std_m_s2,
        turn_rate_std_rad_s=math.radians(model.turn_rate_std_deg_s),
        turn_time_s=model.turn_time_s,
        survival_probability_per_s=model.survival_probability ** (1.0 / model.dt_s),
    )
    births = (
        birth((b.x_m, b.y_m, b.vx_m_s, b.vy_m_s), b.std_m, b.speed_std_m_s, b.probability)
        for b in model.births
    )
    moved = tuple(_moved_since_birth(one, model.dt_s) for one in births)
    found = _with_births(params, moved, model.anywhere)
    manoeuvres = model.manoeuvres
    if found is None or manoeuvres is None:
        return found
    straight = constant_velocity(2, 0.0)
    motion = SwitchingMotion(
        (
            replace(straight, process_noise=params.process_noise),
            constant_velocity(2, manoeuvres.accel_psd_m2_s3),
        ),
        (manoeuvres.straight_time_s, manoeuvres.mean_time_s),
    )
    own_noise = replace(params, accel_psd_m2_s3=0.0, piecewise_accel_std_m_s2=0.0)
    return replace(found, params=own_noise, motion=motion)


def _with_births(
    params: GlmbParams,
    births: Sequence[Birth],
    anywhere: AnywhereTable,
    birth_again_probability: float | None = None,
) -> TrackingModel | None:
    if not births and anywhere.per_s <= 0.0:
        return None
    return TrackingModel(
        params,
        tuple(births),
        anywhere.per_s,
        anywhere.speed_std_m_s,
        anywhere.max_probability,
        birth_again_probability,
    )


def _load_recording(
    path: Path, model: Path | None, truth: Path | None, progress: Callable[[int], None] | None
) -> Detections:
    """Return the scans of a recording; one tracker tracks agents and targets."""
    from gcs.io.recording.reader import Damage, read, read_info

    if model is not None:
        raise ConfigError(
            str(model), "", MistakeCode.CONFLICT, "a recording has its own model: expected no --model with it"
        )
    text = read_info(path).config_text
    if not text:
        raise RecordingError(str(path), "is empty, or damaged before its mission file: births are unknown")
    config = parse(text, f"{path}: mission file")
    sight = TerrainSight(config, ("all",))
    scans: list[SensorScan] = []
    truths: list[Truth] = []
    sensors: dict[tuple[object, ...], Sensor] = {}
    remarks: tuple[str, ...] = ()
    count = 0
    for record in read(path, progress, only=(Scan, Truth)):
        value = record.value
        if isinstance(value, Damage):
            remarks = (f"The recording breaks off: {value.problem}.",)
        elif isinstance(value, Scan):
            one = value.sensor  # decoded anew for each scan; equal ones are shared
            seen = sight.scan_of(value, "all")
            numbers_of = (one.detection_probability, one.clutter_density_per_m2, one.field_of_view_m)
            key = (one.name, one.noise_cov_m2.tobytes(), *numbers_of, one.polar, one.viewpoint)
            sensor = sensors.setdefault(key, seen.sensor)
            scans.append(SensorScan(value.measured_t_ns, sensor, seen.z_m))
            count += value.z_m.size
        elif isinstance(value, Truth):
            truths.append(value)
        if count > MAX_NUMBERS or len(scans) > MAX_SCANS:
            problem = f"holds more than {MAX_SCANS} scans or {MAX_NUMBERS // 2} detections"
            raise RecordingError(str(path), problem)
    if not scans:
        raise RecordingError(str(path), "holds no scan" + "".join(f": {text}" for text in remarks))
    tracking = config.tracking
    kinds = (tracking.agents, tracking.targets)
    params = glmb_params(
        tracking,
        max(kind.accel_psd_m2_s3 for kind in kinds),
        max(kind.turn_rate_std_deg_s for kind in kinds),
    )
    births = agent_births(config) + target_births(config)
    numbers = {t_ns: k for k, t_ns in enumerate(sorted({scan.t_ns for scan in scans}), 1)}
    if truth is None:
        true = _recorded_truth(truths, numbers)
    else:
        true, more = truth_by_scan(read_truth(truth), numbers)
        remarks = (*remarks, *more)
    anywhere = max((kind.anywhere for kind in kinds), key=lambda one: one.per_s)
    return Detections(
        _with_births(params, births, anywhere, BIRTH_AGAIN_PROBABILITY),
        str(path),
        tuple(scans),
        numbers,
        true,
        is_unix_time=True,
        remarks=remarks,
    )


def _recorded_truth(truths: list[Truth], numbers: Mapping[int, int]) -> dict[int, Tracks[object]]:
    return {
        numbers[truth.t_ns]: {
            (o.kind, o.id): read_only([o.east_m, o.north_m]) for o in truth.objects if o.alive
        }
        for truth in truths
        if truth.t_ns in numbers
    }


def _moved_since_birth(birth: Birth, dt_s: float) -> Birth:
    """Return the birth at the first scan after it.

    The age is uniform between 0 and `dt_s`, and the velocity v constant: the moments of p + v age.
    """
    velocity = birth.mean[2:]
    spread = birth.cov[2:, 2:]
    mean = birth.mean.copy()
    cov = birth.cov.copy()
    mean[:2] += velocity * dt_s / 2.0
    cov[:2, :2] += spread * dt_s**2 / 3.0 + np.outer(velocity, velocity) * dt_s**2 / 12.0
    cov[:2, 2:] += spread * dt_s / 2.0
    cov[2:, :2] = cov[:2, 2:].T
    return Birth(read_only(mean), read_only(cov), birth.probability)
