"""What a user would lose: over a bad radio every route would end where its target was half a minute ago."""

import pytest

from gcs.core.state import State
from gcs.core.tasking.upload_latency import DELIVERY_S, UploadLatency


def test_a_good_link_is_expected_at_first() -> None:
    delays = UploadLatency(State.initial([1, 2]).agents)
    assert delays.late_s(1) == 0.0
    assert delays.left_s(1, 0.0) == DELIVERY_S


def test_the_time_is_learnt_from_missions_that_arrived_and_forgotten_when_the_link_is_better() -> None:
    delays = UploadLatency(State.initial([1, 2]).agents)
    for _ in range(8):
        delays.note_success(1, 30.0)
    assert delays.late_s(1) == pytest.approx(30.0 - DELIVERY_S, abs=0.3)
    assert delays.late_s(2) == 0.0
    assert delays.left_s(1, 10.0) == pytest.approx(20.0, abs=0.3)
    for _ in range(8):
        delays.note_success(1, 1.0)
    assert delays.late_s(1) < 0.2


def test_an_abandoned_upload_shows_only_a_lower_bound() -> None:
    delays = UploadLatency(State.initial([1, 2]).agents)
    delays.note_failure(1, 0.3)
    assert delays.late_s(1) == 0.0
    delays.note_failure(1, 25.0)
    assert delays.late_s(1) == pytest.approx(12.0)
