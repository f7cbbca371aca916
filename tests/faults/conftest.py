"""Makes the wall clock settable."""

import pytest
from helpers.wall_clock import WallClock

from gcs.io import clock


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> WallClock:
    """Let the service read a wall clock that the test sets."""
    wall = WallClock()
    monkeypatch.setattr(clock, "time", wall)
    return wall
