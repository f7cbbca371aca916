"""Losses of separation of a run, from the notices of the separation monitor."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

from gcs.model import Notice, NoticeCode

_MOST: Final = 1000
_PLACE: Final = ("distance_m", "height_m", "east_m", "north_m")


@dataclass(frozen=True, slots=True)
class SeparationLoss:
    """Interval in which two vehicles were too near to each other."""

    vehicles: tuple[int, int]
    begin_t_ns: int
    distance_m: float
    """Least horizontal distance."""
    height_m: float
    """Difference in height there."""
    place_m: tuple[float, float]
    """East and north of the place between both where it began."""
    end_t_ns: int | None = None
    """Time at which they were well apart again; None until then."""


@dataclass(slots=True)
class SeparationLosses:
    """Collects the losses of separation of a run, at most `_MOST`."""

    ended: list[SeparationLoss] = field(default_factory=list)
    going_on: dict[tuple[int, int], SeparationLoss] = field(default_factory=dict)

    def add(self, notice: Notice) -> None:
        """Add a notice; others than those of losses are ignored."""
        other = notice.parameters.get("other")
        if notice.vehicle is None or not isinstance(other, int):
            return
        pair = (notice.vehicle, other)
        if notice.code is NoticeCode.SEPARATION_LOST and len(self.ended) + len(self.going_on) < _MOST:
            distance_m, height_m, east_m, north_m = (_number(notice, name, 0.0) for name in _PLACE)
            loss = SeparationLoss(pair, notice.t_ns, distance_m, height_m, (east_m, north_m))
            self.going_on.setdefault(pair, loss)
        elif notice.code is NoticeCode.APART_AGAIN and pair in self.going_on:
            loss = self.going_on.pop(pair)
            nearest_m = _number(notice, "nearest_m", loss.distance_m)
            height_m = _number(notice, "nearest_height_m", loss.height_m)
            self.ended.append(replace(loss, distance_m=nearest_m, height_m=height_m, end_t_ns=notice.t_ns))

    def build(self) -> tuple[SeparationLoss, ...]:
        """Return all losses in the order of their begins."""
        return tuple(
            sorted([*self.ended, *self.going_on.values()], key=lambda loss: (loss.begin_t_ns, loss.vehicles))
        )


def _number(notice: Notice, name: str, default: float) -> float:
    value = notice.parameters.get(name)
    return float(value) if isinstance(value, int | float) else default
