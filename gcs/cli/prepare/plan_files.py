"""Missions of one plan as `.plan` files of QGroundControl, one for each vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from gcs.config import Config
from gcs.core.tasking.mission_builder import MissionBuilder
from gcs.errors import ConfigError, RecordingError
from gcs.fence import fence_of, rally_of
from gcs.mavlink.autopilots import ARDUPLANE, PX4, AutopilotProfile
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.mavlink.mission.plan_file import plan_document
from gcs.mistake_codes import MistakeCode
from gcs.model import Route, VehicleState, vehicle_name
from gcs.planning.manoeuvres.landing import ReturnRoute
from gcs.planning.planner_inputs import AgentState

_PROFILES: Final[dict[str, AutopilotProfile]] = {"arduplane": ARDUPLANE, "px4": PX4}


def autopilot_profile(name: str) -> AutopilotProfile:
    """Return the profile of an autopilot by its name on the command line.

    Raises
    ------
    ConfigError
        When there is none.
    """
    profile = _PROFILES.get(name.lower())
    if profile is None:
        raise ConfigError(
            "--autopilot", "", MistakeCode.UNKNOWN_NAME, f"expected {' or '.join(_PROFILES)}, not {name}"
        )
    return profile


def write_plan_files(
    folder: Path,
    config: Config,
    profile: AutopilotProfile,
    starts: Mapping[int, AgentState],
    routes: tuple[Route, ...],
    return_routes: Mapping[int, ReturnRoute],
) -> list[Path]:
    """Write the mission of each route, with the fence and the rally points of the mission file.

    Vehicles are in flight at their starts, and their homes are there.

    Raises
    ------
    GcsError
        When the fence is invalid, or a file cannot be written.
    """
    fence = fence_of(config)
    rally = rally_of(config)
    builder = MissionBuilder(config)
    paths = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for number, route in enumerate(routes, start=1):
            start = starts[route.vehicle]
            state = _in_flight(route.vehicle, start)
            mission = builder.of(route, number, state, return_routes.get(route.vehicle))
            place_deg = config.local_frame.to_geodetic(start.east_m, start.north_m)
            home = Home(*place_deg, config.frame.alt_msl_m)
            items = build_items(profile, mission, home)
            document = plan_document(profile, items, home, start.speed_m_s, fence, rally)
            path = folder / f"vehicle-{vehicle_name(route.vehicle).replace(':', '-')}.plan"
            path.write_bytes(msgspec.json.format(msgspec.json.encode(document), indent=4) + b"\n")
            paths.append(path)
    except OSError as error:
        raise RecordingError(str(folder), f"cannot be written: {error.strerror}") from None
    return paths


def _in_flight(vehicle: int, start: AgentState) -> VehicleState:
    course_rad = start.course_rad or 0.0
    return VehicleState(
        vehicle, 0, start.east_m, start.north_m, start.height_msl_m, start.speed_m_s, course_rad, "", True, -1
    )
