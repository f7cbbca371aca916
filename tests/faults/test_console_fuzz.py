"""A program that asks the console for anything would stop the heartbeats to the vehicles."""

from __future__ import annotations

import fuzz_console
import pytest

ATTACK_S = 6.0
MAX_GAP_S = 1.5
"""Beside the time for which the service, and the tap that measures, wait for a processor."""


@pytest.mark.real_time
@pytest.mark.timeout(200)
def test_hostile_requests_stop_no_heartbeat_and_lock_no_operator_out(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    found = fuzz_console.fuzz(tmp_path, ATTACK_S, "--seed", 1, "--threads", 6, calm_s=1.0)
    assert found["vehicles"] == 4
    assert found["service_alive"]
    assert found["longest_gap_s"] < MAX_GAP_S + found["waited_for_processor_s"], found
    assert found["operator_failures"] == [], found
    assert found["program_errors"] == []
    assert found["lines_printed"] < 100
    assert sum(found["sent"].values()) > 50
