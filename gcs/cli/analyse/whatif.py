"""Comparison of a recording with its replay under other settings.

The recorded vehicles do not react to other plans. So the first plan that differs is exact; later ones are
decisions of the service for the recorded flight.
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
_MAX_SHOWN: Final = 200
"""Maximum length of a value; the content of a GeoJSON file or an elevation model is longer."""


@dataclass(slots=True)
class Outcome:
    """Decisions of central command."""

    plans: list[tuple[int, str]] = field(default_factory=list)
    """Time and routes of each plan."""
    retasked: int = 0
    """Number of new routes for vehicles."""
    uploads: int = 0
    failed_uploads: int = 0
    statuses: dict[int, AgentStatus] = field(default_factory=dict)
    ended_t_ns: int | None = None

    def add_effect(self, effect: Effect) -> None:
        """Count an effect."""
        match effect:
            case Plan():
                routes = (
                    f"{r.vehicle} → {target_name(r.target)} ({r.length_m:.0f} m)" for r in effect.routes
                )
                self.plans.append((effect.t_ns, ", ".join(routes) or "none"))
                self.retasked += len(effect.changed)
            case UploadReport():
                self.uploads += effect.ok
                self.failed_uploads += not effect.ok
            case AgentStatus():
                self.statuses[effect.vehicle] = effect
            case MissionEnded():
                self.ended_t_ns = effect.t_ns
            case _:
                pass


@dataclass(frozen=True, slots=True)
class Row:
    """One compared value."""

    what: str
    recorded: str
    replayed: str

    @property
    def differs(self) -> bool:
        """True if the values differ."""
        return self.recorded != self.replayed


class Comparison:
    """Collects the outcomes of the recording and of its replay."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget everything: the replay begins again at its start."""
        self.recorded_outcome = Outcome()
        self.replayed_outcome = Outcome()
        self._in_window = False

    def event(self, number: int, t_ns: int, effects: list[Effect], *, in_window: bool) -> None:  # noqa: ARG002
        """Add the effects of a replayed event."""
        self._in_window = in_window
        if in_window:
            for effect in effects:
                self.replayed_outcome.add_effect(effect)

    def recorded(self, record: Record, effect: Effect) -> None:  # noqa: ARG002
        """Add a recorded effect."""
        if self._in_window:
            self.recorded_outcome.add_effect(effect)

    def end(self, number: int, t_ns: int, *, broken_off: bool) -> None:
        """Do nothing: all effects are counted."""

    def rows(self, start_t_ns: int) -> list[Row]:
        """Return the compared values, with times in seconds from `start_t_ns`."""
        recorded = self.recorded_outcome
        replayed = self.replayed_outcome

        def at(t_ns: int) -> str:
            return f"{(t_ns - start_t_ns) / NS_PER_S:.1f} s"

        def plan(outcome: Outcome, index: int) -> str:
            if index >= len(outcome.plans):
                return _NOTHING
            t_ns, routes = outcome.plans[index]
            return f"at {at(t_ns)}: {routes}"

        def status(outcome: Outcome, vehicle: int) -> str:
            found = outcome.statuses.get(vehicle)
            if found is None:
                return "active"
            target = f" at {target_name(found.target)}" if found.target is not None else ""
            return f"{found.status}{target}, {at(found.t_ns)}"

        def end(outcome: Outcome) -> str:
            return _NOTHING if outcome.ended_t_ns is None else at(outcome.ended_t_ns)

        rows = [
            Row("plans", str(len(recorded.plans)), str(len(replayed.plans))),
            Row("new routes given", str(recorded.retasked), str(replayed.retasked)),
            Row("missions delivered", str(recorded.uploads), str(replayed.uploads)),
            Row("missions not delivered", str(recorded.failed_uploads), str(replayed.failed_uploads)),
        ]
        longest = max(len(recorded.plans), len(replayed.plans))
        first = next((i for i in range(longest) if plan(recorded, i) != plan(replayed, i)), None)
        if first is not None:
            rows.append(
                Row(f"plan {first + 1}, the first to differ", plan(recorded, first), plan(replayed, first))
            )
        rows += [
            Row(f"agent {vehicle}", status(recorded, vehicle), status(replayed, vehicle))
            for vehicle in sorted({*recorded.statuses, *replayed.statuses})
        ]
        return [*rows, Row("mission ended", end(recorded), end(replayed))]


def different_settings(recorded: Config, given: Config) -> list[Row]:
    """Return the keys that differ in two mission files, without those of the simulated world."""
    one, other = (_flat(msgspec.to_builtins(config), "") for config in (recorded, given))
    return [
        Row(key, _short(one.get(key, _NOTHING)), _short(other.get(key, _NOTHING)))
        for key in sorted({*one, *other})
        if one.get(key) != other.get(key) and not key.startswith("simulation")
    ]


def comparison_table(title: str, rows: list[Row]) -> Table:
    """Return a table of rows, with differences in yellow."""
    result = Table(title=title, title_justify="left")
    for name in ("", "recorded", "replayed"):
        result.add_column(name, overflow="fold")
    for row in rows:
        result.add_row(row.what, row.recorded, row.replayed, style="yellow" if row.differs else "")
    return result


def _short(value: str) -> str:
    return value if len(value) <= _MAX_SHOWN else f"{value[:_MAX_SHOWN]}..."


def _flat(value: Any, key: str) -> dict[str, str]:
    if isinstance(value, dict):
        nested = [_flat(inner, f"{key}.{name}" if key else name) for name, inner in value.items()]
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        nested = [_flat(inner, f"{key}[{index}]") for index, inner in enumerate(value)]
    else:
        return {key: str(value)}
    return {name: text for part in nested for name, text in part.items()}
