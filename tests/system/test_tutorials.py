"""Somebody who follows a tutorial in several terminals, word for word, would be stopped."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers.pages import ROOT, SAVED, blocks, shown_commands, text_of, words_of
from helpers.processes import GCS, free_port

from gcs.io.zenoh.session import free_endpoint

PROGRAMS = {"gcs": GCS, "sim-vehicles": [sys.executable, "-P", "-m", "sim_vehicles"]}
TUTORIALS = ROOT / "docs" / "tutorials"
pytestmark = [pytest.mark.real_time, pytest.mark.timeout(300)]


class Desk:
    """Terminals in one folder with the files that a page has saved, on links of their own."""

    def __init__(self, folder: Path, page: str) -> None:
        self.folder = folder
        self.zenoh = free_endpoint()
        self.port = free_port()
        links = f'\n[links]\nmavlink = "udpin:127.0.0.1:{self.port}"\nzenoh = "{self.zenoh}"\n'
        for name, language, text in SAVED.findall(text_of(TUTORIALS / page)):
            (folder / name).write_text(text + links if language == "toml" else text)
        self.environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "COLUMNS": "200"}

    def words(self, line: str) -> list[str]:
        program, *words = words_of(line)
        more = ["--gcs", f"127.0.0.1:{self.port}", "--zenoh", self.zenoh] if program == "sim-vehicles" else []
        more += ["--console", "off"] if words[:1] == ["run"] and program == "gcs" else []
        return [*PROGRAMS[program], *words, *more]

    def run(self, line: str, code: int = 0) -> str:
        """Type a command, and `y` where it asks; return what it prints."""
        ours, theirs = os.openpty()
        os.write(ours, b"y\n")
        done = subprocess.run(
            self.words(line), cwd=self.folder, env=self.environment, stdin=theirs, timeout=60.0, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        os.close(ours)
        os.close(theirs)
        assert done.returncode == code, f"{line}: {done.stdout}"
        return done.stdout

    @contextmanager
    def started(self, words: list[str], until: str) -> Iterator[Path]:
        """Start a command in a terminal of its own, and wait until its file has some text."""
        log = self.folder / f"{len(list(self.folder.glob('*.log')))}.log"
        with log.open("wb") as output:
            process = subprocess.Popen(
                words, cwd=self.folder, env=self.environment, stdout=output, stderr=subprocess.STDOUT
            )
        try:
            await_text(log, until)
            yield log
        finally:
            process.terminate()
            process.wait(30.0)


def await_text(log: Path, text: str) -> None:
    deadline = time.monotonic() + 60.0
    while text not in log.read_text():
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.1)


def test_the_first_flight_is_checked_confirmed_taken_over_and_given_back(tmp_path: Path) -> None:
    desk = Desk(tmp_path, "first-flight.md")
    check, plan, vehicle, preflight, fence, again, run, *orders = shown_commands(
        TUTORIALS / "first-flight.md"
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
    desk = Desk(tmp_path, "own-mission-file.md")
    run, status = shown_commands(TUTORIALS / "own-sensor.md")
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
