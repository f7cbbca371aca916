"""Heights above mean sea level in a mission file, converted to heights above home before validation.

Home is at the height of the frame's origin (`frame.alt_msl_m`).
"""

from __future__ import annotations

from gcs.config.schema import FrameTable, MissionTable
from gcs.config.validation import convert
from gcs.errors import ConfigError
from gcs.mistake_codes import MistakeCode


def with_altitude_above_home(raw: object, source: str) -> tuple[object, list[ConfigError]]:
    """Return the plain data of a mission file with `mission.altitude_rel_m`, and the mistakes in it."""
    if not isinstance(raw, dict) or not isinstance(raw.get("mission"), dict):
        return raw, []  # validation refuses this
    mission = raw["mission"]
    if "altitude_msl_m" not in mission:
        return raw, []
    if "altitude_rel_m" in mission:
        return raw, [
            ConfigError(
                source, "mission", MistakeCode.CONFLICT, "expected either altitude_rel_m or altitude_msl_m"
            )
        ]
    try:
        origin_msl_m = convert(raw.get("frame"), FrameTable, source, "frame").alt_msl_m
        altitude_msl_m = convert(mission, MissionTable, source, "mission").altitude_msl_m
    except ConfigError:
        return raw, []  # validation refuses this
    if altitude_msl_m is None or altitude_msl_m <= origin_msl_m:
        problem = f"expected more than frame.alt_msl_m, {origin_msl_m:g} m"
        return raw, [ConfigError(source, "mission.altitude_msl_m", MistakeCode.CONFLICT, problem)]
    return raw | {"mission": mission | {"altitude_rel_m": altitude_msl_m - origin_msl_m}}, []
