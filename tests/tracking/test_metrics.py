"""Wrong metrics would rank trackers wrongly: they are compared with brute force over all pairings."""

import itertools
from datetime import datetime

import numpy as np
import pytest
import scipy.optimize  # noqa: F401  else the first call of a metric imports it and is past its deadline
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gcs.tracking.metrics import cardinality_error, gospa, identity_switches, ospa, ospa2

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


HISTORY = st.lists(
    st.dictionaries(st.integers(0, 3), st.tuples(st.floats(-80, 80), st.floats(-80, 80)), max_size=4),
    min_size=6,
    max_size=6,
)


def brute_ospa2(x, y, c, p):
    """By the definition: every pairing of tracks, each pair's distance a mean over the times of either."""

    def apart(a, b):
        gaps = []
        for here, there in zip(x, y, strict=True):
            if a in here and b in there:
                gaps.append(min(c, np.hypot(*np.subtract(here[a], there[b]))))
            elif a in here or b in there:
                gaps.append(c)
        return sum(gaps) / len(gaps)

    found, true = ({label for scan in scans for label in scan} for scans in (x, y))
    gap = {(a, b): apart(a, b) for a in found for b in true}
    if len(found) > len(true):
        gap, found, true = {(b, a): d for (a, b), d in gap.items()}, true, found
    if not true:
        return 0.0
    pairings = itertools.permutations(true, len(found))
    best = min(sum(gap[pair] ** p for pair in zip(found, order, strict=True)) for order in pairings)
    return ((best + c**p * (len(true) - len(found))) / len(true)) ** (1 / p)


@given(x=HISTORY, y=HISTORY, p=ORDER)
def test_ospa2_is_the_best_of_all_pairings_of_tracks(x, y, p):
    x, y = ([{i: np.array(at) for i, at in scan.items()} for scan in scans] for scans in (x, y))
    assert ospa2(x, y, 100.0, p).total_m == pytest.approx(brute_ospa2(x, y, 100.0, p))


def test_ospa_and_gospa_are_those_of_stone_soup():
    """OSPA of order 1: for others Stone Soup 1.9 pairs by the plain distances, not by their powers."""
    peer = pytest.importorskip("stonesoup.metricgenerator.ospametric", reason="of the bench extra")
    from stonesoup.types.state import State

    rng = np.random.default_rng(4)
    now = datetime(2026, 1, 1)  # noqa: DTZ001  theirs has no zone
    for _ in range(100):
        x, y = (rng.uniform(-150, 150, (n, 2)) for n in rng.integers(1, 9, 2))
        c = float(rng.uniform(10, 200))
        theirs = [[State(at[:, None], timestamp=now) for at in points] for points in (x, y)]
        assert ospa(x, y, c, 1.0).total_m == pytest.approx(
            peer.OSPAMetric(p=1, c=c).compute_OSPA_distance(*theirs).value
        )
        ours = gospa(x, y, c, 2.0)
        gospa_of_theirs = peer.GOSPAMetric(p=2, c=c).compute_gospa_metric(*theirs)[0].value
        assert ours.total_m == pytest.approx(gospa_of_theirs["distance"])
        assert ours.missed * c**2 / 2 == pytest.approx(gospa_of_theirs["missed"])


def test_ospa2_sees_swapped_labels_that_ospa_does_not():
    near = np.array([0.0, 0.0])
    far = np.array([60.0, 0.0])
    truth = [{"a": near, "b": far}] * 4
    swapped = [{1: near, 2: far}] * 2 + [{1: far, 2: near}] * 2
    assert ospa([near, far], [far, near]).total_m == 0.0
    assert ospa2([{1: near, 2: far}] * 4, truth).total_m == 0.0
    assert ospa2(swapped, truth).total_m == pytest.approx(30.0)


def test_ospa2_charges_a_gap_its_share_of_the_window():
    here = np.zeros(2)
    assert ospa2([{1: here}, {}, {1: here}, {1: here}], [{"a": here}] * 4).total_m == pytest.approx(25.0)
    assert ospa2([], []).total_m == 0.0


def at(*east_m):
    return {i: np.array([x, 0.0]) for i, x in enumerate(east_m)}


def test_crossing_names_are_two_switches_and_keeping_them_none():
    truth = [at(10.0 * k, 100.0 - 10.0 * k) for k in range(11)]
    kept = [{f"track {i}": p for i, p in scan.items()} for scan in truth]
    swapped = [dict(zip(scan, list(scan.values())[::-1], strict=True)) for scan in kept]
    assert identity_switches(kept, truth) == 0
    assert identity_switches(kept[:6] + swapped[6:], truth, c_m=5.0) == 2


def test_a_new_label_after_a_gap_is_a_switch_and_the_old_one_is_not():
    truth = [at(0.0)] * 4
    there = {"a": np.zeros(2)}
    gone = {}
    other = {"b": np.zeros(2)}
    assert identity_switches([there, gone, there, there], truth) == 0
    assert identity_switches([there, gone, other, other], truth) == 1
    assert identity_switches([there, other, there, other], truth) == 3


def test_a_pair_lasts_while_another_label_comes_nearer():
    truth = [at(0.0)] * 3
    found = [{"a": np.array([5.0, 0.0]), "b": np.array([x, 0.0])} for x in (20.0, 1.0, 0.0)]
    assert identity_switches(found, truth) == 0


SCANS = st.lists(st.dictionaries(st.integers(0, 3), st.floats(-80, 80)), max_size=6)


@given(scans=SCANS, names=st.permutations(range(4)))
def test_the_truth_under_other_names_has_no_error_and_no_switch(scans, names):
    truth = [{i: np.array([x, 3.0]) for i, x in scan.items()} for scan in scans]
    renamed = [{names[i]: p for i, p in scan.items()} for scan in truth]
    apart = [dict(zip(scan, scan.values(), strict=True)) for scan in renamed]
    assert cardinality_error(apart, truth) == 0.0
    assert identity_switches(apart, truth, c_m=1e-9) == 0


@given(found=SCANS, c=st.floats(1.0, 100.0))
def test_no_object_switches_more_often_than_it_is_seen_again(found, c):
    scans = [{i: np.array([x, 0.0]) for i, x in scan.items()} for scan in found]
    truth = [at(0.0, 40.0)] * len(scans)
    assert 0 <= identity_switches(scans, truth, c) <= 2 * max(0, len(scans) - 1)
    errors = [abs(len(scan) - 2) for scan in scans]
    assert cardinality_error(scans, truth) == pytest.approx(np.mean(errors) if errors else 0.0)


ONE = {1: np.zeros(2)}
WRONG = {
    "a window of other length": (
        lambda: ospa2([ONE], [ONE, ONE]),
        "expected as many times of both, got 1 and 2",
    ),
    "switches of other length": (lambda: identity_switches([], [ONE]), "expected as many times of both"),
    "cardinality of other length": (lambda: cardinality_error([ONE], []), "expected as many times of both"),
    "positions without labels": (
        lambda: ospa2([np.zeros((1, 2))], [ONE]),
        "expected positions by label at each time",
    ),
    "no cut-off": (lambda: ospa(np.zeros((1, 2)), np.zeros((1, 2)), c_m=0.0), "expected c_m above 0"),
    "no order": (
        lambda: gospa(np.zeros((1, 2)), np.zeros((1, 2)), p=0.0),
        "expected c_m above 0 and p of at",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_arguments_that_cannot_be_compared_are_refused_in_words(case):
    call, said = WRONG[case]
    with pytest.raises(ValueError, match="expected") as raised:
        call()
    assert said in str(raised.value)
