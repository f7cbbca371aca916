"""Motion and measurement models of the user: states of any dimension, measurements of any dimension.

    x' = f(x, dt) + w,   w ~ N(0, Q(dt))            (motion; x has d states)
    z  = h(x) + e,       e ~ N(0, R)                (measurement; z has k coordinates)

Functions take all tracks at once: an array (n, d) has a state in each row. They are linearised at each track
(`linearisation`): by their Jacobian, or without one by the cubature rule. Linear models are exact.

A manoeuvring object switches between models (`SwitchingMotion`): a jump Markov system, whose mode is a
continuous-time Markov chain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from gcs.model import FloatArray, read_only
from gcs.tracking.models import constant_velocity as planar

POSITION_NAMES: Final = ("x", "y", "z")
_SPEED_NAMES: Final = ("vx", "vy", "vz")

_LONG_TIME_S: Final = 1e12

StateFunction: TypeAlias = Callable[[FloatArray], FloatArray]
"""A function of states (n, d)."""


@dataclass(frozen=True, slots=True)
class MotionModel:
    """Motion x' = f(x, dt) + w of objects with d states.

    Raises
    ------
    ValueError
        The names are not those of a position: names the field and what was expected.
    """

    names: tuple[str, ...]
    """Name of each of the d states. Those called x, y and z are the position, in metres."""
    transition: Callable[[FloatArray, float], FloatArray]
    """f: states (n, d) and dt in seconds to states (n, d)."""
    process_noise: Callable[[float], FloatArray]
    """Q: dt in seconds to a covariance (d, d)."""
    jacobian: Callable[[FloatArray, float], FloatArray] | None = None
    """Of f: states (n, d) and dt to (n, d, d); None: linearise by the cubature rule."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        if len(set(self.names)) != len(self.names) or not {"x", "y"} <= set(self.names):
            raise ValueError(f"names: expected different names with x and y among them, got {self.names}")

    @property
    def position(self) -> list[int]:
        """Numbers of the states that are the position: two, or three with a z."""
        return [self.names.index(name) for name in POSITION_NAMES if name in self.names]


@dataclass(frozen=True, slots=True)
class SwitchingMotion:
    """Motion that switches between models of the same states, such as straight flight and turns.

    Raises
    ------
    ValueError
        The models have different states, or not one time each.
    """

    models: tuple[MotionModel, ...]
    mean_time_s: tuple[float, ...]
    """Mean time that an object moves by each model; then each of the others is as likely."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "models", tuple(self.models))
        object.__setattr__(self, "mean_time_s", tuple(map(float, self.mean_time_s)))
        if not self.models or any(one.names != self.models[0].names for one in self.models):
            raise ValueError("models: expected one or more models with the same names of states")
        if len(self.mean_time_s) != len(self.models) or not all(t > 0.0 for t in self.mean_time_s):
            raise ValueError(f"mean_time_s: expected {len(self.models)} times above 0")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.models[0].names

    @property
    def position(self) -> list[int]:
        """Numbers of the states that are the position."""
        return self.models[0].position

    def mode_transition(self, dt_s: float) -> FloatArray:
        """Return the probabilities (modes, modes) of each mode after dt, by the mode before."""
        return _mode_transition(self.mean_time_s, dt_s)

    def stationary_modes(self) -> FloatArray:
        """Return the probability (modes,) of each mode of an object that was not seen before."""
        times = np.minimum(self.mean_time_s, _LONG_TIME_S)
        return np.asarray(times / times.sum())


@lru_cache(maxsize=64)
def _mode_transition(mean_time_s: tuple[float, ...], dt_s: float) -> FloatArray:
    """Return exp(G dt), G with the rates 1 / mean_time of leaving each mode."""
    from scipy.linalg import expm

    n = len(mean_time_s)
    if n == 1:
        return np.ones((1, 1))
    rate = 1.0 / np.array(mean_time_s)[:, None]
    G = rate * (np.ones((n, n)) / (n - 1) - np.eye(n) * n / (n - 1))
    return read_only(expm(G * dt_s))


@dataclass(frozen=True, slots=True)
class MeasurementModel:
    """A sensor that measures z = h(x) + e, of k coordinates.

    Raises
    ------
    ValueError
        An array has another shape, or a probability is out of range: names the field.
    """

    name: str
    """Identity of the sensor: scans of the same name are of one sensor."""
    detection_probability: float
    """Probability to detect an object in view."""
    clutter_density: float | Callable[[FloatArray], FloatArray]
    """Mean number of false detections of a scan per unit of z (m^3, or m rad m/s, ...): a number, or a
    function of detections (m, k) that returns (m,)."""
    expected: StateFunction
    """h: states (n, d) to expected measurements (n, k)."""
    noise_cov: FloatArray
    """R, (k, k)."""
    jacobian: StateFunction | None = None
    """Of h: states (n, d) to (n, k, d); None: linearise by the cubature rule."""
    angles: tuple[int, ...] = ()
    """Coordinates of z that are angles in radians: differences are wrapped to a turn."""
    in_view: StateFunction | None = None
    """Probability (n,) that each object of states (n, d) can be detected; None: wherever it is."""
    birth: Callable[[FloatArray], tuple[ArrayLike, ArrayLike]] | None = None
    """Gaussian of an object that may be born at a detection (k,): mean (d,) and covariance (d, d); needed for
    births anywhere (`TrackingModel.births_per_s`)."""

    def __post_init__(self) -> None:
        noise = read_only(self.noise_cov)
        if noise.ndim != 2 or noise.shape[0] != noise.shape[1] or not np.linalg.eigvalsh(noise).min() > 0.0:
            raise ValueError(f"noise_cov: expected a positive definite covariance (k, k), got {noise.shape}")
        if not 0.0 <= self.detection_probability <= 1.0:
            raise ValueError(f"detection_probability: expected 0 to 1, got {self.detection_probability}")
        object.__setattr__(self, "noise_cov", noise)

    @property
    def size(self) -> int:
        """Number k of coordinates of a measurement."""
        return self.noise_cov.shape[0]


def linear_motion(
    names: Sequence[str], F: Callable[[float], ArrayLike], Q: Callable[[float], ArrayLike]
) -> MotionModel:
    """Return the motion x' = F(dt) x + w, with F and Q functions of dt in seconds to (d, d)."""
    return MotionModel(
        tuple(names),
        lambda x, dt_s: x @ np.asarray(F(dt_s), np.float64).T,
        lambda dt_s: np.asarray(Q(dt_s), np.float64),
        lambda x, dt_s: np.broadcast_to(np.asarray(F(dt_s), np.float64), (len(x), x.shape[1], x.shape[1])),
    )


def constant_velocity(axes: int, accel_psd_m2_s3: float) -> MotionModel:
    """Return motion at nearly constant velocity: x, y, vx, vy for two axes; x, y, z, vx, vy, vz for three.

    The white-noise acceleration along each axis has the spectral density q in m^2/s^3 (Bar-Shalom, Li &
    Kirubarajan 2001, section 6.2.2).
    """
    if axes not in (2, 3):
        raise ValueError(f"axes: expected 2 or 3, got {axes}")
    pick = np.ix_([0, 2], [0, 2])
    axis = np.eye(axes)
    return linear_motion(
        POSITION_NAMES[:axes] + _SPEED_NAMES[:axes],
        lambda dt_s: np.kron(planar.transition(dt_s)[pick], axis),
        lambda dt_s: np.kron(planar.process_noise(dt_s, accel_psd_m2_s3)[pick], axis),
    )


def linear_measurement(
    name: str,
    detection_probability: float,
    clutter_density: float | Callable[[FloatArray], FloatArray],
    H: ArrayLike,
    R: ArrayLike,
    birth_cov: ArrayLike | None = None,
) -> MeasurementModel:
    """Return the measurement z = H x + e of a matrix (k, d) and a covariance (k, k).

    `birth_cov` (d, d) is the covariance of a new object before it is measured, about 0. It is wide along
    what z measures. With it, objects may be born anywhere.
    """
    H = np.array(H, np.float64)
    R = np.array(R, np.float64)

    def birth(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        P = np.asarray(birth_cov, np.float64)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        left = np.eye(len(P)) - K @ H
        return K @ z, left @ P @ left.T + K @ R @ K.T

    return MeasurementModel(
        name,
        detection_probability,
        clutter_density,
        lambda x: x @ H.T,
        R,
        lambda x: np.broadcast_to(H, (len(x), *H.shape)),
        birth=None if birth_cov is None else birth,
    )


def switching(motion: MotionModel | SwitchingMotion) -> SwitchingMotion:
    """Return a motion as one that switches: a single model never does."""
    return SwitchingMotion((motion,), (math.inf,)) if isinstance(motion, MotionModel) else motion
