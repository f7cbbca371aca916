"""If these were off, every weight would be, and no test of the filter against itself would show it."""

import math

import numpy as np
import pytest

from gcs.jit import kernel
from gcs.tracking.numerics.fast_math import exp_into, log_in_place


@kernel
def _exponentials(x, out):
    exp_into(x, out)


@kernel
def _logarithms(x):
    log_in_place(x)


def e_to(x):
    out = np.empty_like(x)
    _exponentials(x, out)
    return out


def log_of(x):
    out = x.copy()
    _logarithms(out)
    return out


def units_off(ours, exact):
    """Greatest error in units of the last place; `exact` in a longer format."""
    return float(np.max(np.abs(ours - exact) / np.spacing(np.abs(exact).astype(np.float64))))


@pytest.fixture
def rng():
    return np.random.default_rng(1)


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 60, reason="nothing longer to compare with")
@pytest.mark.parametrize(("low", "high"), [(-20.0, 0.0), (-708.0, 709.0), (-0.35, 0.35)])
def test_exponentials_are_right_to_the_last_places(rng, low, high):
    x = rng.uniform(low, high, 200_000)
    assert units_off(e_to(x), np.exp(x.astype(np.longdouble))) < 2.0


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 60, reason="nothing longer to compare with")
@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (0.999, 1.001), (0.5, 2.0), (1e-300, 1e300)])
def test_logarithms_are_right_to_the_last_places(rng, low, high):
    x = np.exp(rng.uniform(math.log(max(low, 1e-12)), math.log(high), 200_000))
    assert units_off(log_of(x), np.log(x.astype(np.longdouble))) < 2.0


@pytest.mark.parametrize("n", range(20))
def test_results_do_not_depend_on_the_length_of_the_array(rng, n):
    x = rng.uniform(-30.0, 0.0, n)
    assert e_to(x).tolist() == [e_to(x[i : i + 1])[0] for i in range(n)]
    assert log_of(-x).tolist() == [log_of(-x[i : i + 1])[0] for i in range(n)]


def test_certainty_is_certain():
    assert e_to(np.array([0.0, -0.0])).tolist() == [1.0, 1.0]
    assert log_of(np.array([1.0])).tolist() == [0.0]


def test_extreme_weights_are_clipped():
    assert np.all(e_to(np.array([-np.inf, -1e4, -709.0])) < 1e-306)
    assert np.all(np.isfinite(e_to(np.array([np.inf, 1e4, 710.0]))))
    assert log_of(np.array([0.0, 5e-324, 1e-310])).tolist() == [math.log(2.2250738585072014e-308)] * 3
