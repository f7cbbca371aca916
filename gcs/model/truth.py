"""Ground truth of a simulation, for the evaluator only."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.model.basics import Kind


@dataclass(frozen=True, slots=True)
class TruthObject:
    """True position of one simulated object."""

    kind: Kind
    id: int
    """System id of an agent, index of a target."""
    east_m: float
    north_m: float
    alive: bool
    down: bool = False
    """True of an agent that came down elsewhere than by a landing of its mission."""
    alt_msl_m: float | None = None
    """None if the simulation has no heights."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Ground truth at the time of one scan."""

    t_ns: int
    objects: tuple[TruthObject, ...] = field(default_factory=tuple)
    late: tuple[int, ...] = ()
    """Agents whose simulation was behind the clock since the last scan: the machine is too slow."""
