"""What would have been different with other settings: two courses of one recording, side by side.

The recorded world does not react: vehicles report what they flew then, whatever another plan tells them now,
and transfers of missions that were never flown go unanswered. So the first plan that differs is exact; what
comes behind it says how the service would have judged the same flight.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import msgspec
from rich.table import Table

from gcs.config import Config
from gcs.io.recording.reader import Record
from gcs.model import NS_PER_S, AgentStatus, Effect, MissionEnded, Plan, UploadReport, target_name

_NOTHING: Final = "–"


@dataclass(slots=True)
class Outcome:
    """What central command decided, as far as an operator compares it."""

    plans: list[tuple[int, str]] = field(default_factory=list)
    """Time and routes of each plan."""
    retasked: int = 0
    """New routes given to vehicles."""
    uploads: int = 0
    failed_uploads: int = 0
    fates: dict[int, AgentStatus] = field(default_factory=dict)
    ended_t_ns: int | None = None

    def take(self, effect: Effect) -> None:
        """Follow an effect."""
        match effect:
            case Plan():
                routes = (
                    f"{r.vehicle} → {target_name(r.target)} ({r.length_m:.0f} m)" for r in effect.routes
                )
                self.plans.append((effect.t_ns, ", ".join(routes) or "nobody"))
                self.retasked += len(effect.changed)
            case UploadReport():
                self.uploads += effect.ok
                self.failed_uploads += not effect.ok
            case AgentStatus():
                self.fates[effect.vehicle] = effect
            case MissionEnded():
                self.ended_t_ns = effect.t_ns
            case _:
                pass


@dataclass(frozen=True, slots=True)
class Row:
    """One thing that was compared."""

    what: str
    recorded: str
    replayed: str

    @property
    def differs(self) -> bool:
        """Whether it came out differently."""
        return self.recorded != self.replayed


class Comparison:
    """Follows both courses."""

    def __init__(self) -> None:
        self.was, self.would_be = Outcome(), Outcome()
        self._judged = False

    def event(self, number: int, t_ns: int, effects: list[Effect], *, judged: bool) -> None:  # noqa: ARG002
        """Take what the fold made of an event."""
        self._judged = judged
        if judged:
            for effect in effects:
                self.would_be.take(effect)

    def recorded(self, record: Record, effect: Effect) -> None:  # noqa: ARG002
        """Take an effect that was recorded."""
        if self._judged:
            self.was.take(effect)

    def end(self, number: int, t_ns: int, *, broken_off: bool) -> None:
        """Nothing more is to come."""

    def rows(self, start_t_ns: int) -> list[Row]:
        """Both courses, thing by thing; times in seconds from `start_t_ns`."""
        was, would_be = self.was, self.would_be

        def at(t_ns: int) -> str:
            return f"{(t_ns - start_t_ns) / NS_PER_S:.1f} s"

        def plan(outcome: Outcome, index: int) -> str:
            if index >= len(outcome.plans):
                return _NOTHING
            t_ns, routes = outcome.plans[index]
            return f"at {at(t_ns)}: {routes}"

        def fate(outcome: Outcome, vehicle: int) -> str:
            found = outcome.fates.get(vehicle)
            if found is None:
                return "flying"
            target = f" at {target_name(found.target)}" if found.target is not None else ""
            return f"{found.fate}{target}, {at(found.t_ns)}"

        def end(outcome: Outcome) -> str:
            return _NOTHING if outcome.ended_t_ns is None else at(outcome.ended_t_ns)

        rows = [
            Row("plans", str(len(was.plans)), str(len(would_be.plans))),
            Row("new routes given", str(was.retasked), str(would_be.retasked)),
            Row("missions delivered", str(was.uploads), str(would_be.uploads)),
            Row("missions not delivered", str(was.failed_uploads), str(would_be.failed_uploads)),
        ]
        longest = max(len(was.plans), len(would_be.plans))
        first = next((i for i in range(longest) if plan(was, i) != plan(would_be, i)), None)
        if first is not None:
            rows.append(
                Row(f"plan {first + 1}, the first to differ", plan(was, first), plan(would_be, first))
            )
        rows += [
            Row(f"agent {vehicle}", fate(was, vehicle), fate(would_be, vehicle))
            for vehicle in sorted({*was.fates, *would_be.fates})
        ]
        return [*rows, Row("mission ended", end(was), end(would_be))]


def settings(recorded: Config, given: Config) -> list[Row]:
    """Keys that two mission files set differently; the simulated world's are left out: nothing reads them."""
    one, other = (_flat(msgspec.to_builtins(config), "") for config in (recorded, given))
    return [
        Row(key, one.get(key, _NOTHING), other.get(key, _NOTHING))
        for key in sorted({*one, *other})
        if one.get(key) != other.get(key) and not key.startswith("simulation")
    ]


def table(title: str, rows: list[Row]) -> Table:
    """Draw rows; those that differ stand out."""
    result = Table(title=title, title_justify="left")
    for name in ("", "recorded", "replayed"):
        result.add_column(name, overflow="fold")
    for row in rows:
        result.add_row(row.what, row.recorded, row.replayed, style="yellow" if row.differs else "")
    return result


def _flat(value: Any, key: str) -> dict[str, str]:
    if isinstance(value, dict):
        nested = [_flat(inner, f"{key}.{name}" if key else name) for name, inner in value.items()]
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        nested = [_flat(inner, f"{key}[{index}]") for index, inner in enumerate(value)]
    else:
        return {key: str(value)}
    return {name: text for part in nested for name, text in part.items()}
