"""What `gcs track` reads: detections with the model to track them by, and the truth where it is known.

- NPZ: `meas` with rows (k, x, y, ...), and optionally the model (`F, sigma_v, sigma_z, pS, pD, lambda_c`,
  `region, birth_mean, birth_std, r_birth, K`; state order px, vx, py, vy) and `truth` with rows
  (k, id, px, vx, py, vy).
- CSV: rows k,x,y; more columns are ignored. Its model is another file: such an NPZ, or TOML (`ModelTable`).
- A recording of ours: its scans with what their sensors say of themselves, births from its mission file.

Scans are numbered; one without detections is a scan as well. The region of an NPZ is where its clutter is;
the probability of detection is the same everywhere, as in the model that the sets were drawn from (with a
sensor blind beyond the region, clutter that drifted out would live on there). Columns that say where a
detection truly came from are never read, and `truth` only to judge the result.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from gcs.config import AnywhereTable, Box, InnerProbability, Positive, Probability, Table, convert, parse
from gcs.edge.reader import about, read
from gcs.edge.recorder import MCAP_NAME
from gcs.errors import ConfigError, RecordingError
from gcs.model import NS_PER_S, FloatArray, Scan, Sensor, Truth, read_only
from gcs.tracking.glmb import Birth, GlmbParams
from gcs.tracking.metrics import Tracks
from gcs.tracking.motion import Acceleration

_ROW = "rows of numbers k,x,y: the scan, counted from 0 or 1, and a detection in metres"
_TRUTH_ROW = "rows of numbers k,id,px,vx,py,vy or k,id,x,y"
_MODEL_KEYS = "F, sigma_v, sigma_z, pS, pD, lambda_c, region, birth_mean, birth_std, r_birth"
_MOST_SCANS = 1_000_000
_OURS = [0, 2, 1, 3]
"""px, vx, py, vy in our order."""


class BirthModel(Table, frozen=True, kw_only=True):
    """A place where objects appear: Gaussian on position and velocity."""

    x_m: float
    y_m: float
    vx_m_s: float = 0.0
    vy_m_s: float = 0.0
    std_m: Positive
    speed_std_m_s: Positive
    probability: InnerProbability


class ModelTable(Table, frozen=True, kw_only=True):
    """A model file: how objects live and move, and how they are seen."""

    dt_s: Annotated[float, Meta(gt=0.0, le=3600.0)] = 1.0
    accel_std_m_s2: Positive
    acceleration: Acceleration = "white"
    turn_rate_std_deg_s: Annotated[float, Meta(ge=0.0, le=180.0)] = 0.0
    turn_time_s: Positive = 10.0
    survival_probability: InnerProbability
    """From scan to scan."""
    detection_probability: Probability
    clutter_per_scan: Positive
    noise_std_m: Positive
    region_m: Box
    """x_min, y_min, x_max, y_max of where the clutter is."""
    field_of_view_m: Box | None = None
    """The same of where objects are detected; without it, wherever they are."""
    scans: Annotated[int, Meta(ge=1, le=_MOST_SCANS)] | None = None
    births: tuple[BirthModel, ...] = ()
    anywhere: AnywhereTable = AnywhereTable()


@dataclass(frozen=True, slots=True)
class Look:
    """One scan as the tracker gets it."""

    t_ns: int
    sensor: Sensor
    z_m: FloatArray


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


def load(path: Path, model: Path | None, truth: Path | None) -> Detections:
    """Read detections with their model and their truth.

    Raises
    ------
    ConfigError
        When a file is not what it should be: which, and what was expected.
    RecordingError
        When a recording cannot be read.
    """
    if path.is_dir() or path.name == MCAP_NAME or path.suffix == ".mcap":
        return _of_recording(path, model, truth)
    if path.suffix.lower() == ".npz":
        arrays = _npz(path)
        if "meas" not in arrays:
            raise ConfigError(str(path), "meas", f"is missing; expected {_ROW}")
        table = _model_of(path, arrays) if model is None else _model(model)
        rows = _rows(path, arrays["meas"], 3, _ROW)
        known = arrays.get("truth") if truth is None else None
        true = _truth(truth) if truth is not None else None if known is None else _by_scan(path, known)
    else:
        rows = _rows(path, _csv(path, _ROW), 3, _ROW)
        if model is None:
            raise ConfigError(
                str(path), "", "a CSV has no model: expected --model with an NPZ or TOML that says it"
            )
        table, true = _model(model), None if truth is None else _truth(truth)
    return _numbered(path, rows, table, true)


def _numbered(
    path: Path, rows: FloatArray, table: ModelTable, truth: dict[int, Tracks[object]] | None
) -> Detections:
    """Scans from 1 (or 0, where one says so) to the last, at regular times."""
    scan = rows[:, 0]
    if not (np.isfinite(scan).all() and (scan == np.floor(scan)).all() and (scan >= 0).all()):
        raise ConfigError(str(path), "k", "expected whole numbers from 0 on")
    first = 0 if (scan == 0).any() or 0 in (truth or {}) else 1
    last = max(int(scan.max()) if scan.size else 0, table.scans or 0, max(truth or {}, default=0))
    if last > _MOST_SCANS:
        raise ConfigError(str(path), "k", f"expected scans up to {_MOST_SCANS}, found number {last}")
    west, south, east, north = table.region_m
    view = table.field_of_view_m or [-math.inf, -math.inf, math.inf, math.inf]
    sensor = Sensor(
        path.name,
        table.detection_probability,
        table.clutter_per_scan / ((east - west) * (north - south)),
        read_only(np.eye(2) * table.noise_std_m**2),
        (view[0], view[1], view[2], view[3]),
    )
    order = np.argsort(scan, kind="stable")
    edges = np.searchsorted(scan[order], np.arange(first, last + 2))
    times = {k: round(k * table.dt_s * NS_PER_S) for k in range(first, last + 1)}
    looks = tuple(
        Look(t_ns, sensor, read_only(rows[order[edges[k - first] : edges[k - first + 1]], 1:3]))
        for k, t_ns in times.items()
    )
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
    true = {} if truth is None else {k: truth.get(k, {}) for k in times}
    return Detections(
        params, births, table.anywhere, None, looks, {t_ns: k for k, t_ns in times.items()}, true
    )


def _of_recording(path: Path, model: Path | None, truth: Path | None) -> Detections:
    """Scans of a recorded run; one tracker for agents and targets, which moves as the agents may."""
    if model is not None:
        raise ConfigError(str(model), "", "a recording has its own model: expected no --model with it")
    text = about(path).config_text
    if not text:
        raise RecordingError(str(path), "holds no mission file, so it is not known where objects appear")
    config = parse(text, f"{path}: mission file")
    scans: list[Scan] = []
    truths: list[Truth] = []
    for record in read(path):
        if isinstance(record.value, Scan):
            scans.append(record.value)
        elif isinstance(record.value, Truth):
            truths.append(record.value)
    if not scans:
        raise RecordingError(str(path), "holds no scan")
    tracking = config.tracking
    params = GlmbParams(
        accel_std_m_s2=max(tracking.agents.accel_std_m_s2, tracking.targets.accel_std_m_s2),
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
    looks = tuple(Look(scan.measured_t_ns, scan.sensor, scan.z_m) for scan in scans)
    number = {t_ns: k for k, t_ns in enumerate(sorted({look.t_ns for look in looks}), 1)}
    true = _true_tracks(truths, number) if truth is None else _truth(truth)
    return Detections(params, tuple(births), anywhere, again, looks, number, true)


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


def _model(path: Path) -> ModelTable:
    if path.suffix.lower() == ".npz":
        return _model_of(path, _npz(path))
    try:
        raw = msgspec.toml.decode(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(str(path), "", f"cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, ValueError) as error:
        raise ConfigError(str(path), "", f"expected a model in TOML or NPZ: {error}") from None
    return _checked(path, convert(raw, ModelTable, str(path)))


def _model_of(path: Path, arrays: Mapping[str, FloatArray]) -> ModelTable:
    """Return the model that an NPZ carries."""
    missing = [key for key in _MODEL_KEYS.split(", ") if key not in arrays]
    if missing:
        raise ConfigError(
            str(path), missing[0], f"is missing; expected --model, or the model in the file: {_MODEL_KEYS}"
        )
    try:
        means = np.reshape(arrays["birth_mean"], (-1, 4))[:, _OURS]
        std = np.broadcast_to(arrays["birth_std"], (4,))[_OURS]
        region, F = np.reshape(arrays["region"], (2, 2)), np.reshape(arrays["F"], (4, 4))
        number = {
            key: float(arrays[key]) for key in ("sigma_v", "sigma_z", "pS", "pD", "lambda_c", "r_birth")
        }
        scans = int(arrays["K"]) if "K" in arrays else None
    except (TypeError, ValueError, OverflowError) as error:
        raise ConfigError(
            str(path), "", f"its model has not the shapes of px, vx, py, vy states: {error}"
        ) from None
    dt_s = float(F[0, 1])
    expected = np.kron(np.eye(2), [[1.0, dt_s], [0.0, 1.0]])
    if not np.allclose(F, expected):
        raise ConfigError(str(path), "F", "expected constant velocity in the order px, vx, py, vy")
    if std[0] != std[1] or std[2] != std[3]:
        raise ConfigError(str(path), "birth_std", "expected the same for x and y")
    raw = {
        "dt_s": dt_s,
        "accel_std_m_s2": number["sigma_v"],
        "acceleration": "piecewise",
        "survival_probability": number["pS"],
        "detection_probability": number["pD"],
        "clutter_per_scan": number["lambda_c"],
        "noise_std_m": number["sigma_z"],
        "region_m": region.T.ravel().tolist(),
        "scans": scans,
        "births": [
            {
                **dict(zip(("x_m", "y_m", "vx_m_s", "vy_m_s"), mean.tolist(), strict=True)),
                "std_m": float(std[0]),
                "speed_std_m_s": float(std[2]),
                "probability": number["r_birth"],
            }
            for mean in means
        ],
    }
    return _checked(path, convert(raw, ModelTable, str(path)))


def _checked(path: Path, table: ModelTable) -> ModelTable:
    """Return the model when it has no infinite numbers and no empty region."""
    numbers = [value for value in msgspec.structs.astuple(table) if isinstance(value, float)]
    numbers += [value for birth in table.births for value in msgspec.structs.astuple(birth)]
    if not all(math.isfinite(value) for value in (*numbers, *table.region_m)):
        raise ConfigError(str(path), "", "expected finite numbers in the model")
    west, south, east, north = table.region_m
    if not table.births and table.anywhere.per_s <= 0.0:
        raise ConfigError(str(path), "births", "expected places where objects appear, or anywhere.per_s > 0")
    if not (west < east and south < north):
        raise ConfigError(str(path), "region_m", "expected x_min, y_min, x_max, y_max with room between")
    return table


def _truth(path: Path) -> dict[int, Tracks[object]]:
    if path.suffix.lower() == ".npz":
        arrays = _npz(path)
        if "truth" not in arrays:
            raise ConfigError(str(path), "truth", f"is missing; expected {_TRUTH_ROW}")
        return _by_scan(path, arrays["truth"])
    return _by_scan(path, _csv(path, _TRUTH_ROW))


def _by_scan(path: Path, table: FloatArray) -> dict[int, Tracks[object]]:
    """Positions by k; in a scan without a row there was nobody."""
    rows = _rows(path, table, 4, _TRUTH_ROW)
    if not (np.isfinite(rows).all() and (abs(rows[:, :2]) < 2**53).all()):
        raise ConfigError(str(path), "truth", f"expected finite numbers in {_TRUTH_ROW}")
    if rows.size and (rows[:, 0].max() > _MOST_SCANS or rows[:, 0].min() < 0):
        raise ConfigError(str(path), "truth", f"expected scans from 0 to {_MOST_SCANS}")
    y = 4 if rows.shape[1] >= 6 else 3
    true: dict[int, dict[object, FloatArray]] = {}
    for row in rows:
        true.setdefault(int(row[0]), {})[int(row[1])] = read_only(row[[2, y]])
    return dict(true)


def _rows(path: Path, table: FloatArray, columns: int, expected: str) -> FloatArray:
    if table.size == 0:
        return np.empty((0, max(columns, table.shape[-1])))
    if table.ndim != 2 or table.shape[1] < columns:
        raise ConfigError(str(path), "", f"expected {expected}; found the shape {table.shape}")
    return table


def _npz(path: Path) -> dict[str, FloatArray]:
    """Return the numbers in an NPZ; nothing in it is executed."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return {key: np.asarray(file[key], dtype=np.float64) for key in file.files}
    except FileNotFoundError:
        raise ConfigError(str(path), "", "there is no such file") from None
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile, KeyError) as error:
        raise ConfigError(str(path), "", f"expected an NPZ of numbers: {error}") from None


def _csv(path: Path, expected: str) -> FloatArray:
    """Return the numbers of a CSV; lines that begin with # and one line of titles are skipped."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise ConfigError(str(path), "", "there is no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(str(path), "", f"cannot be read as text: {error}") from None
    rows: list[list[float]] = []
    titles_may_come = True
    for number, line in enumerate(lines, 1):
        cells = line.split("#", 1)[0].replace(";", ",").strip()
        if not cells:
            continue
        try:
            rows.append([float(cell) for cell in cells.split(",")])
        except ValueError:
            if not titles_may_come:
                raise ConfigError(f"{path}, line {number}", "", f"expected {expected}") from None
        titles_may_come = False
        if rows and len(rows[-1]) != len(rows[0]):
            raise ConfigError(f"{path}, line {number}", "", f"expected {expected}") from None
    return np.array(rows, np.float64) if rows else np.empty((0, 3))
