"""Makes what several fault tests share importable, and the wall clock settable."""

import sys
from pathlib import Path

import pytest

from gcs.io import clock

sys.path.insert(0, str(Path(__file__).parent))

from wall_clock import WallClock


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> WallClock:
    """Let the service read a wall clock that the test sets."""
    wall = WallClock()
    monkeypatch.setattr(clock, "time", wall)
    return wall
