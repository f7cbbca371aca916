"""Models of motion, births and sensors for `gcs track`: a TOML file, or the model in an NPZ.

A single position sensor has its keys in the model itself. Several sensors, and range/bearing sensors, have a
table each in `sensors`, with the keys of a simulated sensor in a mission file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Final

import msgspec
import numpy as np
from msgspec import Meta

from gcs.config import Table, convert, decode_toml
from gcs.config.schema import AnywhereTable, Box, InnerProbability, NotNegative, Positive, Probability
from gcs.errors import ConfigError
from gcs.files import read_text
from gcs.io.detections.table_files import read_npz
from gcs.mistake_codes import MistakeCode
from gcs.model import FloatArray, Sensor, read_only
from gcs.tracking.models.sensor_geometry import polar_sensor, sector

MAX_SCANS: Final = 1_000_000
_MAX_BYTES: Final = 4_000_000
_NPZ_KEYS = "F, sigma_v, sigma_z, pS, pD, lambda_c, region, birth_mean, birth_std, r_birth"
_SENSOR_KEYS = ("detection_probability", "clutter_per_scan", "noise_std_m", "region_m")
_STATE_ORDER = [0, 2, 1, 3]
"""Our order of the states px, vx, py, vy."""
Name = Annotated[str, Meta(min_length=1, max_length=64)]


class BirthModel(Table, frozen=True, kw_only=True):
    """Birth component: Gaussian in position and velocity."""

    x_m: float
    y_m: float
    vx_m_s: float = 0.0
    vy_m_s: float = 0.0
    std_m: Positive
    speed_std_m_s: Positive
    probability: InnerProbability


class PositionSensor(Table, frozen=True, kw_only=True, tag_field="kind", tag="position"):
    """A sensor that reports positions."""

    name: Name
    detection_probability: Probability
    clutter_per_scan: NotNegative
    noise_std_m: Positive
    region_m: Box
    """x_min, y_min, x_max, y_max of its clutter."""
    field_of_view_m: Box | None = None
    """The same of its field of view; None: unbounded."""


class RangeBearingSensor(Table, frozen=True, kw_only=True, tag_field="kind", tag="range_bearing"):
    """A sensor of range and bearing, such as a radar; bearings are clockwise from north (y)."""

    name: Name
    detection_probability: Probability
    clutter_per_scan: NotNegative
    """Uniform over range and bearing."""
    x_m: float
    y_m: float
    range_std_m: Positive
    bearing_std_deg: Annotated[float, Meta(gt=0.0, le=90.0)]
    least_range_m: NotNegative = 0.0
    most_range_m: Positive
    sector_centre_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 0.0
    sector_width_deg: Annotated[float, Meta(gt=0.0, le=360.0)] = 360.0


class ManoeuvreModel(Table, frozen=True, kw_only=True):
    """Manoeuvres between straight flights (see `gcs.tracking.SwitchingMotion`)."""

    accel_psd_m2_s3: Positive
    """Spectral density of the acceleration in a manoeuvre."""
    mean_time_s: Positive
    """Mean duration of a manoeuvre."""
    straight_time_s: Positive
    """Mean time between two."""


class ModelTable(Table, frozen=True, kw_only=True):
    """A model file."""

    dt_s: Annotated[float, Meta(gt=0.0, le=3600.0)] = 1.0
    accel_psd_m2_s3: NotNegative = 0.0
    """Spectral density of a white-noise acceleration."""
    piecewise_accel_std_m_s2: NotNegative = 0.0
    """Standard deviation of an acceleration that is constant from scan to scan."""
    turn_rate_std_deg_s: Annotated[float, Meta(ge=0.0, le=180.0)] = 0.0
    turn_time_s: Positive = 10.0
    manoeuvres: ManoeuvreModel | None = None
    survival_probability: InnerProbability
    """From scan to scan."""
    detection_probability: Probability | None = None
    clutter_per_scan: NotNegative | None = None
    noise_std_m: Positive | None = None
    region_m: Box | None = None
    field_of_view_m: Box | None = None
    """These five are the single sensor if `sensors` is empty (see `PositionSensor`)."""
    sensors: tuple[PositionSensor | RangeBearingSensor, ...] = ()
    scans: Annotated[int, Meta(ge=1, le=MAX_SCANS)] | None = None
    births: tuple[BirthModel, ...] = ()
    anywhere: AnywhereTable = AnywhereTable()


def sensors_of(table: ModelTable, source: str) -> tuple[Sensor, ...]:
    """Return the sensors of a model; `source` is the name of a single sensor."""
    if table.sensors:
        return tuple(_sensor(one) for one in table.sensors)
    own = {key: getattr(table, key) for key in (*_SENSOR_KEYS, "field_of_view_m")}
    return (_sensor(PositionSensor(name=source, **own)),)


def _sensor(table: PositionSensor | RangeBearingSensor) -> Sensor:
    if isinstance(table, RangeBearingSensor):
        polar = sector(
            (table.x_m, table.y_m),
            (table.range_std_m, table.bearing_std_deg),
            (table.least_range_m, table.most_range_m),
            (table.sector_centre_deg, table.sector_width_deg),
            table.clutter_per_scan,
        )
        return polar_sensor(table.name, table.detection_probability, polar)
    west, south, east, north = table.region_m
    view = table.field_of_view_m or [-math.inf, -math.inf, math.inf, math.inf]
    return Sensor(
        table.name,
        table.detection_probability,
        table.clutter_per_scan / ((east - west) * (north - south)),
        read_only(np.eye(2) * table.noise_std_m**2),
        (view[0], view[1], view[2], view[3]),
    )


def read_model(path: Path) -> ModelTable:
    """Read a model file, TOML or NPZ.

    Raises
    ------
    ConfigError
        The file is not a model.
    """
    if path.suffix.lower() == ".npz":
        return npz_model(path, read_npz(path))
    try:
        raw = decode_toml(read_text(path, _MAX_BYTES), str(path))
    except OSError as error:
        is_missing = isinstance(error, FileNotFoundError)
        code = MistakeCode.NOT_FOUND if is_missing else MistakeCode.NO_ACCESS
        raise ConfigError(str(path), "", code, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(
            str(path), "", MistakeCode.INVALID_FILE, f"expected a model in TOML or NPZ: {error}"
        ) from None
    if "agents" in raw:
        raise ConfigError(
            str(path),
            "",
            MistakeCode.INVALID_FILE,
            "is a mission file: expected a model for the trackers, as in docs/tracking.md",
        )
    return _check_model(path, convert(raw, ModelTable, str(path)))


def npz_model(path: Path, arrays: Mapping[str, FloatArray]) -> ModelTable:
    """Return the model in an NPZ."""
    missing = [key for key in _NPZ_KEYS.split(", ") if key not in arrays]
    if missing:
        raise ConfigError(
            str(path),
            missing[0],
            MistakeCode.MISSING_KEY,
            f"is missing; expected --model, or the model in the file: {_NPZ_KEYS}",
        )
    try:
        means = np.reshape(arrays["birth_mean"], (-1, 4))[:, _STATE_ORDER]
        std = np.broadcast_to(arrays["birth_std"], (4,))[_STATE_ORDER]
        region = np.reshape(arrays["region"], (2, 2))
        F = np.reshape(arrays["F"], (4, 4))
        number = {
            key: float(arrays[key]) for key in ("sigma_v", "sigma_z", "pS", "pD", "lambda_c", "r_birth")
        }
        scans = int(arrays["K"]) if "K" in arrays else None
    except (TypeError, ValueError, OverflowError) as error:
        raise ConfigError(
            str(path),
            "",
            MistakeCode.WRONG_TYPE,
            f"its model does not have the shapes of states px, vx, py, vy: {error}",
        ) from None
    dt_s = float(F[0, 1])
    expected = np.kron(np.eye(2), [[1.0, dt_s], [0.0, 1.0]])
    if not np.allclose(F, expected):
        raise ConfigError(
            str(path), "F", MistakeCode.WRONG_TYPE, "expected constant velocity in the order px, vx, py, vy"
        )
    if std[0] != std[1] or std[2] != std[3]:
        raise ConfigError(str(path), "birth_std", MistakeCode.CONFLICT, "expected the same for x and y")
    raw = {
        "dt_s": dt_s,
        "piecewise_accel_std_m_s2": number["sigma_v"],
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
    return _check_model(path, convert(raw, ModelTable, str(path)))


def _check_model(path: Path, table: ModelTable) -> ModelTable:
    """Return the model if its numbers are finite and its sensors possible."""
    for key, value in _floats(msgspec.to_builtins(table)):
        if not math.isfinite(value):
            raise ConfigError(
                str(path), key, MistakeCode.OUT_OF_RANGE, "expected finite numbers in the model"
            )
    if table.accel_psd_m2_s3 == table.piecewise_accel_std_m_s2 == 0.0:
        raise ConfigError(
            str(path),
            "accel_psd_m2_s3",
            MistakeCode.OUT_OF_RANGE,
            "expected a process noise above 0: this key, or piecewise_accel_std_m_s2",
        )
    if table.manoeuvres is not None and table.turn_rate_std_deg_s > 0.0:
        problem = "is another model of turns than [manoeuvres]: expected one of them"
        raise ConfigError(str(path), "turn_rate_std_deg_s", MistakeCode.CONFLICT, problem)
    own = [key for key in (*_SENSOR_KEYS, "field_of_view_m") if getattr(table, key) is not None]
    if table.sensors and own:
        raise ConfigError(
            str(path),
            own[0],
            MistakeCode.CONFLICT,
            "is of one sensor: expected it in the tables of [[sensors]]",
        )
    missing = [key for key in _SENSOR_KEYS if key not in own]
    if missing and not table.sensors:
        raise ConfigError(
            str(path),
            missing[0],
            MistakeCode.MISSING_KEY,
            "the key is missing here; expected it, or [[sensors]]",
        )
    names = [sensor.name for sensor in table.sensors]
    for i, sensor in enumerate(table.sensors):
        key = f"sensors[{i}]"
        if sensor.name in names[:i]:
            raise ConfigError(
                str(path),
                f"{key}.name",
                MistakeCode.DUPLICATE,
                f"{sensor.name!r} is the name of another sensor",
            )
        if isinstance(sensor, PositionSensor):
            _check_boxes(path, f"{key}.", sensor)
        elif sensor.least_range_m >= sensor.most_range_m:
            raise ConfigError(
                str(path), f"{key}.most_range_m", MistakeCode.CONFLICT, "expected more than least_range_m"
            )
    if own:
        _check_boxes(path, "", table)
    return table


def _check_boxes(path: Path, prefix: str, table: PositionSensor | ModelTable) -> None:
    for key in ("region_m", "field_of_view_m"):
        box = getattr(table, key)
        if box is not None and not (box[0] < box[2] and box[1] < box[3]):
            raise ConfigError(
                str(path),
                prefix + key,
                MistakeCode.BAD_SHAPE,
                "expected x_min, y_min, x_max, y_max, each maximum above its minimum",
            )


def _floats(value: object, key: str = "") -> Iterator[tuple[str, float]]:
    """Yield every float in plain data, with its key."""
    if isinstance(value, dict):
        for name, one in value.items():
            yield from _floats(one, f"{key}.{name}" if key else name)
    elif isinstance(value, list | tuple):
        for i, one in enumerate(value):
            yield from _floats(one, f"{key}[{i}]")
    elif isinstance(value, float):
        yield key, value
