"""What obstructs a take-off: codes, parameters, and the words of each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from gcs.model import Parameter
from gcs.model.code_table import Entry, TableCode
from gcs.model.templates import fill

_BLOCKED: Final = "within {min_clearance_m:.0f} m of an obstacle, a no-fly zone or the fence"
_WHERE: Final = ", {distance_m:.0f} m from where it stands, at ({east_m:.0f}, {north_m:.0f}) m"


def _entry(
    code: str,
    problem: str,
    remedy: str = "lower takeoff.altitude_rel_m, or take off from elsewhere or in another direction",
) -> Entry:
    return code, {"problem": problem, "remedy": remedy}


class ObstructionCode(TableCode):
    """Identity of an obstruction."""

    problem: str
    """Template of the problem (`gcs.model.templates`)."""
    remedy: str

    CLIMB_BLOCKED = _entry("climb-blocked", "the climb comes " + _BLOCKED + _WHERE)
    NEAR_GROUND = _entry(
        "near-ground", "the climb comes within {agl_m:.0f} m of the ground" + _WHERE,
        "take off from elsewhere or in another direction",
    )  # fmt: skip
    OUTSIDE_MAP = _entry("outside-map", "the climb leaves the map" + _WHERE)
    TURN_BLOCKED = _entry("turn-blocked", "the first turn comes " + _BLOCKED + _WHERE)
    TURN_MAY_BE_BLOCKED = _entry("turn-may-be-blocked", "the first turn may come " + _BLOCKED + _WHERE)
    NOT_ALONG_RUNWAY = _entry(
        "not-along-runway",
        "its nose points to {nose_deg:.0f} degrees, takeoff.heading_deg is {heading_deg:.0f}",
        "turn it along the runway, or correct the key",
    )


class Obstruction(NamedTuple):
    """What obstructs a take-off, and where."""

    code: ObstructionCode
    parameters: Mapping[str, Parameter]

    @property
    def problem(self) -> str:
        """Problem in words."""
        return fill(self.code.problem, self.parameters)

    def __str__(self) -> str:
        """Return problem and remedy in one text."""
        return f"{self.problem}; {self.code.remedy}"
