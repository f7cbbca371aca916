"""Missions that are over soon, and uploads without a mission, for tests of all folders."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from gcs.config import parse, read_text
from gcs.core.state import State
from gcs.core.tasking.upload_manager import UploadManager
from gcs.geo import LocalFrame
from gcs.mavlink.fleet.fleet import Fleet


def short_mission(folder: Path) -> Path:
    """Write the shipped deterministic mission with its targets 300 m ahead of the agents, on a free map."""
    text, _ = read_text("deterministic")
    text = re.sub(r"discs_m = \[\n.*?\n\]", "discs_m = []", text, count=1, flags=re.DOTALL)
    text, moved = re.subn(r"east_m = 1[78]\d0\.0", "east_m = 420.0", text)
    assert moved == 8, "four targets and their places of birth"
    file = folder / "short.toml"
    file.write_text(text)
    return file


class FreeSky:
    """Stands in for all that delays or refuses a mission: nothing does."""

    def climb(self, _vehicle: int, _layer: int, *, in_takeoff: bool) -> None:
        return None

    def problem(self, *_: object) -> None:
        return None

    def flight_problem(self, *_: object) -> None:
        return None

    def holds_back(self, *_: object) -> str:
        return ""

    def is_known_to_wait(self, *_: object) -> bool:
        return False

    def last_checked_t_ns(self, _vehicle: int) -> int:
        return 0


def upload_manager(
    fleet: Fleet, frame: LocalFrame, vehicles: Iterable[int], max_parallel: int = 32
) -> UploadManager:
    """Return the uploads to these vehicles, before the first event."""
    text = f"""
name = "uploads"
[frame]
lat_deg = {frame.lat_deg}
lon_deg = {frame.lon_deg}
alt_msl_m = {frame.alt_msl_m}
[links]
max_parallel_uploads = {max_parallel}
[[agents]]
system_id = 1
east_m = 100.0
north_m = 100.0
[[births]]
east_m = 500.0
north_m = 500.0
"""
    state = State.initial(vehicles)
    for vehicle, agent in state.agents.items():
        agent.link = fleet._vehicles[vehicle].link
    config = parse(text, "uploads.toml")
    free: Any = FreeSky()
    return UploadManager(config, fleet, state.agents, state.tasking, free, free, free, free)
