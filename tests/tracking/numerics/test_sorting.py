"""If hypotheses were out of order, the best would be cut with the worst; if equal ones were missed,
they would crowd out others."""

import math

import numba
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs.tracking.numerics.sorting import (
    allocate_sort,
    allocate_unique,
    argsort_descending,
    unique_hypotheses,
)

FINITE = st.floats(-100.0, 100.0)
CROWDED = st.floats(-1e-9, 1e-9) | st.just(-90.0)
ANY = st.floats(allow_nan=False) | st.just(-math.inf)


@numba.njit
def ordered(values, first):
    buffers = allocate_sort(values.size)
    argsort_descending(values, first, values.size, buffers)
    return buffers.index


@numba.njit
def joined(keys, weights, first):
    buffers = allocate_unique(keys.size)
    for i in range(keys.size):
        buffers.key[i] = keys[i]
    n = unique_hypotheses(keys.size, weights, first, buffers)
    return n, buffers.which, buffers.logw


@given(st.lists(FINITE, max_size=80) | st.lists(CROWDED, max_size=80) | st.lists(ANY, max_size=40))
def test_sorting_is_descending_and_stable(values):
    values = np.array([0.0, *values])
    expected = 1 + np.argsort(-values[1:], kind="stable")
    assert ordered(values, 1)[:-1].tolist() == expected.tolist()


def test_nan_does_no_harm():
    values = np.where(np.arange(50) % 7 == 3, math.nan, np.arange(50.0))
    assert sorted(ordered(values, 0).tolist()) == list(range(50))


@given(st.lists(st.tuples(st.integers(0, 6), st.floats(1e-6, 1.0)), min_size=1, max_size=40))
def test_weights_of_equal_hypotheses_add(pairs):
    # Keys that share their low bits collide in the table.
    keys = np.array([k << 40 for k, _ in pairs], np.uint64)
    weights = np.array([9.0, 9.0, *(w for _, w in pairs)])
    sums = {}
    for k, w in pairs:
        sums[k] = sums.get(k, 0.0) + w
    n, which, logw = joined(keys, weights, 2)
    which = which[:n]
    logw = logw[:n]
    found = {pairs[h - 2][0]: math.exp(w) for h, w in zip(which.tolist(), logw.tolist(), strict=True)}
    assert found.keys() == sums.keys()
    assert all(math.isclose(found[k], sums[k], rel_tol=1e-12) for k in sums)
    assert logw.tolist() == sorted(logw.tolist(), reverse=True)
