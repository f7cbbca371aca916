"""The real world of a simulation: central command never sees it, the judge does."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.model.basics import Kind


@dataclass(frozen=True, slots=True)
class TruthObject:
    """One real object of a simulated world."""

    kind: Kind
    id: int
    """System id of an agent, index of a target."""
    east_m: float
    north_m: float
    alive: bool


@dataclass(frozen=True, slots=True)
class Truth:
    """The simulated world at the moment of one scan. Central command never sees it; the judge does."""

    t_ns: int
    objects: tuple[TruthObject, ...] = field(default_factory=tuple)
