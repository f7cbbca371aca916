"""Result of the preflight checks: findings, and the rows that show them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec

from gcs.core.preflight.check_codes import CheckCode, CheckLevel
from gcs.model import Parameter, vehicle_name
from gcs.model.templates import fill, plain_value


@dataclass(frozen=True, slots=True)
class Check:
    """Finding of a check: code and parameters."""

    vehicle: int | None
    """None: the mission."""
    code: CheckCode
    parameters: Mapping[str, Parameter] = field(default_factory=dict)

    @property
    def level(self) -> CheckLevel:
        """Level of its code."""
        return self.code.level

    @property
    def name(self) -> str:
        """Name of the check, or of the parameter that it is about."""
        return fill(self.code.check, self.parameters)

    @property
    def row(self) -> CheckRow:
        """Finding in words, with printable characters only."""
        values = {name: _json_value(value) for name, value in self.parameters.items()}
        return CheckRow(
            self.vehicle,
            self.code.value,
            self.name,
            self.level,
            fill(self.code.found, values),
            fill(self.code.wanted, values),
            fill(self.code.remedy, {"vehicle": self.vehicle, **values}),
            values,
        )


def _json_value(value: Parameter) -> Parameter:
    """Return a value with printable characters only; a float that JSON lacks, such as NaN, as its text."""
    plain = plain_value(value)
    return str(plain) if isinstance(plain, float) and not math.isfinite(plain) else plain


class CheckRow(msgspec.Struct, frozen=True):
    """Finding of a check in words: a row of the table."""

    vehicle: int | None
    """None: the mission."""
    code: str
    """Stable identity of the finding."""
    name: str
    level: CheckLevel
    value: str
    wanted: str = ""
    remedy: str = ""
    """What to do, unless it is ok."""
    parameters: dict[str, Parameter] = {}
    """Parameters of the code."""

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
    checks: tuple[CheckRow, ...] = ()
