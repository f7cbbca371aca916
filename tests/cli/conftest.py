"""A short virtual flight, recorded once for all tests here."""

from pathlib import Path

import pytest

from sim_vehicles.campaign.simulate import fly
from sim_vehicles.world.scenario import load


@pytest.fixture(scope="session")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty-five seconds of `random-obstacles`, seed 3: the obstacles depend on the seed."""
    folder = tmp_path_factory.mktemp("runs") / "flight"
    fly(load("random-obstacles"), 3, folder, duration_s=25.0)
    return folder
