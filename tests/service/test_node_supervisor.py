"""A mission would have no standby after a take-over, or a node would go on that cannot be ended."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from helpers.processes import node_of

PROGRAM = """
import os, signal, sys, time
from gcs.service import node_supervisor
node_supervisor.FIRST_PAUSE_S = 0.05
start = node_supervisor.supervise_node(lambda text: print(text, flush=True))
print("start", start, flush=True)
{does}
"""
WAITS = """
def end(number, frame):
    print("ends", flush=True)
    time.sleep(0.3)
    sys.exit(0)
signal.signal(signal.SIGINT, end)
while True:
    time.sleep(0.1)
"""


class Supervised:
    """A supervisor whose node runs a program."""

    def __init__(self, does: str, folder: Path) -> None:
        self._log = folder / "log"
        with self._log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-c", PROGRAM.format(does=does)], stdout=log, stderr=log
            )

    def until(self, line: str) -> None:
        for _ in range(600):
            if line in self.printed():
                return
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(0.05)
        raise AssertionError(self.printed())

    def printed(self) -> list[str]:
        return self._log.read_text().splitlines()


@pytest.fixture
def waiting(tmp_path: Path) -> Iterator[Supervised]:
    one = Supervised(WAITS, tmp_path)
    one.until("start 1")
    yield one
    one.process.kill()
    one.process.wait()


def test_a_node_that_is_killed_is_started_again(waiting: Supervised) -> None:
    node_of(waiting.process).kill()
    waiting.until("start 2")
    assert "this node ended (killed by SIGKILL) and starts again in 0.05 s, as a standby" in waiting.printed()
    assert waiting.process.poll() is None


@pytest.mark.parametrize("code", [0, 2, 130])
def test_a_node_that_ends_in_order_or_by_a_mistake_is_not_started_again(tmp_path: Path, code: int) -> None:
    one = Supervised(f"sys.exit({code})", tmp_path)
    assert one.process.wait(30.0) == code
    assert one.printed() == ["start 1"]


def test_a_node_that_finds_an_endpoint_in_use_when_it_starts_again_tries_once_more(tmp_path: Path) -> None:
    one = Supervised("sys.exit((1, 2, 0)[start - 1])", tmp_path)
    assert one.process.wait(60.0) == 0
    assert one.printed()[-1] == "start 3"


def test_a_node_that_always_fails_is_given_up(tmp_path: Path) -> None:
    one = Supervised("sys.exit(1)", tmp_path)
    assert one.process.wait(60.0) == 1
    assert one.printed()[-1] == "start 6"


def test_an_interrupt_reaches_the_node_once_and_ends_both(waiting: Supervised) -> None:
    waiting.process.send_signal(signal.SIGINT)
    assert waiting.process.wait(30.0) == 0
    assert waiting.printed().count("ends") == 1


def test_a_node_does_not_outlive_its_supervisor(waiting: Supervised) -> None:
    node = node_of(waiting.process)
    waiting.process.kill()
    waiting.process.wait()
    with suppress(psutil.NoSuchProcess):
        node.wait(10.0)
    assert not node.is_running()
