"""A user would lose targets: over the border, faster than any agent, or elsewhere at the next start."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_vehicles.world.scenario import GaussianTargets, Scenario, load
from sim_vehicles.world.targets import Target, make_targets

WIDTH_M, HEIGHT_M = 2000.0, 1200.0


def drawn(**changes: float) -> tuple[Scenario, GaussianTargets]:
    """The scenario with drawn targets, its table changed."""
    scenario = load("random-targets")
    assert scenario.simulation.gaussian_targets is not None
    table = msgspec.structs.replace(scenario.simulation.gaussian_targets, **changes)
    simulation = msgspec.structs.replace(scenario.simulation, gaussian_targets=table)
    return replace(scenario, simulation=simulation), table


def test_a_target_is_nowhere_before_it_appears_and_then_keeps_its_velocity() -> None:
    target = Target(0, 500.0, 400.0, 3.0, -2.0, appears_s=10.0)
    assert target.position_m(9.99, WIDTH_M, HEIGHT_M) is None
    assert target.position_m(10.0, WIDTH_M, HEIGHT_M) == (500.0, 400.0)
    assert target.position_m(60.0, WIDTH_M, HEIGHT_M) == (650.0, 300.0)


@given(
    st.floats(0.0, WIDTH_M),
    st.floats(0.0, HEIGHT_M),
    st.floats(-40.0, 40.0),
    st.floats(-40.0, 40.0),
    st.floats(0.0, 5000.0),
    st.floats(0.0, 10.0),
)
def test_a_target_stays_on_the_map_and_never_jumps(
    east_m: float, north_m: float, v_east: float, v_north: float, t_s: float, step_s: float
) -> None:
    target = Target(0, east_m, north_m, v_east, v_north, 0.0)
    here, there = (target.position_m(t, WIDTH_M, HEIGHT_M) for t in (t_s, t_s + step_s))
    for place in (here, there):
        assert 0.0 <= place[0] <= WIDTH_M
        assert 0.0 <= place[1] <= HEIGHT_M
    assert abs(there[0] - here[0]) <= abs(v_east) * step_s + 1e-6
    assert abs(there[1] - here[1]) <= abs(v_north) * step_s + 1e-6


def test_a_target_turns_back_at_the_border() -> None:
    target = Target(0, 1990.0, 5.0, 10.0, -5.0, 0.0)
    places = [target.position_m(t_s, WIDTH_M, HEIGHT_M) for t_s in (0.0, 1.0, 2.0, 3.0)]
    assert places == [(1990.0, 5.0), (2000.0, 0.0), (1990.0, 5.0), (1980.0, 10.0)]


def test_prescribed_targets_are_those_of_the_file_for_every_seed() -> None:
    scenario = load("prescribed")
    rows = scenario.simulation.targets
    made = make_targets(scenario, 0)
    assert made == make_targets(scenario, 99)
    assert [(t.id, t.east_m, t.north_m, t.v_east_m_s, t.v_north_m_s, t.appears_s) for t in made] == [
        (i, r.east_m, r.north_m, r.v_east_m_s, r.v_north_m_s, r.appears_s) for i, r in enumerate(rows)
    ]


def test_a_seed_means_one_set_of_drawn_targets() -> None:
    scenario = load("random-targets")
    assert make_targets(scenario, 5) == make_targets(scenario, 5)
    assert make_targets(scenario, 5) != make_targets(scenario, 6)


@pytest.mark.parametrize("seed", range(0, 200, 10))
def test_drawn_targets_are_on_the_map_slow_enough_and_stay_long_enough(seed: int) -> None:
    scenario, table = drawn()
    area = scenario.config.map
    for target in make_targets(scenario, seed):
        assert np.hypot(target.v_east_m_s, target.v_north_m_s) <= table.max_speed_m_s * (1 + 1e-12)
        assert 0.0 <= target.appears_s <= table.appear_by_s
        for t_s in (0.0, table.inside_for_s):
            assert 0.0 <= target.east_m + t_s * target.v_east_m_s <= area.width_m
            assert 0.0 <= target.north_m + t_s * target.v_north_m_s <= area.height_m


def test_drawn_targets_have_the_spread_of_the_file() -> None:
    scenario, _ = drawn(inside_for_s=0.0, max_speed_m_s=1000.0)
    runs = [make_targets(scenario, seed) for seed in range(400)]
    for i, birth in enumerate(scenario.config.births):
        places = np.array([(run[i].east_m, run[i].north_m) for run in runs])
        assert places.mean(axis=0) == pytest.approx((birth.east_m, birth.north_m), abs=5 * birth.std_m / 20.0)
        assert places.std(axis=0) == pytest.approx((birth.std_m, birth.std_m), rel=0.2)


def test_velocities_are_gaussian_where_nothing_bounds_them() -> None:
    scenario, table = drawn(inside_for_s=0.0, max_speed_m_s=1000.0)
    velocities = np.array(
        [(t.v_east_m_s, t.v_north_m_s) for seed in range(200) for t in make_targets(scenario, seed)]
    )
    assert velocities.mean(axis=0) == pytest.approx((0.0, 0.0), abs=5 * table.speed_std_m_s / np.sqrt(1000))
    assert velocities.std(axis=0) == pytest.approx((table.speed_std_m_s,) * 2, rel=0.12)


def test_a_target_that_no_velocity_keeps_on_the_map_stands_still() -> None:
    scenario, _ = drawn(speed_std_m_s=1000.0, max_speed_m_s=1000.0, inside_for_s=1e6)
    assert {(t.v_east_m_s, t.v_north_m_s) for t in make_targets(scenario, 0)} == {(0.0, 0.0)}


def test_targets_that_do_not_move_are_drawn_without_trouble() -> None:
    scenario, _ = drawn(speed_std_m_s=0.0)
    assert {(t.v_east_m_s, t.v_north_m_s) for t in make_targets(scenario, 0)} == {(0.0, 0.0)}
