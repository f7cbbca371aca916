"""A user would find the service out of memory in the afternoon."""

import pytest
import soak


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_forty_minutes_of_everything_leave_tables_and_memory_bounded():
    rows, before, _, peak, counts = soak.soak(0.7, 0.05, seed=1, warm_up_s=900.0, samples=3)
    grown = {path: size for path, size in peak.items() if size > 3 * before.get(path, 0) + 100}
    assert grown == {}
    assert rows[-1][1] < rows[0][1] + 10.0, rows
    assert counts["missions that arrived"] > 50
    assert counts["deaths"]
