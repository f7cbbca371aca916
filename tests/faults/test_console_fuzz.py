"""A program that asks the console for anything would stop the heartbeats to the vehicles."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

_FILE = Path(__file__).parents[1] / "bench" / "fuzz_console.py"
_spec = importlib.util.spec_from_file_location("fuzz_console", _FILE)
assert _spec is not None
assert _spec.loader is not None
fuzz_console = importlib.util.module_from_spec(_spec)
sys.modules["fuzz_console"] = fuzz_console
_spec.loader.exec_module(fuzz_console)

ATTACK_S = 6.0
MAX_GAP_S = 1.5
"""More than the 0.6 s of a machine that does nothing else: tests run side by side."""


@pytest.mark.timeout(200)
def test_hostile_requests_stop_no_heartbeat_and_lock_no_operator_out(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    found = fuzz_console.fuzz(tmp_path, ATTACK_S, "--seed", 1, "--threads", 6, calm_s=1.0)
    assert found["vehicles"] == 4
    assert found["service_alive"]
    assert found["longest_gap_s"] < MAX_GAP_S, found
    assert found["operator_failures"] == [], found
    assert found["operator_longest_wait_s"] < 5.0
    assert found["program_errors"] == []
    assert found["lines_printed"] < 100
    assert sum(found["sent"].values()) > 50
