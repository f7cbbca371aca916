"""What the operator should know about a plan: notices without a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from gcs.model import Label, Notice, NoticeCode, Parameter, target_name


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


def of_target(code: NoticeCode, label: Label) -> PlanNote:
    """Return a note about a target."""
    return PlanNote(code, None, {"target": target_name(label)})


def of_route(
    code: NoticeCode, vehicle: int, label: Label, parameters: Mapping[str, Parameter] = MappingProxyType({})
) -> PlanNote:
    """Return a note about the route of a vehicle to a target."""
    return PlanNote(code, vehicle, {"target": target_name(label), **parameters})
