"""An operator would start with a vehicle that the checks refuse, or checks would delay the flight."""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import sys
import time
from dataclasses import replace

import msgspec
import pytest
from playwright.sync_api import expect

from gcs.console.web import preflight_run
from gcs.console.web.preflight_run import PreflightDesk
from gcs.core.preflight.check_codes import CheckCode
from gcs.core.preflight.result import CheckRow, PreflightResult

PRINTS = 'import time, sys; time.sleep(0.2); print(\'{"mission": "a", "refused": 2}\')'
FAILS = "import sys; sys.exit('no endpoint for other ground stations')"


def checks(monkeypatch: pytest.MonkeyPatch, program: str, mission_file: str | None, pages: int = 1) -> list:
    """Return what pages get that ask at the same time."""
    monkeypatch.setattr(preflight_run, "_COMMAND", (sys.executable, "-c", program))

    async def ask() -> list:
        desk = PreflightDesk(mission_file)
        return await asyncio.gather(*(desk.run() for _ in range(pages)))

    return asyncio.run(ask())


def test_pages_that_ask_at_once_share_one_run_of_the_checks(monkeypatch):
    one, other = checks(monkeypatch, PRINTS, "mission.toml", pages=2)
    assert one.result.refused == 2
    assert one.result is other.result


def test_a_failure_of_the_checks_is_shown_with_its_reason(monkeypatch):
    (one,) = checks(monkeypatch, FAILS, "mission.toml")
    assert one.result.error == "no endpoint for other ground stations"


def test_nothing_is_started_where_there_is_no_mission_file(fly):
    with fly() as flight:
        code, body, _ = flight.request("/api/preflight", {})
        assert (code, json.loads(body)) == (200, {"possible": False, "running": False, "result": None})


def test_checks_are_started_on_the_page_and_what_they_refuse_is_shown(fly, page, monkeypatch):
    passed = CheckRow(vehicle=3, name="GPS", code=CheckCode.FIX, level="ok", value="3D fix, 12 satellites")
    failed = CheckRow(
        vehicle=3,
        name="link",
        code=CheckCode.NOT_HEARD,
        level="refused",
        value="not heard",
        wanted="heartbeats",
        remedy="is it on?",
    )
    found = PreflightResult(mission="prescribed", refused=1, checks=(passed, failed))
    printed = f"print({msgspec.json.encode(found).decode()!r})"
    monkeypatch.setattr(preflight_run, "_COMMAND", (sys.executable, "-c", printed))
    with fly() as flight:
        flight._source = replace(flight._source, mission_file="mission.toml")
        flight.restart_console()
        page.goto(flight.url)
        with page.expect_popup() as opened:
            page.get_by_role("link", name="Preflight").click()
        shown = opened.value
        shown.get_by_role("button", name="Check now").click()
        expect(shown.locator("#verdict")).to_contain_text("1 refused: do not fly, 0 warnings")
        expect(shown.locator("h2")).to_have_text("Vehicle 3: 1 of 2 checks not ok")
        rows = shown.locator("table.checks tr")
        expect(rows).to_have_text(["linkrefusednot heardexpected: heartbeatsis it on?"])
        shown.get_by_label("problems only").uncheck()
        expect(rows).to_have_count(2)


@pytest.mark.real_time
@pytest.mark.timeout(300)
def test_the_page_says_which_vehicle_must_not_fly_and_what_to_do(field, page, tmp_path):
    command = [sys.executable, "-P", "-m", "gcs", "run", str(field), "--headless", "--console", "127.0.0.1:0"]
    command += ["--out", str(tmp_path / "run"), "--journal", str(tmp_path / "journal")]
    with (tmp_path / "log").open("w") as log, subprocess.Popen(command, stdout=log, stderr=log) as service:
        try:
            until_s, found = time.monotonic() + 60.0, None
            while found is None and time.monotonic() < until_s:
                time.sleep(0.1)
                found = re.search(r"console: (\S+)", (tmp_path / "log").read_text())
            assert found is not None
            page.goto(found[1])
            expect(page.locator("#vehicles tbody tr")).to_have_count(2)
            with page.expect_popup() as opened:
                page.get_by_role("link", name="Preflight").click()
            checks = opened.value
            checks.get_by_role("button", name="Check now").click()
            expect(checks.locator("#run")).to_have_text("Checking …")
            expect(checks.locator("#verdict")).to_contain_text("refused: do not fly", timeout=60_000)
            row = checks.locator("tr", has_text="FS_LONG_ACTN")
            expect(row).to_contain_text("when the link is lost, 2 glides")
            expect(checks.locator("h2", has_text="Vehicle 1")).to_have_count(1)
        finally:
            service.terminate()
            service.wait(20)
