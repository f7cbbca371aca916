"""Result of one pre-flight check: "ok", "warning", or "refused" (do not fly)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs.model import vehicle_name

Level: TypeAlias = Literal["ok", "warning", "refused"]


@dataclass(frozen=True, slots=True)
class Check:
    """One row of the table."""

    vehicle: int | None
    """None: the mission."""
    name: str
    level: Level
    value: str
    wanted: str = ""
    remedy: str = ""
    """What to do, unless it is ok."""

    @property
    def subject(self) -> str:
        """Name of the vehicle, or "mission"."""
        return "mission" if self.vehicle is None else vehicle_name(self.vehicle)
