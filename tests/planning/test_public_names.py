"""A user imports the planner from one place; a short command does not wait for the compiler."""

from __future__ import annotations

import math
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

import gcs.planning
from gcs.planning import AgentState, Grid, PlanOptions, plan_routes, plan_swarm

PUBLIC = """AgentState Grid LoiterSpec MissionInputs PlanNote PlanOptions PlanResult SwarmPlan TargetDemand
plan_mission plan_routes plan_swarm"""
WALL = np.zeros((21, 31), dtype=bool)
WALL[:16, 15] = True
AGENTS = np.array([[0.0, 0.0], [0.0, 100.0], [0.0, 200.0]])
TARGETS = np.array([[600.0, 210.0], [600.0, 10.0]])


def test_a_plan_takes_the_public_names_alone():
    grid = Grid((0.0, 0.0), 20.0, [[False] * 11 for _ in range(11)])
    result = plan_routes(grid, {1: AgentState(0.0, 0.0)}, {(0, 0): (200.0, 200.0)}, {}, PlanOptions())
    assert result.routes[0].points_m[-1].tolist() == [200.0, 200.0]


def test_the_public_names_are_these():
    assert gcs.planning.__all__ == sorted(PUBLIC.split())


def test_every_public_name_exists_and_others_do_not():
    for name in gcs.planning.__all__:
        assert getattr(gcs.planning, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'plan_route'"):
        _ = gcs.planning.plan_route


def test_importing_the_package_loads_no_compiler():
    code = "import sys, gcs.planning; print([m for m in ('numba', 'scipy', 'numpy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_arrays_give_clear_routes_to_all_targets_with_the_least_total_length():
    found = plan_swarm(WALL, 20.0, AGENTS, TARGETS, clearance_m=15.0)
    assert sorted(found.target.tolist()) == [-1, 0, 1]
    assert found.notes == ()
    grid = Grid((0.0, 0.0), 20.0, WALL)
    for i, (target, path_m) in enumerate(zip(found.target, found.paths_m, strict=True)):
        if target < 0:
            assert path_m.shape == (0, 2)
            assert math.isnan(found.lengths_m[i])
            continue
        assert path_m[0].tolist() == AGENTS[i].tolist()
        assert path_m[-1].tolist() == TARGETS[target].tolist()
        assert found.lengths_m[i] == pytest.approx(np.hypot(*np.diff(path_m, axis=0).T).sum())
        along = np.vstack([a + (b - a) * np.linspace(0, 1, 200)[:, None] for a, b in pairwise(path_m)])
        assert all(grid.is_free((east, north)) for east, north in along)
    others = [plan_swarm(WALL, 20.0, AGENTS[[i, j]], TARGETS, clearance_m=15.0) for i, j in ((0, 1), (0, 2))]
    assert found.total_length_m <= min(other.total_length_m for other in others) + 1e-9


def test_a_turn_radius_rounds_the_corners_of_the_paths():
    sharp, flown = (plan_swarm(WALL, 20.0, AGENTS[:1], TARGETS[1:], turn_radius_m=r) for r in (None, 60.0))
    assert flown.target.tolist() == sharp.target.tolist() == [0]
    assert flown.lengths_m[0] > sharp.lengths_m[0]


def test_an_unreachable_target_is_left_out_and_named():
    walled = WALL.copy()
    walled[:, 15] = True
    found = plan_swarm(walled, 20.0, AGENTS, TARGETS)
    assert found.target.tolist() == [-1, -1, -1]
    assert found.total_length_m == 0.0
    assert any("T0.0" in note.line for note in found.notes)


def test_no_agents_and_no_targets_are_an_empty_plan():
    found = plan_swarm(WALL, 20.0, [], TARGETS)
    assert (found.target.size, found.paths_m) == (0, ())
    assert plan_swarm(WALL, 20.0, AGENTS, []).target.tolist() == [-1, -1, -1]


WRONG = {
    "a flat map": ({"blocked": [False, True]}, "blocked: expected shape (rows, cols) with at least"),
    "costs for a map": ({"blocked": np.zeros((3, 3))}, "blocked: expected bool, True for a blocked cell"),
    "agents with heights": (
        {"agents_m": np.zeros((2, 3))},
        "agents_m: expected shape (n, 2), east and north",
    ),
    "a target as NaN": ({"targets_m": [[0, np.nan]]}, "targets_m: expected finite metres; row 0"),
    "no spacing": ({"spacing_m": 0.0}, "spacing_m must be a positive number"),
    "negative clearance": ({"clearance_m": -1.0}, "clearance_m: expected metres of at least 0, got -1.0"),
}


@pytest.mark.parametrize("case", WRONG)
def test_an_argument_of_another_shape_is_refused_in_words(case):
    wrong, said = WRONG[case]
    arguments = {"blocked": WALL, "spacing_m": 20.0, "agents_m": AGENTS, "targets_m": TARGETS} | wrong
    with pytest.raises(ValueError, match=said.split(": ")[0].split(" ")[0]) as raised:
        plan_swarm(**arguments)
    assert said in str(raised.value)
