"""Notices to operators: code, subject and parameters. The words of each code: `gcs.model.notice_codes`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, TypeAlias

from gcs.model.basics import Level
from gcs.model.notice_codes import NoticeCode
from gcs.model.templates import Parameter, fill, plain_value
from gcs.model.vehicle_ids import vehicle_name
from gcs.safe_text import printable

Subject: TypeAlias = int | str | None
"""Number of a vehicle; name of a sensor, link or output; None: the mission. Its code says which."""
ConditionKey: TypeAlias = str
"""Identity of a condition: code, subject, and the parameters that belong to it, in one text."""

NoticeContent: TypeAlias = tuple[NoticeCode, Mapping[str, Parameter]]
"""Code and parameters of a notice whose subject is known."""


class Notify(Protocol):
    """Receives the code and the parameters of a notice; time and subject are known."""

    def __call__(self, code: NoticeCode, /, **parameters: Parameter) -> None:
        """Add the notice."""


CONDITION: Final = "condition"
"""Parameter of a notice that ends one of the conditions of its code: the code of that one."""
MORE_COUNT: Final = "more_count"
MORE_S: Final = "more_s"
"""Parameters of a summary: number of further notices of the same condition, and in how many seconds."""


@dataclass(frozen=True, slots=True)
class Notice:
    """Notice for the operator.

    Texts among the parameters have printable characters only, whatever a vehicle or ground station sent.
    """

    t_ns: int
    code: NoticeCode
    subject: Subject = None
    parameters: Mapping[str, Parameter] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Make texts from outside safe to show."""
        if isinstance(self.subject, str):
            object.__setattr__(self, "subject", printable(self.subject))
        plain = {name: plain_value(value) for name, value in self.parameters.items()}
        object.__setattr__(self, "parameters", plain)

    @property
    def level(self) -> Level:
        """Level of its code."""
        return self.code.level

    @property
    def vehicle(self) -> int | None:
        """Vehicle that it is about; None if it is about something else."""
        return self.subject if isinstance(self.subject, int) else None

    @property
    def text(self) -> str:
        """Text without the subject."""
        return _text(self.code, self.subject, self.parameters)

    @property
    def line(self) -> str:
        """Text with the subject before it."""
        match self.code.about:
            case "vehicle" if isinstance(self.subject, int):
                return f"agent {vehicle_name(self.subject)}: {self.text}"
            case "sensor":
                return f"sensor {self.subject}: {self.text}"
            case "link":
                return f"{self.subject}: {self.text}"
        return self.text

    @property
    def key(self) -> ConditionKey:
        """Identity of the condition that it tells of."""
        return self._key_of(self.code)

    @property
    def ended(self) -> tuple[ConditionKey, ...]:
        """Conditions that it ends: those of its code, or only the one that it names."""
        named = self.parameters.get(CONDITION)
        return tuple(self._key_of(code) for code in self.code.ended if named in (None, code))

    def _key_of(self, code: NoticeCode) -> ConditionKey:
        values = (self.subject, *(self.parameters.get(name) for name in code.by))
        return " ".join((code.value, *("" if value is None else str(value) for value in values)))


def _text(code: NoticeCode, subject: Subject, parameters: Mapping[str, Parameter]) -> str:
    """Return the text of a notice; its optional parts only with their parameters."""
    values: dict[str, Any] = dict(parameters)
    if isinstance(subject, int):
        values.setdefault("vehicle", vehicle_name(subject))
    text = fill(code.text, values)
    if MORE_COUNT in values:
        text += f" ({values[MORE_COUNT]} more such notices in {values[MORE_S]:.0f} s)"
    return text
