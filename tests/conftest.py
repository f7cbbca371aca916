"""Compiles the kernels before the first test that calls them.

Examples of Hypothesis have no time limit: machines differ. There are 50, and others in each run.
SWARM_GCS_REWORD=1 rewords all notices; some tests always run with other words.
"""

import fcntl
import gc
import os
import sys
from collections.abc import Generator
from functools import lru_cache
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path

import pytest
from helpers.rewording import reword_notices, reworded
from hypothesis import HealthCheck, settings
from rich.console import Console

from gcs.cli.warm_up_progress import ALL, load_kernels
from gcs.model import NoticeCode

settings.register_profile(
    "any machine", deadline=None, max_examples=50, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any machine")

gc.set_threshold(100_000, 10, 10)
"""With Python's 700, each worker imports the test files in 14 s instead of 10 s."""

IS_REWORDED = bool(os.environ.get("SWARM_GCS_REWORD"))
if IS_REWORDED:
    reword_notices()


TESTS = Path(__file__).parent
RUNS_SERVICE = (
    "chaos",
    "cli",
    "faults",
    "service",
    "system",
    "sim_vehicles/autopilots/test_firmware.py",
    "test_cli.py",
    "test_docs.py",
    "test_jit.py",
)
"""Folders and files with tests that run the service in other processes, or import it when they run."""


WAITING = ("chaos", "console", "faults", "system")
"""Folders with tests that mostly wait, for processes that run in real time."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Spread files whose tests wait evenly among the others: workers get equal parts of the list."""
    files = [list(group) for _, group in groupby(items, key=lambda item: item.path)]
    waits = [any(file[0].path.is_relative_to(TESTS / one) for one in WAITING) for file in files]
    waiting = [file for file, is_waiting in zip(files, waits, strict=True) if is_waiting]
    others = [file for file, is_waiting in zip(files, waits, strict=True) if not is_waiting]
    places = [(k + 0.5) / len(waiting) for k in range(len(waiting))]
    places += [(k + 0.5) / len(others) for k in range(len(others))]
    placed = sorted(zip(places, [*waiting, *others], strict=True), key=lambda one: one[0])
    items[:] = [item for _, file in placed for item in file]


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Compile outside of every test: their time limits are not made for a first start."""
    if any(item.path.is_relative_to(TESTS / one) for one in RUNS_SERVICE):
        load_kernels_once(ALL)
    load_kernels_once(tuple(module for module in ALL if module in sys.modules))
    return (yield)


@lru_cache
def load_kernels_once(modules: tuple[str, ...]) -> None:
    """Load the kernels of modules; each worker begins with another one, and one worker compiles it."""
    number = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    begin = number % len(modules) if modules else 0
    for module in (*modules[begin:], *modules[:begin]):
        spec = find_spec(module)
        assert spec is not None
        assert spec.origin is not None
        with Path(spec.origin).open() as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            load_kernels(Console(stderr=True), module)


REWORDED = (
    "console/test_alarm_guide.py",
    "core/flight/test_flight.py",
    "core/tasking/test_first_legs.py",
    "mavlink/fleet/test_fleet.py",
)
"""Tests of notices that always run with other words: they, and the code, read codes and parameters."""


@pytest.fixture(autouse=True)
def _other_words(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if not IS_REWORDED and request.path in [TESTS / one for one in REWORDED]:
        for code in NoticeCode:
            monkeypatch.setattr(code, "text", reworded(code.text))


def pytest_collection_finish() -> None:
    """Exclude the test files from garbage collections: each command that flies begins with one, 0.5 s."""
    gc.freeze()


@pytest.fixture(autouse=True)
def _garbage_is_collected() -> Generator[None, None, None]:
    """Undo what a command does to the garbage collector of its process: a worker runs many commands.

    What it froze stays frozen, as there is no way to thaw that alone.
    """
    thresholds = gc.get_threshold()
    yield
    gc.set_threshold(*thresholds)


@pytest.fixture(autouse=True)
def _program_errors_raise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail the test after an event of an upload without a rule, which in flight ends that upload only."""
    from gcs.mavlink.mission.upload import Upload

    def fail(_upload: Upload, error: Exception, _t_ns: int) -> None:
        raise error

    monkeypatch.setattr(Upload, "end_after_error", fail)
