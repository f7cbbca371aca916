"""An operator would start with a vehicle that the checks refuse, or checks would delay the flight."""

from __future__ import annotations

import asyncio
import json
import sys

import pytest

from gcs.console import preflight
from gcs.console.preflight import PreflightDesk

PRINTS = 'import time, sys; time.sleep(0.2); print(\'{"mission": "a", "refused": 2}\')'
FAILS = "import sys; sys.exit('no endpoint for other ground stations')"


def checks(monkeypatch: pytest.MonkeyPatch, program: str, mission_file: str | None, pages: int = 1) -> list:
    """Return what pages get that ask at the same time."""
    monkeypatch.setattr(preflight, "_COMMAND", (sys.executable, "-c", program))

    async def ask() -> list:
        desk = PreflightDesk(mission_file)
        return await asyncio.gather(*(desk.run() for _ in range(pages)))

    return asyncio.run(ask())


def test_pages_that_ask_at_once_share_one_run_of_the_checks(monkeypatch):
    one, other = checks(monkeypatch, PRINTS, "mission.toml", pages=2)
    assert one["result"]["refused"] == 2
    assert one["result"] is other["result"]


def test_a_failure_of_the_checks_is_shown_with_its_reason(monkeypatch):
    (one,) = checks(monkeypatch, FAILS, "mission.toml")
    assert one["result"]["error"] == "no endpoint for other ground stations"


def test_nothing_is_started_where_there_is_no_mission_file(fly):
    with fly() as flight:
        code, body, _ = flight.request("/api/preflight", {})
        assert (code, json.loads(body)) == (200, {"possible": False, "running": False, "result": None})
