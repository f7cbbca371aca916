"""Models to track detections by: how objects live, move and are seen; a TOML file, or an NPZ's own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final

import msgspec
import numpy as np
from msgspec import Meta

from gcs.commands.tables import read_npz
from gcs.config import Table, convert
from gcs.config.tables import AnywhereTable, Box, InnerProbability, Positive, Probability
from gcs.errors import ConfigError
from gcs.model import FloatArray
from gcs.tracking.motion import Acceleration

MOST_SCANS: Final = 1_000_000
_MODEL_KEYS = "F, sigma_v, sigma_z, pS, pD, lambda_c, region, birth_mean, birth_std, r_birth"
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
    scans: Annotated[int, Meta(ge=1, le=MOST_SCANS)] | None = None
    births: tuple[BirthModel, ...] = ()
    anywhere: AnywhereTable = AnywhereTable()


def read_model(path: Path) -> ModelTable:
    """Read a model file, TOML or NPZ.

    Raises
    ------
    ConfigError
        When it is not what it should be.
    """
    if path.suffix.lower() == ".npz":
        return model_of(path, read_npz(path))
    try:
        raw = msgspec.toml.decode(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(str(path), "", f"cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, ValueError) as error:
        raise ConfigError(str(path), "", f"expected a model in TOML or NPZ: {error}") from None
    return _checked(path, convert(raw, ModelTable, str(path)))


def model_of(path: Path, arrays: Mapping[str, FloatArray]) -> ModelTable:
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
    if not (west < east and south < north):
        raise ConfigError(str(path), "region_m", "expected x_min, y_min, x_max, y_max with room between")
    return table
