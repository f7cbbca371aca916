"""A user would find the service out of memory in the afternoon."""

import importlib.util
from pathlib import Path

import pytest

BENCH = Path(__file__).parent.parent / "bench" / "soak.py"


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_forty_minutes_of_everything_leave_tables_and_memory_bounded():
    spec = importlib.util.spec_from_file_location("soak", BENCH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    rows, before, _, peak, counts = module.soak(0.7, 0.05, seed=1, warm_up_s=900.0, samples=3)
    grown = {path: size for path, size in peak.items() if size > 3 * before.get(path, 0) + 100}
    assert grown == {}
    assert rows[-1][1] < rows[0][1] + 10.0, rows
    assert counts["missions that arrived"] > 50
    assert counts["deaths"]
