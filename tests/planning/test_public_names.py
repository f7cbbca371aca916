"""A user imports the planner from one place; a short command does not wait for the compiler."""

from __future__ import annotations

import subprocess
import sys

import pytest

import gcs.planning
from gcs.planning import AgentState, Grid, PlanOptions, plan_routes


def test_a_plan_takes_the_public_names_alone():
    grid = Grid((0.0, 0.0), 20.0, [[False] * 11 for _ in range(11)])
    result = plan_routes(grid, {1: AgentState(0.0, 0.0)}, {(0, 0): (200.0, 200.0)}, {}, PlanOptions())
    assert result.routes[0].points_m[-1].tolist() == [200.0, 200.0]


def test_every_public_name_exists_and_others_do_not():
    for name in gcs.planning.__all__:
        assert getattr(gcs.planning, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'plan_route'"):
        _ = gcs.planning.plan_route


def test_importing_the_package_loads_no_compiler():
    code = "import sys, gcs.planning; print([m for m in ('numba', 'scipy', 'numpy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
