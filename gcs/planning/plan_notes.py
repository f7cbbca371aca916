"""What the operator should know about a plan: notices without a time."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from gcs.model import CONDITION, ConditionKey, Label, Notice, NoticeCode, Parameter, target_name


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
    def key(self) -> ConditionKey:
        """Identity of the condition."""
        return self.at(0).key

    @property
    def over(self) -> PlanNote:
        """Note that the condition has ended."""
        identity = {name: self.parameters[name] for name in self.code.by}
        return PlanNote(_OVER[self.code], self.vehicle, identity | {CONDITION: self.code.value})

    @property
    def line(self) -> str:
        """Text with the vehicle before it."""
        return self.at(0).line


_OVER: Final = {
    ended: code
    for code in (
        NoticeCode.LAYERS_SUFFICE,
        NoticeCode.ROUTE_REMARK_OVER,
        NoticeCode.AGENT_REMARK_OVER,
        NoticeCode.TARGET_REMARK_OVER,
        NoticeCode.PLAN_REMARK_OVER,
    )
    for ended in code.ended
}


def changes(before: Collection[PlanNote], after: Collection[PlanNote]) -> tuple[PlanNote, ...]:
    """Return what is new in the notes of a plan: first the ends of conditions, then conditions that begin."""
    held = {note.key for note in after}
    ended = {note.key: note.over for note in before if note.key not in held}
    return (*ended.values(), *(note for note in after if note not in before))


def of_target(code: NoticeCode, label: Label) -> PlanNote:
    """Return a note about a target."""
    return PlanNote(code, None, {"target": target_name(label)})


def of_route(
    code: NoticeCode, vehicle: int, label: Label, parameters: Mapping[str, Parameter] = MappingProxyType({})
) -> PlanNote:
    """Return a note about the route of a vehicle to a target."""
    return PlanNote(code, vehicle, {"target": target_name(label), **parameters})
