"""Somebody who follows a tutorial in several terminals, word for word, would be stopped."""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

import pytest
from helpers.desk import DOCS, Desk, await_text
from helpers.pages import ROOT, blocks, shown_commands

pytestmark = [pytest.mark.real_time, pytest.mark.timeout(300)]


def test_the_first_flight_is_checked_confirmed_taken_over_and_given_back(tmp_path: Path) -> None:
    desk = Desk(tmp_path, "tutorials/first-flight.md")
    check, plan, vehicle, preflight, fence, again, run, *orders = shown_commands(
        DOCS / "tutorials/first-flight.md"
    )
    assert "gcs check" in check
    assert orders[0] == "gcs status"
    desk.run(check)
    desk.run(plan)
    with desk.started(desk.words(vehicle), "flying at speed 1"):
        refused = desk.run(preflight, code=1)
        assert "refused ceiling" in refused
        assert "1 refused" in refused
        assert "FENCE_ALT_MAX = 250" in desk.run(fence)
        assert "nothing refused, 4 warnings" in desk.run(again)
        with desk.started(desk.words(run), "plan 1 waits") as log:
            for order in orders:
                desk.run(order)
            said = log.read_text()
    steps = ["LOITER -> AUTO", "AUTO -> LOITER", "LOITER -> AUTO", "AUTO -> RTL", "RTL -> AUTO"]
    assert re.findall(r"agent 1: mode (\w+ -> \w+)", said) == steps, said


def test_a_sensor_of_ones_own_is_seen_by_central_command(tmp_path: Path) -> None:
    desk = Desk(tmp_path, "tutorials/own-mission-file.md")
    run, status = shown_commands(DOCS / "tutorials" / "own-sensor.md")
    program, *others = blocks(ROOT / "docs" / "sensors.md", "python")
    assert others == []
    for before, after in (
        ("tcp/127.0.0.1:7447", desk.zenoh),
        ("swarm/prescribed/", "swarm/own/"),
        ("z_m=[[102.5, 880.0], [1460.2, 310.7]]", "z_m=[[1700.0, 700.0]]"),
    ):
        assert before in program
        program = program.replace(before, after)
    (tmp_path / "sensor.py").write_text(program)
    with desk.started(desk.words(run), "Ctrl-C ends it") as log:
        assert "never" in desk.run(status)
        with desk.started([sys.executable, "sensor.py"], ""):
            deadline = time.monotonic() + 30.0
            while not re.search(
                r"T0\.0 +1\.00 +1700 +700 .*radar-1 +\d\.\d s ago", shown := desk.run(status), re.DOTALL
            ):
                assert time.monotonic() < deadline, shown
            await_text(log, "20 announced; check its configuration")
            await_text(log, "mission ended: 0 arrived, 2 lost")
