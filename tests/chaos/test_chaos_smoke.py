"""A standby takes over from a command that is killed, or cut off: short runs of `tests/bench/chaos.py`."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.chaos import ChaosRun, Flight
from helpers.chaos_checks import check
from helpers.chaos_schedule import Fault, Schedule

pytestmark = pytest.mark.timeout(400)  # nodes start several times
SPEED = 2.0
MAX_GAP_S = 1.5
MAX_TAKE_OVER_S = 5.0
"""On a busy machine."""


def fly(folder: Path, *faults: Fault, is_bridge_alone: bool) -> Flight:
    """Fly for a short time under faults, and check the run."""
    schedule = Schedule(is_bridge_alone, faults, ((0.2, 2, 1.0),), flies_to_the_end=False, answer_s=10.0)
    chaos = ChaosRun(folder, schedule, SPEED)
    try:
        flight = chaos.fly()
    finally:
        chaos.close()
    check(flight)
    return flight


@pytest.mark.real_time
def test_of_two_live_commands_after_a_partition_one_reaches_the_vehicles(tmp_path: Path) -> None:
    radio = Fault(0.5, "radio", "reorder", 4.0)
    partition = Fault(1.0, "command to all", "cut", 4.0)
    flight = fly(tmp_path, radio, partition, is_bridge_alone=True)
    assert flight.problems == []
    recorded = [node.name for node in flight.nodes if (tmp_path / node.name).exists()]
    assert len(recorded) == 2  # the standby took over from a command that went on


@pytest.mark.real_time
def test_a_take_over_is_seen_by_no_vehicle(tmp_path: Path) -> None:
    flight = fly(tmp_path, Fault(1.0, "command", "kill"), is_bridge_alone=False)
    assert flight.problems == []
    assert len(flight.take_over_s) == 1
    assert flight.take_over_s[0] < MAX_TAKE_OVER_S
    assert flight.gap_s < MAX_GAP_S
