"""What the operator should know about a plan: notices without a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs.model import Notice, NoticeCode, Parameter


@dataclass(frozen=True, slots=True)
class PlanNote:
    """Code, vehicle and parameters of a notice about a plan."""

    code: NoticeCode
    vehicle: int | None = None
    parameters: Mapping[str, Parameter] = field(default_factory=dict)

    def at(self, t_ns: int) -> Notice:
        """Return the notice, as of a time."""
        return Notice(t_ns, self.code, self.vehicle, self.parameters)

    @property
    def line(self) -> str:
        """Text with the vehicle before it."""
        return self.at(0).line
