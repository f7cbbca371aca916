"""Vertical limits of obstacles, no-fly zones and areas of the fence, and the altitude layers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias, get_args

LimitReference: TypeAlias = Literal["home", "msl", "ground"]
"""What the limits are above: home, mean sea level, or the ground below."""
_MAX_M: Final = 1e5
_REFERENCES: Final = '"home", "msl" or "ground"'


@dataclass(frozen=True, slots=True)
class VerticalLimits:
    """Floor and ceiling of an area; without both it reaches from the ground to the sky."""

    floor_m: float | None = None
    """None: down to the ground."""
    ceiling_m: float | None = None
    """None: up to the sky."""
    reference: LimitReference = "ground"

    @property
    def are_open(self) -> bool:
        """True if the area reaches from the ground to the sky."""
        return self.floor_m is None and self.ceiling_m is None

    @property
    def bounds_m(self) -> tuple[float, float]:
        """Floor and ceiling above the reference; infinite where there is none."""
        return (
            -math.inf if self.floor_m is None else self.floor_m,
            math.inf if self.ceiling_m is None else self.ceiling_m,
        )

    def above_level_ground(self, ground_msl_m: float) -> tuple[float, float]:
        """Return floor and ceiling above level ground, where home is on the ground."""
        floor_m, ceiling_m = self.bounds_m
        zero_m = ground_msl_m if self.reference == "msl" else 0.0
        return floor_m - zero_m, ceiling_m - zero_m


UNLIMITED: Final = VerticalLimits()


@dataclass(frozen=True, slots=True)
class LayerHeights:
    """Heights of the altitude layers over level ground.

    An area that ends more than the vertical clearance below the lowest layer, or begins that far above the
    highest, blocks no layer. Over terrain there are no layers: the flight band passes over or under areas.
    """

    lowest_m: float
    """Least height above the ground that routes are flown at: climbs and descents are lower."""
    highest_m: float
    """Minus infinity: there are no layers."""
    ground_msl_m: float
    clearance_m: float
    """Vertical clearance."""

    def meet(self, limits: VerticalLimits) -> bool:
        """Return True if a vehicle in a layer comes nearer to an area than the clearance."""
        floor_m, ceiling_m = limits.above_level_ground(self.ground_msl_m)
        return floor_m < self.highest_m + self.clearance_m and ceiling_m > self.lowest_m - self.clearance_m

    def lie_above(self, limits: VerticalLimits) -> bool:
        """Return True if climbs and descents may come too near to an area that the layers do not meet."""
        floor_m, ceiling_m = limits.above_level_ground(self.ground_msl_m)
        is_low = floor_m < self.lowest_m + self.clearance_m and ceiling_m > -self.clearance_m
        return is_low and not self.meet(limits)


def vertical_limits(
    height_m: object = None, floor_m: object = None, ceiling_m: object = None, reference: object = None
) -> VerticalLimits:
    """Return the limits that the keys of these names give; keys that are None are not there.

    Raises
    ------
    ValueError
        With the key, and what was expected.
    """
    keys = {"height_m": height_m, "floor_m": floor_m, "ceiling_m": ceiling_m}
    given = {name: _number(name, value) for name, value in keys.items() if value is not None}
    if "height_m" in given:
        if len(given) > 1:
            raise ValueError("height_m: expected either height_m, or floor_m and ceiling_m")
        if reference not in (None, "ground"):
            raise ValueError(f'height_m: is above the ground; reference = "{reference}" contradicts it')
        if given["height_m"] <= 0.0:
            raise ValueError(
                f"height_m: expected metres above the ground, above 0, not {given['height_m']:g}"
            )
        return VerticalLimits(None, given["height_m"])
    if not given:
        if reference is not None:
            raise ValueError("reference: there is no floor_m or ceiling_m")
        return UNLIMITED
    if reference is None:
        raise ValueError(f"reference: is missing; floor_m and ceiling_m are above {_REFERENCES}")
    if reference not in get_args(LimitReference):
        raise ValueError(f"reference: expected {_REFERENCES}, not {reference!r}")
    limits = VerticalLimits(given.get("floor_m"), given.get("ceiling_m"), reference)  # type: ignore[arg-type]
    floor, ceiling = limits.bounds_m
    if floor >= ceiling:
        raise ValueError(f"ceiling_m: {ceiling:g} m is not above floor_m, {floor:g} m")
    if reference == "ground" and ceiling <= 0.0:
        raise ValueError(f"ceiling_m: {ceiling:g} m is not above the ground")
    if reference == "ground" and limits.floor_m is not None and limits.floor_m < 0.0:
        raise ValueError(f"floor_m: {floor:g} m is below the ground; leave it out to begin on the ground")
    return limits


def limits_text(limits: VerticalLimits) -> str:
    """Return limits in words, such as "0-60 m above ground"; empty if they are open."""
    if limits.are_open:
        return ""
    above = {"home": "above home", "msl": "MSL", "ground": "above ground"}[limits.reference]
    if limits.ceiling_m is None:
        return f"from {limits.floor_m:g} m {above}"
    if limits.floor_m is None:
        return f"up to {limits.ceiling_m:g} m {above}"
    return f"{limits.floor_m:g} to {limits.ceiling_m:g} m {above}"


def _number(name: str, value: object) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not abs(value) <= _MAX_M:  # type: ignore[arg-type]
        raise ValueError(f"{name}: expected metres, not {value!r:.40}")
    return float(value)  # type: ignore[arg-type]
