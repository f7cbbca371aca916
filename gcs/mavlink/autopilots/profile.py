"""Profile of an autopilot: the differences between firmwares that matter to missions, modes and checks."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.preflight_parameters import Envelope, WantedParameter
from gcs.mavlink.mission.items import Item, first_item_difference

_GLOBAL: Final = dialect.MAV_FRAME_GLOBAL
_RELATIVE: Final = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT
_SAME_FRAME: Final = {
    dialect.MAV_FRAME_GLOBAL_INT: _GLOBAL,
    dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: _RELATIVE,
}


@dataclass(frozen=True, slots=True)
class FenceLimits:
    """Fence settings by a vehicle's parameters."""

    is_on: bool
    polygons: bool
    """True if uploaded polygons and circles are active."""
    max_alt_rel_m: float | None = None
    max_radius_m: float | None = None
    """Around home."""


@dataclass(frozen=True, slots=True)
class PossibleReturn:
    """Height at which a vehicle may return."""

    height_m: float
    """Above home."""
    parameter: str = ""
    """Name of the parameter that sets it; empty if a rally point alone does."""
    rally_m: float = 0.0
    """Height of the rally point that the parameter is added to."""

    @property
    def source(self) -> str:
        """Rally point and parameter that set the height, in words."""
        if not self.parameter:
            return "rally point"
        if self.rally_m == 0.0:
            return self.parameter
        return f"rally point {self.rally_m:g} m + {self.parameter} {self.height_m - self.rally_m:g} m"


@dataclass(frozen=True, slots=True)
class FailsafeText:
    """STATUSTEXT that names a failsafe or its cause."""

    pattern: re.Pattern[str]
    """Matches the begin of the text."""
    max_severity: int
    """Highest MAV_SEVERITY with which it is sent."""
    modes: frozenset[str] = frozenset()
    """Modes that the failsafe chooses at the time of this text."""
    ends: bool = False
    """True if the text says that the failsafe has ended. Its mode stays."""
    names_cause: bool = True


@dataclass(frozen=True, slots=True)
class AutopilotProfile:
    """Table of one firmware."""

    name: str
    autopilot: int
    """MAV_AUTOPILOT."""
    home_items: int
    """Items before the first that is flown."""
    atomic: bool
    """True if an upload replaces the old mission as a whole, at its end; False if item by item, in place."""
    window: int
    """Items in flight at a time: sent without a request after a timeout, or requested in a download."""
    in_order: bool
    """True if a download must request items in order, and an upload's last item must have been requested."""
    tracks_old_leg: bool
    """True if a leg may start at the waypoint before, not at the vehicle."""
    climbs_first: bool
    """True if it climbs in a circle to a mission's first point when it goes from LOITER to AUTO."""
    widens_circles: bool
    """True if radii of circles are those at sea level: in thin air it flies wider ones, by the density."""
    marks_current: bool
    """True if `current` on an uploaded item makes the mission begin there."""
    ends_in: str
    """Mode after a mission's last item, if that item ends."""
    unused: float
    """Value of unused parameters: NaN or 0."""
    min_radius_m: float
    """Acceptance radius below which the autopilot uses its default."""
    takeoff_pitch_deg: float
    modes: Mapping[tuple[int, int], str]
    """Name by (main, sub) mode, as in parameters 2 and 3 of DO_SET_MODE."""
    split_mode: Callable[[int], tuple[int, int]]
    """Returns a heartbeat's custom_mode as (main, sub)."""
    critical_ends: bool
    """True if MAV_STATE_CRITICAL lasts as long as the failsafe's mode; False if it lasts as long as the
    cause, also when the failsafe changes no mode."""
    failsafe_modes: frozenset[str]
    """Modes that failsafes choose."""
    failsafe_texts: tuple[FailsafeText, ...]
    stored: Callable[[Item], Item]
    """Returns the item as the firmware keeps it, in addition to `normalised`."""
    parameters: tuple[WantedParameter, ...]
    fits: Callable[[Envelope], tuple[WantedParameter, ...]]
    """Returns the parameters that must fit the mission."""
    altitude_reference_parameter: str
    """Parameter of the rate, in m/s, at which the controlled altitude rises from sea level after a start;
    empty if it begins at the vehicle's altitude."""
    modes_without_altitude: frozenset[str]
    """Modes in which no altitude is controlled: after them the control begins at the vehicle's altitude."""
    fence_parameters: tuple[str, ...]
    """Parameters that `fence_limits` reads."""
    fence_limits: Callable[[Mapping[str, float]], FenceLimits]
    ceiling_parameter: str
    """Parameter of a fence's greatest height, in metres above home."""
    return_parameters: tuple[str, ...]
    """Parameters that `return_heights` reads, the newest name first."""
    return_circle_parameter: str
    """Height above home of the circle in which a return ends; empty if it keeps its height."""
    radius_parameters: tuple[str, str]
    """Radius of circles in LOITER, and in RTL; 0 in RTL: as in LOITER. Negative for circles to the left."""
    return_heights: Callable[[Mapping[str, float], Sequence[float]], Sequence[PossibleReturn]]
    """Returns the possible return heights, from parameters and the heights of rally points. The height at a
    rally point is the first."""

    def circle_radius_m(self, values: Mapping[str, float], *, in_return: bool = False) -> float | None:
        """Return the radius of circles in LOITER, or in RTL, in metres; negative for circles to the left.

        None if the parameters `values` do not tell it.
        """
        loiter_m, return_m = (values.get(name) for name in self.radius_parameters)
        return (return_m or loiter_m) if in_return else loiter_m

    # ------------------------------------------------------------ modes

    def mode_name(self, custom_mode: int) -> str:
        """Return the name of a heartbeat's mode."""
        main, sub = self.split_mode(custom_mode)
        return self.modes.get((main, sub)) or self.modes.get((main, 0)) or f"MODE({custom_mode})"

    def mode_numbers(self, name: str) -> tuple[int, int]:
        """Return (main, sub) for parameters 2 and 3 of MAV_CMD_DO_SET_MODE.

        Raises
        ------
        KeyError
            The autopilot has no such mode.
        """
        for numbers, known in self.modes.items():
            if known == name:
                return numbers
        raise KeyError(name)

    # ------------------------------------------------------------ stored items

    def normalised(self, item: Item) -> Item:
        """Return the item as the autopilot stores and returns it.

        Frames of MISSION_ITEM_INT and MISSION_ITEM are equivalent. A missing parameter is NaN or 0.
        `autocontinue` is not kept.
        """
        params = (item.param1, item.param2, item.param3, item.param4)
        param1, param2, param3, param4 = (0.0 if math.isnan(value) else value for value in params)
        frame = _SAME_FRAME.get(item.frame, item.frame)
        return self.stored(
            Item(item.command, frame, item.x, item.y, item.z_m, param1, param2, param3, param4, 1)
        )

    def difference(self, sent: Sequence[Item], held: Sequence[Item]) -> str:
        """Return the first difference between sent and stored items, without home; empty if equal."""
        return first_item_difference(sent, held, self.normalised, self.home_items)
