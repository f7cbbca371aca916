"""The height at which a vehicle returns, held against its ceilings and against the others'. Pure.

A return that climbs through the ceiling breaches the fence: PX4 then went from RTL to Hold (GF_ACTION 2).
Altitude layers end where RTL begins: vehicles that are sent home together fly at the heights that their
autopilots are set to.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from gcs.core.preflight.result import Check
from gcs.mavlink.autopilots import AutopilotProfile
from gcs.model import vehicle_name

MARGIN_M: Final = 15.0
"""Between the highest flight that is planned and a ceiling: an ArduPlane was seen to climb up to 11.3 m past
the altitude of its take-off."""
_PER_METRE: Final = {"RTL_ALTITUDE": 1.0, "ALT_HOLD_RTL": 100.0, "RTL_RETURN_ALT": 1.0}
_TOLERANCE_M: Final = 0.5
_MAX_NAMED: Final = 8


@dataclass(frozen=True, slots=True)
class Return:
    """How high a vehicle returns."""

    vehicle: int
    height_m: float
    """Above home."""
    source: str
    """What sets that, in words."""
    parameter: str
    """Its parameter; empty where a rally point alone sets the height."""
    value: float
    """The parameter's, in its own unit."""

    @property
    def words(self) -> str:
        """Who returns how high, and by what."""
        return f"{vehicle_name(self.vehicle)} at {self.height_m:g} m ({self.source})"

    def raised_to(self, height_m: float) -> str:
        """Return the command that makes the vehicle return at another height."""
        value = self.value + (height_m - self.height_m) * _PER_METRE[self.parameter]
        return f"gcs param set CONFIG {self.parameter} {value:g} -v {vehicle_name(self.vehicle)}"


def return_of(
    vehicle: int, profile: AutopilotProfile, values: Mapping[str, float], rally_m: Sequence[float]
) -> Return | None:
    """Return how high a vehicle returns; None when its parameters do not tell.

    Of several rally points the highest counts, as if it were the nearest.
    """
    heights_m = profile.return_heights(values, rally_m)
    if not heights_m:
        return None
    source, height_m = next(iter(heights_m.items()))  # a rally point goes before what counts without one
    parameter = next((name for name in _PER_METRE if name in values and name in source), "")
    return Return(vehicle, height_m, source, parameter, values.get(parameter, 0.0))


def meeting(returns: Sequence[Return], step_m: float) -> list[Return]:
    """Return those that are nearer than `step_m` to another one's height, the lowest first."""
    near: list[Return] = []
    for lower, upper in pairwise(sorted(returns, key=lambda one: (one.height_m, one.vehicle))):
        if upper.height_m - lower.height_m < step_m - _TOLERANCE_M:
            near += [one for one in (lower, upper) if one not in near]
    return near


def returns_check(returns: Sequence[Return], step_m: float) -> Iterator[Check]:
    """Warn of vehicles that return at heights nearer to each other than the layers of the mission.

    Parameters
    ----------
    step_m : float
        Between altitude layers; 0: the mission has none, and nothing is said.
    """
    if step_m <= 0.0 or len(returns) < 2:
        return
    wanted, near = f"{step_m:g} m between them", meeting(returns, step_m)
    if not near:
        heights = ", ".join(f"{one.height_m:g}" for one in returns[:_MAX_NAMED])
        yield Check(None, "return heights", "ok", f"{heights} m")
        return
    shown = [one.words for one in near[:_MAX_NAMED]]
    more = f" and {len(near) - _MAX_NAMED} more" if len(near) > _MAX_NAMED else ""
    remedy = "sent home together they meet at one height: return them one after another"
    if all(one.parameter for one in near):
        commands, height_m = [], near[0].height_m
        for one in near[1:_MAX_NAMED]:
            height_m = max(height_m + step_m, one.height_m)
            if height_m > one.height_m:
                commands.append(one.raised_to(height_m))
        remedy += f", or {', '.join(commands)} (below the ceiling)"
    else:
        remedy += ", or fly without rally points: then RTL_ALTITUDE of each counts"
    yield Check(None, "return heights", "warning", f"agents {', '.join(shown)}{more}", wanted, remedy)


def return_height_check(
    vehicle: int,
    profile: AutopilotProfile,
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
