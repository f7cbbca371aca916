"""Marks of a run: losses, arrivals, plans, failed uploads, alarms and orders, with their times.

In a live run they come from the feed. Those of a recording are read from its file on a thread of their own,
so that they are known before the replay comes to them; pages show them as they are found.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Final, Literal, TypeAlias

import msgspec

from gcs.errors import RecordingError
from gcs.io.recording.reader import read_indexed
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Effect,
    MissionEnded,
    Notice,
    Order,
    Plan,
    Proposal,
    UploadReport,
    vehicle_name,
)
from gcs.report.operator_lines import ProposalLog, effect_line, proposal_title

MarkKind: TypeAlias = Literal["lost", "arrived", "plan", "upload", "alarm", "order", "ended"]
MARKED: Final = (AgentStatus, MissionEnded, Notice, Order, Plan, Proposal, UploadReport)
"""Types of records with marks."""
SEVERE: Final = frozenset({"lost", "upload", "alarm"})
"""Kinds of marks that are alarms."""
_MAX_MARKS: Final = 5000
_MAX_NAMED: Final = 6
_BURST_S: Final = 0.02


class Mark(msgspec.Struct, frozen=True):
    """One event of the run."""

    t_s: float
    """Since the start of the run."""
    kind: MarkKind
    text: str


class History:
    """Marks of a run, up to a maximum number; safe to use from several threads.

    Parameters
    ----------
    is_recorded : bool
        True if the marks are read from a recording.
    """

    def __init__(self, *, is_recorded: bool) -> None:
        self.is_recorded = is_recorded
        self.is_complete = False
        """True if all of a recording was read."""
        self._marks: list[Mark] = []
        self._proposals = ProposalLog()

    def add(self, t_s: float, record: Effect | Order) -> None:
        """Add the mark of a record, if it has one."""
        if isinstance(record, Proposal) and not self._proposals.add_if_due(record):
            return
        mark = mark_of(t_s, record)
        if mark is not None and len(self._marks) < _MAX_MARKS:
            self._marks.append(mark)

    def marks(self, after: int = 0) -> list[Mark]:
        """Return the marks, without the first `after`."""
        return self._marks[after:]

    def read(self, path: Path, start_t_ns: int, ends: threading.Event) -> None:
        """Add the marks of a recording, in short bursts, until `ends` is set."""
        paused_s = time.monotonic()
        try:
            for record in read_indexed(path, MARKED):
                self.add((record.t_ns - start_t_ns) / NS_PER_S, record.value)  # type: ignore[arg-type]
                if time.monotonic() - paused_s > _BURST_S:
                    if ends.wait(_BURST_S):
                        return
                    paused_s = time.monotonic()
        except RecordingError:
            pass  # the replay, which reads the same file, reports it
        self.is_complete = True


def mark_of(t_s: float, record: Effect | Order) -> Mark | None:
    """Return the mark of a record; None for one without."""
    kind: MarkKind
    match record:
        case Order():
            return Mark(round(t_s, 2), "order", _order_text(record))
        case AgentStatus(status="lost"):
            kind = "lost"
        case AgentStatus(status="arrived"):
            kind = "arrived"
        case Plan() if record.changed:
            kind = "plan"
        case Proposal() if record.routes:
            return Mark(round(t_s, 2), "plan", proposal_title(record))
        case UploadReport(ok=False):
            kind = "upload"
        case Notice(level="alarm"):
            kind = "alarm"
        case MissionEnded():
            kind = "ended"
        case _:
            return None
    line = effect_line(record)
    return None if line is None else Mark(round(t_s, 2), kind, line[0])


def _order_text(order: Order) -> str:
    if order.vehicles is None:
        vehicles = "all"
    else:
        vehicles = ", ".join(vehicle_name(vehicle) for vehicle in order.vehicles[:_MAX_NAMED])
        if len(order.vehicles) > _MAX_NAMED:
            vehicles += f" and {len(order.vehicles) - _MAX_NAMED} more"
    zone = "" if order.no_fly_zone is None else f" {order.no_fly_zone.name}"
    plan = "" if order.plan_id is None else f" plan {order.plan_id}"
    return f"order {order.action}{zone}{plan}: {vehicles}"
