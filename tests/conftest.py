"""Before the first test: kernels compiled, or loaded, once. Makes importable what several folders share.

Examples of Hypothesis have no time limit: machines differ.
"""

import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from rich.console import Console

import sim_vehicles  # noqa: F401  (before tests/sim_vehicles can be taken for it, as in an editable installation)

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "bench")]

settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile outside of every test: their time limits are not made for a first start."""
    if hasattr(session.config, "workerinput") or session.config.option.collectonly:
        return
    from gcs.cli.warm_up_progress import ALL, load_kernels

    load_kernels(Console(stderr=True), *ALL)


@pytest.fixture(autouse=True)
def _program_errors_raise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail the test after an event of an upload without a rule, which in flight ends that upload only."""
    from gcs.mavlink.mission.upload import Upload

    def fail(_upload: Upload, error: Exception, _t_ns: int) -> None:
        raise error

    monkeypatch.setattr(Upload, "end_after_error", fail)
