"""A standby takes over from a command that is killed: a short run of `tests/bench/chaos.py`."""

from __future__ import annotations

from pathlib import Path

from helpers.chaos import ChaosRun
from helpers.chaos_checks import check
from helpers.chaos_schedule import Fault, Schedule

MAX_GAP_S = 1.5
MAX_TAKE_OVER_S = 5.0
"""On a busy machine."""


def test_a_take_over_is_seen_by_no_vehicle(tmp_path: Path) -> None:
    faults = (Fault(1.0, "command", "kill"),)
    chaos = ChaosRun(tmp_path, Schedule(False, faults, ((0.2, 2, 1.0),), flies_to_the_end=False), 4.0)
    try:
        flight = chaos.fly()
    finally:
        chaos.close()
    check(flight)
    assert flight.problems == []
    assert len(flight.take_over_s) == 1
    assert flight.take_over_s[0] < MAX_TAKE_OVER_S
    assert flight.gap_s < MAX_GAP_S
