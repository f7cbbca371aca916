"""The metrics are the judge of every tracker: here they are held against brute force over all pairings."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gcs.tracking.metrics import gospa, ospa, ospa2

POINTS = st.integers(0, 4).flatmap(lambda n: hnp.arrays(float, (n, 2), elements=st.floats(-120, 120)))
ORDER = st.sampled_from([1.0, 2.0])


def brute_ospa(x, y, c, p):
    if len(x) > len(y):
        x, y = y, x
    if len(y) == 0:
        return 0.0
    best = min(
        sum(min(np.hypot(*(a - y[j])), c) ** p for a, j in zip(x, order, strict=True))
        for order in itertools.permutations(range(len(y)), len(x))
    )
    return ((best + c**p * (len(y) - len(x))) / len(y)) ** (1 / p)


def brute_gospa(x, y, c, p):
    if len(x) > len(y):
        x, y = y, x
    best = np.inf
    for order in itertools.permutations(range(len(y)), len(x)):
        for paired in itertools.product([False, True], repeat=len(x)):
            pairs = [(a, y[j]) for a, j, on in zip(x, order, paired, strict=True) if on]
            lone = len(x) + len(y) - 2 * len(pairs)
            best = min(best, sum(np.hypot(*(a - b)) ** p for a, b in pairs) + c**p / 2 * lone)
    return best ** (1 / p)


@given(x=POINTS, y=POINTS, p=ORDER)
def test_ospa_is_the_best_of_all_pairings_and_its_parts_add_up(x, y, p):
    result = ospa(x, y, 100.0, p)
    assert result.total_m == pytest.approx(brute_ospa(x, y, 100.0, p))
    assert result.localisation_m**p + result.cardinality_m**p == pytest.approx(result.total_m**p)
    assert ospa(y, x, 100.0, p) == result or ospa(y, x, 100.0, p).total_m == pytest.approx(result.total_m)


@given(x=POINTS, y=POINTS, w=POINTS, p=ORDER)
def test_ospa_obeys_the_triangle_inequality(x, y, w, p):
    direct = ospa(x, y, 100.0, p).total_m
    assert direct <= ospa(x, w, 100.0, p).total_m + ospa(w, y, 100.0, p).total_m + 1e-6


@given(x=POINTS, y=POINTS, p=ORDER)
def test_gospa_is_the_best_of_all_partial_pairings_and_its_parts_add_up(x, y, p):
    result = gospa(x, y, 50.0, p)
    assert result.total_m == pytest.approx(brute_gospa(x, y, 50.0, p))
    lone = 50.0**p / 2 * (result.missed + result.false)
    assert result.localisation_m**p + lone == pytest.approx(result.total_m**p)
    assert len(x) - result.false == len(y) - result.missed


@given(x=POINTS, y=POINTS, p=ORDER)
def test_ospa2_over_a_window_of_one_is_ospa(x, y, p):
    window = ospa2([dict(enumerate(x))], [dict(enumerate(y))], 100.0, p)
    assert window.total_m == pytest.approx(ospa(x, y, 100.0, p).total_m)


def test_ospa2_sees_swapped_labels_that_ospa_does_not():
    near, far = np.array([0.0, 0.0]), np.array([60.0, 0.0])
    truth = [{"a": near, "b": far}] * 4
    swapped = [{1: near, 2: far}] * 2 + [{1: far, 2: near}] * 2
    assert ospa([near, far], [far, near]).total_m == 0.0
    assert ospa2([{1: near, 2: far}] * 4, truth).total_m == 0.0
    assert ospa2(swapped, truth).total_m == pytest.approx(30.0)


def test_ospa2_charges_a_gap_its_share_of_the_window():
    here = np.zeros(2)
    assert ospa2([{1: here}, {}, {1: here}, {1: here}], [{"a": here}] * 4).total_m == pytest.approx(25.0)
    assert ospa2([], []).total_m == 0.0
