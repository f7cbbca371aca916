"""After a restart a user would see other labels, or the process would crash on a damaged record."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import PersistedFilter, Sensor, read_only
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams

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
def test_a_restored_filter_gives_the_same_pictures_for_ever(turn_rate_std_rad_s: float) -> None:
    first = tracked(turn_rate_std_rad_s)
    second = Glmb("targets", params(turn_rate_std_rad_s), 3, summarise_detections=True)
    second.restore(first.persisted())
    assert len(first.picture(0).tracks) >= 3
    for t_ns, z_m in scans(12, 20):
        for one in (first, second):
            one.update(t_ns, z_m, SENSOR, BIRTHS)
        a, b = (one.estimates() for one in (first, second))
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
    assert first.persisted().rng == second.persisted().rng


def test_a_filter_before_its_first_scan_is_restored_too() -> None:
    glmb = Glmb("targets", params(0.0), 1)
    glmb.restore(Glmb("targets", params(0.0), 2).persisted())
    assert glmb.picture(0).tracks == ()


DAMAGE: list[tuple[str, Any]] = [
    ("items", (10**6,)),
    ("items", (-1,)),
    ("items", (2**70,)),
    ("start", ()),
    ("start", (0, 5)),
    ("first", (0,)),
    ("first", (0, 1, 1)),
    ("track_label", (99,)),
    ("labels", ((0, 0),)),
    ("labels", ((10**9, 0), (0, 1), (0, 2))),
    ("logw", np.zeros(1)),
    ("mean", np.zeros((1, 4))),
    ("cov", np.zeros((1, 4, 4))),
    ("turn", np.zeros((1, 6))),
    ("is_certain", (True,)),
    ("rng", -1),
    ("scans", -5),
]


@pytest.mark.parametrize(("field", "value"), DAMAGE)
def test_a_damaged_record_is_refused_by_name(field: str, value: Any) -> None:
    glmb = tracked()
    before = glmb.persisted()
    with pytest.raises(ValueError, match="tracker state"):
        glmb.restore(replace(before, **{field: value}))
    assert glmb.persisted().labels == before.labels, "it is as it was"


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_any_change_of_one_number_is_refused_or_harmless(data: st.DataObject) -> None:
    state = tracked().persisted()
    names = [field.name for field in fields(PersistedFilter) if field.name not in ("t_ns", "scans", "rng")]
    name = data.draw(st.sampled_from(names))
    values = np.array(getattr(state, name)).copy()
    if values.size == 0:
        return
    flat = values.reshape(-1)
    number = st.integers(-3, 2**40) if values.dtype != np.float64 else st.floats(-1e9, 1e9)
    flat[data.draw(st.integers(0, flat.size - 1))] = data.draw(number)
    changed: Any = read_only(values) if values.dtype == np.float64 else tuple(values.tolist())
    if name == "labels":
        changed = tuple(map(tuple, values.tolist()))
    glmb = Glmb("targets", params(0.0), 1, summarise_detections=True)
    try:
        glmb.restore(replace(state, **{name: changed}))
    except ValueError:
        return
    for t_ns, z_m in scans(12, 3):
        glmb.update(t_ns, z_m, SENSOR, BIRTHS)
    glmb.picture(0)
