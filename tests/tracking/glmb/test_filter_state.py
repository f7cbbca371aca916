"""After a restart a user would see other labels, or the process would crash on a damaged state."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import Sensor, read_only
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams, GlmbState
from gcs.tracking.glmb.hypotheses import Clusters
from gcs.tracking.glmb.recursion import Posterior

S = 1_000_000_000
SENSOR = Sensor("radar", 0.9, 2e-5, read_only(np.eye(2) * 25.0), (0.0, 0.0, 1000.0, 1000.0))
BIRTHS = tuple(
    Birth(read_only([x, y, 0.0, 0.0]), read_only(np.diag([100.0, 100.0, 9.0, 9.0])), 0.02)
    for x, y in ((200.0, 200.0), (230.0, 210.0), (700.0, 600.0))
)


def scans(first: int, n: int, seed: int = 1):
    rng = np.random.default_rng((seed, first))
    for k in range(first, first + n):
        objects = np.array([[200.0 + 3.0 * k, 200.0], [230.0, 210.0 + 2.0 * k], [700.0 - 4.0 * k, 600.0]])
        seen = objects[rng.random(3) < 0.9] + rng.normal(0.0, 5.0, (1, 2))
        clutter = rng.uniform(0.0, 1000.0, (rng.poisson(20.0), 2))
        yield k * S, np.vstack((seen, clutter))


def tracked(turn_rate_std_rad_s: float = 0.0, seed: int = 1) -> Glmb:
    glmb = Glmb("targets", params(turn_rate_std_rad_s), 7, summarise_detections=True)
    for t_ns, z_m in scans(0, 12, seed):
        glmb.update(t_ns, z_m, SENSOR, BIRTHS)
    return glmb


def params(turn_rate_std_rad_s: float) -> GlmbParams:
    return GlmbParams(0.999, turn_rate_std_rad_s=turn_rate_std_rad_s)


@pytest.mark.parametrize("turn_rate_std_rad_s", [0.0, 0.2])
def test_a_filter_that_continues_from_a_state_gives_the_same_pictures_for_ever(
    turn_rate_std_rad_s: float,
) -> None:
    first = tracked(turn_rate_std_rad_s)
    state = deepcopy(first.state)
    second = Glmb("targets", params(turn_rate_std_rad_s), 3, summarise_detections=True, state=state)
    assert len(first.picture(0).tracks) >= 3
    for t_ns, z_m in scans(12, 20):
        for one in (first, second):
            one.update(t_ns, z_m, SENSOR, BIRTHS)
        a, b = (one.estimates() for one in (first, second))
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
    assert first.state.rng == second.state.rng


def test_a_filter_continues_from_the_state_before_the_first_scan() -> None:
    glmb = Glmb("targets", params(0.0), 1, state=GlmbState(rng=2))
    assert glmb.picture(0).tracks == ()
    assert glmb.state.rng == 2


def changed(state: GlmbState, name: str, value: Any) -> GlmbState:
    """Return a state with another value of a field, of its posterior or of the clusters in that."""
    posterior = state.posterior
    if name in Clusters._fields:
        posterior = posterior._replace(clusters=posterior.clusters._replace(**{name: value}))
    elif name in Posterior._fields:
        posterior = posterior._replace(**{name: value})
    else:
        return replace(state, **{name: value})
    return replace(state, posterior=posterior)


DAMAGE: list[tuple[str, Any]] = [
    ("items", np.array([10**6])),
    ("items", np.array([-1])),
    ("items", np.array([0.0])),
    ("start", np.empty(0, np.int64)),
    ("start", np.array([0, 5])),
    ("start", np.array(0)),
    ("first", np.array([0])),
    ("first", np.array([0, 1, 1])),
    ("track_label", np.array([99])),
    ("labels", np.array([[0, 0]])),
    ("labels", np.array([[10**9, 0], [0, 1], [0, 2]])),
    ("labels", np.array([0, 0, 0, 1])),
    ("logw", np.zeros(1)),
    ("mean", np.zeros((1, 4))),
    ("cov", np.zeros((1, 4, 4))),
    ("turn", np.zeros((1, 6))),
    ("is_certain", np.array([True])),
    ("rng", -1),
    ("scans", -5),
]


@pytest.mark.parametrize(("field", "value"), DAMAGE)
def test_a_damaged_state_is_refused_by_name(field: str, value: Any) -> None:
    state = tracked().state
    with pytest.raises(ValueError, match="tracker state"):
        Glmb("targets", params(0.0), 7, state=changed(state, field, value))


@settings(max_examples=60)
@given(st.data())
def test_any_change_of_one_number_is_refused_or_harmless(data: st.DataObject) -> None:
    state = deepcopy(tracked().state)
    posterior = state.posterior
    names = ("track_label", "labels", "mean", "cov", "turn", "is_certain")
    arrays = [*posterior.clusters, *(getattr(posterior, name) for name in names)]
    flat = data.draw(st.sampled_from([array for array in arrays if array.size])).reshape(-1)
    number = st.floats(-1e9, 1e9) if flat.dtype == np.float64 else st.integers(-3, 2**40)
    value = data.draw(st.booleans() if flat.dtype == np.bool_ else number)
    flat[data.draw(st.integers(0, flat.size - 1))] = value
    try:
        glmb = Glmb("targets", params(0.0), 1, summarise_detections=True, state=state)
    except ValueError:
        return
    for t_ns, z_m in scans(12, 3):
        glmb.update(t_ns, z_m, SENSOR, BIRTHS)
    glmb.picture(0)
