"""Compiles the kernels before the first test that calls them.

Examples of Hypothesis have no time limit: machines differ. SWARM_GCS_REWORD=1 rewords all notices.
"""

import fcntl
import os
import sys
from collections.abc import Generator
from functools import lru_cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from rich.console import Console

settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

if os.environ.get("SWARM_GCS_REWORD"):
    from helpers.rewording import reword_notices

    reword_notices()


STARTS_PROCESSES = {
    "cli",
    "console",
    "faults",
    "io",
    "service",
    "sim_vehicles",
    "system",
    "test_cli.py",
    "test_docs.py",
    "test_jit.py",
    "test_rewording.py",
}
"""Folders and files with tests that call kernels in other processes, or import them when they run."""


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Compile outside of every test: their time limits are not made for a first start."""
    folder = item.path.relative_to(Path(__file__).parent).parts[0]
    if "gcs.jit" in sys.modules or folder in STARTS_PROCESSES:
        load_kernels_once()
    return (yield)


@lru_cache
def load_kernels_once() -> None:
    """Load the kernels, or compile them in the first worker to come here, while the others wait."""
    from gcs.cli.warm_up_progress import ALL, load_kernels

    with Path(__file__).open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        load_kernels(Console(stderr=True), *ALL)


@pytest.fixture(autouse=True)
def _program_errors_raise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail the test after an event of an upload without a rule, which in flight ends that upload only."""
    from gcs.mavlink.mission.upload import Upload

    def fail(_upload: Upload, error: Exception, _t_ns: int) -> None:
        raise error

    monkeypatch.setattr(Upload, "end_after_error", fail)
