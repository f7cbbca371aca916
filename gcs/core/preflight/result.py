"""A row of a pre-flight check's table.

"ok", "warning" (somebody should know) or "refused" (do not fly).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs.model import vehicle_name

Level: TypeAlias = Literal["ok", "warning", "refused"]


@dataclass(frozen=True, slots=True)
class Check:
    """One row of the table."""

    vehicle: int | None
    """None: about the mission."""
    name: str
    level: Level
    value: str
    wanted: str = ""
    remedy: str = ""
    """What to do, when it is not ok."""

    @property
    def whom(self) -> str:
        """Whom it is about, in a word."""
        return "mission" if self.vehicle is None else vehicle_name(self.vehicle)
