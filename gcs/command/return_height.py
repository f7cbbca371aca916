"""The height at which a vehicle returns, held against its ceilings. Pure.

A return that climbs through the ceiling breaches the fence: PX4 then went from RTL to Hold (GF_ACTION 2).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from gcs.command.checks import Check
from gcs.mavlink.profiles import Profile

MARGIN_M: Final = 15.0
"""Between the highest flight that is planned and a ceiling: an ArduPlane was seen to climb up to 11.3 m past
the altitude of its take-off."""


def return_height_check(
    vehicle: int,
    profile: Profile,
    values: Mapping[str, float],
    rally_m: Sequence[float],
    ceiling_m: float,
) -> Iterator[Check]:
    """Judge the greatest height at which a vehicle may return; nothing when its parameters do not tell.

    Parameters
    ----------
    rally_m : sequence of float
        Heights of rally points above home: the vehicle's, and those of the mission file.
    ceiling_m : float
        The mission file's, above home; 0 for none.
    """
    heights_m = profile.return_heights(values, rally_m)
    if not heights_m:
        return
    name, height_m = max(heights_m.items(), key=lambda item: item[1])
    value, limits = f"{height_m:g} m ({name})", profile.fence_limits(values)
    ceilings_m = [limits.max_alt_rel_m] if limits.is_on and limits.max_alt_rel_m else []
    ceilings_m += [ceiling_m] if ceiling_m else []
    if not ceilings_m or height_m <= (highest_m := min(ceilings_m) - MARGIN_M):
        yield Check(vehicle, "return height", "ok", value)
        return
    wanted = f"at most {highest_m:g} m, {MARGIN_M:g} m below the ceiling"
    remedy = "RTL would climb into the ceiling: lower it, or the rally points, or raise the ceiling"
    yield Check(vehicle, "return height", "refused", value, wanted, remedy)
