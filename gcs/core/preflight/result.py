"""Results of pre-flight checks: "ok", "warning", or "refused" (do not fly)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import msgspec

from gcs.model import vehicle_name

CheckLevel: TypeAlias = Literal["ok", "warning", "refused"]


@dataclass(frozen=True, slots=True)
class Check:
    """One row of the table."""

    vehicle: int | None
    """None: the mission."""
    name: str
    level: CheckLevel
    value: str
    wanted: str = ""
    remedy: str = ""
    """What to do, unless it is ok."""

    @property
    def subject(self) -> str:
        """Name of the vehicle, or "mission"."""
        return "mission" if self.vehicle is None else vehicle_name(self.vehicle)


class PreflightResult(msgspec.Struct, frozen=True):
    """Result of all checks, as `gcs preflight --json` prints it."""

    mission: str = ""
    ok: bool = False
    """True if nothing is refused."""
    refused: int = 0
    """Number of refused checks."""
    warnings: int = 0
    checks: tuple[Check, ...] = ()
