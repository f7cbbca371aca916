"""What a user would lose: over a bad radio every route would end where its target was half a minute ago."""

import pytest

from gcs.core.tasking.tasking_state import AgentTasking
from gcs.core.tasking.upload_latency import DELIVERY_S, late_s, left_s, note_failure, note_success


def test_a_good_link_is_expected_at_first() -> None:
    tasking = AgentTasking()
    assert late_s(tasking) == 0.0
    assert left_s(tasking, 0.0) == DELIVERY_S


def test_the_time_is_learnt_from_missions_that_arrived_and_forgotten_when_the_link_is_better() -> None:
    tasking = AgentTasking()
    for _ in range(8):
        note_success(tasking, 30.0)
    assert late_s(tasking) == pytest.approx(30.0 - DELIVERY_S, abs=0.3)
    assert left_s(tasking, 10.0) == pytest.approx(20.0, abs=0.3)
    for _ in range(8):
        note_success(tasking, 1.0)
    assert late_s(tasking) < 0.2


def test_an_abandoned_upload_shows_only_a_lower_bound() -> None:
    tasking = AgentTasking()
    note_failure(tasking, 0.3)
    assert late_s(tasking) == 0.0
    note_failure(tasking, 25.0)
    assert late_s(tasking) == pytest.approx(12.0)
