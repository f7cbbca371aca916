"""Linearisation of a function at Gaussians: y = value + A (x - mean) + e, with cov(e) = rest.

With a Jacobian it is that of the extended Kalman filter, with rest = 0. Without, it is statistical: the
moments of y by the cubature rule (Arasaratnam & Haykin, IEEE Trans. Automatic Control 54, 2009), with 2 d
points mean +- sqrt(d) L e_i of the factor L L' = P. Then A = C' P^-1, with C the covariance of x and y, and
rest = cov(y) - A P A'. So A P A' + rest is the covariance of y, and P A' that of x and y.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gcs.model import FloatArray
from gcs.tracking.state_space.models import StateFunction

_TWO_PI = 2.0 * np.pi


class Linearised(NamedTuple):
    """A function of d states with k values, linearised at n Gaussians."""

    value: FloatArray
    """(n, k)."""
    A: FloatArray
    """(n, k, d)."""
    rest: FloatArray
    """(n, k, k)."""


def wrap(differences: FloatArray, angles: tuple[int, ...]) -> FloatArray:
    """Return differences (..., k) with those of angles in [-pi, pi]."""
    for i in angles:
        differences[..., i] -= _TWO_PI * np.rint(differences[..., i] / _TWO_PI)
    return differences


def linearise(
    function: StateFunction,
    jacobian: StateFunction | None,
    mean: FloatArray,
    cov: FloatArray,
    angles: tuple[int, ...] = (),
) -> Linearised:
    """Linearise a function at means (n, d) and covariances (n, d, d).

    Raises
    ------
    ValueError
        The function or its Jacobian returns another shape.
    """
    n, d = mean.shape
    if jacobian is not None:
        value = np.asarray(function(mean), np.float64)
        A = np.asarray(jacobian(mean), np.float64)
        k = value.shape[-1]
        _check("a model's function", value, (n, k))
        _check("a model's Jacobian", A, (n, k, d))
        return Linearised(value, A, np.zeros((n, k, k)))
    L = np.linalg.cholesky(cov) * np.sqrt(d)
    offset = np.concatenate([L.swapaxes(1, 2), -L.swapaxes(1, 2)], axis=1)
    points = (mean[:, None] + offset).reshape(-1, d)
    y = np.asarray(function(points), np.float64)
    k = y.shape[-1]
    _check("a model's function", y, (len(points), k))
    y = y.reshape(n, 2 * d, k)
    centre = y[:, 0]
    dy = wrap(y - centre[:, None], angles)
    middle = dy.mean(axis=1)
    dy -= middle[:, None]
    C = offset.swapaxes(1, 2) @ dy / (2 * d)
    A = np.linalg.solve(cov, C).swapaxes(1, 2)
    rest = dy.swapaxes(1, 2) @ dy / (2 * d) - A @ C
    value = wrap(centre + middle, angles)
    return Linearised(value, A, rest)


def _check(name: str, array: FloatArray, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name}: expected to return the shape {shape}, got {array.shape}")
