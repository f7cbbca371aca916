"""Random missions with arms, holds, returns and resumes: no pair meets in the air untold."""

from __future__ import annotations

import pytest
from flown_separation import fly

MIN_LEAD_S = 5.0


@pytest.mark.parametrize("seed", [1, 38])
def test_each_pair_that_comes_near_in_a_random_mission_was_told_before(seed):
    """A failsafe sends the vehicles of these missions home, at one height."""
    flown = fly(seed)
    assert flown.in_air_s > 300.0
    assert flown.pairs
    assert all(pair.lead_s is not None and pair.lead_s >= MIN_LEAD_S for pair in flown.pairs)
