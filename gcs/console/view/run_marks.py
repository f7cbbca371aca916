"""Marks of a run (losses, arrivals, plans, failed uploads, alarms, orders), which charts and replay show.

In a live run they come from the feed. Those of a recording are read from its file on a thread of their own,
so that they are known before the replay comes to them; pages show them as they are found.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from gcs.console.view.chart_data import BINS, ChartData
from gcs.console.view.page_records import Figures, Mark, MarkKind, Work
from gcs.errors import RecordingError, WireError
from gcs.io.recording.index import read_end_t_ns, read_indexed
from gcs.io.recording.reader import Record
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Effect,
    IntArray,
    MissionEnded,
    Notice,
    NoticeCode,
    Order,
    Picture,
    Plan,
    Proposal,
    Snapshot,
    Truth,
    UploadReport,
    vehicle_name,
)
from gcs.report.operator_lines import effect_notice, proposal_title
from gcs.report.plan_reminders import ProposalLog

MARKED: Final = (AgentStatus, MissionEnded, Notice, Order, Plan, Proposal, UploadReport)
"""Types of records with marks."""
SEVERE: Final = frozenset({"lost", "down", "upload", "alarm"})
"""Kinds of marks that are alarms."""
_MAX_MARKS: Final = 5000
_MAX_NAMED: Final = 6
_BURST_S: Final = 0.02
_ENCODED_S: Final = 1.0
"""Time for which all pages get the same charts."""


class History:
    """Marks and charts of a run, up to a maximum size; safe to use from several threads.

    Parameters
    ----------
    is_recorded : bool
        True if they are read from a recording; else they are added as they come.
    """

    def __init__(self, *, is_recorded: bool) -> None:
        self.is_recorded = is_recorded
        self._lock = threading.Lock()
        self.begin()

    def begin(self) -> None:
        """Begin without data: another run."""
        self.is_complete = False
        """True if all marks of a recording were read."""
        self._last_s = self._known_s = -math.inf
        self._marks: list[Mark] = []
        self._proposals = ProposalLog()
        self._tasked = set[int]()
        self._retasks_s = list[float]()
        self._failures_s = list[float]()
        """Times of re-tasks and of failed uploads."""
        with self._lock:
            self._charts = ChartData()
            self._has_charts = False
        self._encoded = b""
        self._encoded_s = -_ENCODED_S

    def restart(self) -> None:
        """Ignore the marks that are known: the replay begins again at its start."""
        self._known_s = self._last_s

    def add(self, t_s: float, record: Effect | Order) -> None:
        """Add the mark of a record, if it has one."""
        if t_s <= self._known_s:
            return
        self._last_s = max(self._last_s, t_s)
        if isinstance(record, Plan):
            if not self._tasked.isdisjoint(record.changed):
                self._retasks_s.append(t_s)
            self._tasked.update(route.vehicle for route in record.routes)
        elif isinstance(record, UploadReport) and not record.ok:
            self._failures_s.append(t_s)
        if isinstance(record, Proposal) and not self._proposals.add_if_due(record):
            return
        mark = mark_of(t_s, record)
        if mark is not None and len(self._marks) < _MAX_MARKS:
            self._marks.append(mark)

    def add_picture(self, t_s: float, picture: Picture) -> None:
        """Add the tracks after a scan to the charts."""
        with self._lock:
            self._charts.add_picture(t_s, picture)

    def add_telemetry(self, t_s: float, vehicles: Iterable[int], table: IntArray) -> None:
        """Add the counters of the links to the charts."""
        with self._lock:
            self._charts.add_telemetry(t_s, vehicles, table)

    def add_work(self, t_s: float, work: Work, took_ms: float) -> None:
        """Add a computing time to the charts."""
        with self._lock:
            self._charts.add_work(t_s, work, took_ms)

    def marks(self, after: int = 0) -> list[Mark]:
        """Return the marks, without the first `after`."""
        return self._marks[after:]

    def charts(self) -> bytes:
        """Return the charts as JSON; made once a second for all pages."""
        if time.monotonic() - self._encoded_s >= _ENCODED_S:
            with self._lock:
                built = self._charts.build(is_complete=self._has_charts)
            self._encoded = msgspec.json.encode(built)
            self._encoded_s = time.monotonic()
        return self._encoded

    def figures(self, at_s: float) -> Figures:
        """Return what runs are compared by, at a time."""
        is_known = self.is_complete or not self.is_recorded
        with self._lock:
            is_charted = self._has_charts or not self.is_recorded
            ospa_m = self._charts.ospa_m(at_s) if is_charted else {}
        return Figures(
            retasks=bisect_right(self._retasks_s, at_s) if is_known else None,
            failed_uploads=bisect_right(self._failures_s, at_s) if is_known else None,
            ospa_agents_m=ospa_m.get("agents"),
            ospa_targets_m=ospa_m.get("targets"),
        )

    def read(self, path: Path, vehicles: Sequence[int], start_t_ns: int, ends: threading.Event) -> None:
        """Add what a recording has, in short bursts, until `ends` is set; if not `is_recorded`, the truth."""
        with contextlib.suppress(RecordingError):  # the replay, which reads the same file, reports it
            if self.is_recorded:
                for record in _in_bursts(read_indexed(path, MARKED), ends):
                    self.add(_seconds(record, start_t_ns), record.value)  # type: ignore[arg-type]
                self.is_complete = not ends.is_set()
            duration_ns = (read_end_t_ns(path) or start_t_ns) - start_t_ns
            charted = (Picture, Snapshot, Truth) if self.is_recorded else (Truth,)
            for record in _in_bursts(read_indexed(path, charted, duration_ns // (2 * BINS)), ends):
                self._add_charted(_seconds(record, start_t_ns), record.value, vehicles)
        self.is_complete = self._has_charts = self.is_recorded

    def _add_charted(self, t_s: float, value: object, vehicles: Sequence[int]) -> None:
        from gcs.core.snapshot import decode_state  # loads the decision core, which a live run has elsewhere

        if isinstance(value, Picture):
            self.add_picture(t_s, value)
        elif isinstance(value, Truth):
            with self._lock:
                self._charts.add_truth(value)
        elif isinstance(value, Snapshot):
            with contextlib.suppress(WireError, ValueError):  # of another version
                self.add_telemetry(t_s, vehicles, decode_state("its snapshot", value.data).fleet.table)


def _in_bursts(records: Iterable[Record], ends: threading.Event) -> Iterator[Record]:
    """Yield records; pause between, so that other threads are not delayed."""
    paused_s = time.monotonic()
    for record in records:
        yield record
        if time.monotonic() - paused_s > _BURST_S:
            if ends.wait(_BURST_S):
                return
            paused_s = time.monotonic()


def _seconds(record: Record, start_t_ns: int) -> float:
    return (record.t_ns - start_t_ns) / NS_PER_S


def mark_of(t_s: float, record: Effect | Order) -> Mark | None:
    """Return the mark of a record; None for one without."""
    kind: MarkKind
    match record:
        case Order():
            return Mark(round(t_s, 2), "order", _order_text(record))
        case AgentStatus(status="lost"):
            kind = "lost"
        case AgentStatus(status="down"):
            kind = "down"
        case AgentStatus(status="arrived"):
            kind = "arrived"
        case Plan() if record.changed:
            kind = "plan"
        case Proposal() if record.routes:
            return Mark(round(t_s, 2), "plan", proposal_title(record), NoticeCode.PLAN_WAITS)
        case UploadReport(ok=False):
            kind = "upload"
        case Notice(level="alarm"):
            kind = "alarm"
        case MissionEnded():
            kind = "ended"
        case _:
            return None
    notice = effect_notice(record)
    return None if notice is None else Mark(round(t_s, 2), kind, notice.line, notice.code, notice.key)


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
