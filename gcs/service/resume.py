"""Journal of a running service, and the start of a service from it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from rich.console import Console

from gcs.core.snapshot import decode_state, encode_state
from gcs.core.state import State
from gcs.errors import JournalError, WireError
from gcs.io.output import Writer
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Effect,
    Event,
    MissionEnded,
    OrderAnswer,
    Plan,
    Proposal,
    Snapshot,
    Tick,
    UploadReport,
)
from gcs.service.journal import Journal
from gcs.service.service import Service

_EVERY_NS = 5 * NS_PER_S
_CHANGED_NS = NS_PER_S // 2
_CLOSE_S = 5.0
_STALE_S = 900.0
"""An older journal is used with `--resume` only."""


def default_path(mission: str) -> Path:
    """Return the default path of a mission's journal, in the folder of the recordings."""
    return Path("runs") / f"{mission}.journal"


def resume_from_journal(
    service: Service, journal: Journal, resume: bool | None, now_ns: int, console: Console
) -> None:
    """Continue from the state of the service before, if there is a valid journal.

    Parameters
    ----------
    resume
        True: a journal of any age is required. False: no journal is used. None: a recent one is used.

    Raises
    ------
    JournalError
        With `resume`, when there is no usable journal.
    """
    if resume is False:
        return
    try:
        snapshot = journal.read()
        state = None if snapshot is None else _decode(journal, snapshot)
        if snapshot is None or state is None or state.has_ended:
            if resume:
                problem = "there is none to resume from" if state is None else "its mission has ended"
                raise JournalError(str(journal.path), problem)
            return
        age_s = (now_ns - snapshot.t_ns) / NS_PER_S
        if resume is None and not -_STALE_S < age_s < _STALE_S:
            console.print(
                f"[yellow]journal {journal.path} is {age_s / 60:.0f} minutes old and not used "
                "(start with --resume to use it)[/]",
                highlight=False,
                soft_wrap=True,
            )
            return
        _restore(service, journal, snapshot, state)
    except JournalError as error:
        if resume:
            problem = f"{error.problem}; to begin clean, start with --no-resume"
            raise JournalError(error.path, problem) from None
        text = f"{error}; the service starts without the state of the previous flight"
        service.on_link_news("journal", "alarm", text)
        return
    console.print(
        f"resuming from {journal.path}, written {age_s:.0f} s ago (start with --no-resume to ignore it)",
        markup=False,
        soft_wrap=True,
    )


def _decode(journal: Journal, snapshot: Snapshot) -> State:
    try:
        return decode_state(str(journal.path), snapshot.data)
    except WireError as error:
        raise JournalError(str(journal.path), error.problem) from None


def _restore(service: Service, journal: Journal, snapshot: Snapshot, state: State) -> None:
    try:
        service.resume(snapshot, state)
    except ValueError as error:
        raise JournalError(str(journal.path), f"makes no sense: {error}") from None


class JournalSink:
    """Writes the journal on its own thread: at once for a new plan, within 0.5 s for other changes."""

    def __init__(self, service: Service, journal: Journal) -> None:
        self._service, self._command, self._journal = service, service.command, journal
        self.writer = Writer("journal", 2, "alarm")
        self._error: JournalError | None = None
        """Error of the last attempt to write."""
        self._written_t_ns: int | None = None
        self._is_changed = False
        self._checked_t_ns = 0
        self._untaskable: dict[int, str] = {}
        self._failed = False

    def event(self, event: Event) -> None:
        """Write the journal when it is due."""
        if not isinstance(event, Tick):
            return
        self._report_change()
        if event.t_ns - self._checked_t_ns >= _CHANGED_NS:
            self._checked_t_ns, before = event.t_ns, self._untaskable
            self._untaskable = self._command.untaskable()  # a pilot may have changed a mode
            self._is_changed = self._is_changed or self._untaskable != before
        since_ns = event.t_ns - (self._written_t_ns or 0)
        if since_ns >= _EVERY_NS or (self._is_changed and since_ns >= _CHANGED_NS):
            self.write(event.t_ns)

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Note a change of the state."""
        if isinstance(effect, Plan):
            # Uploads of the plan may begin before it is written: a route counts after a restart only when the
            # vehicle reads back the same mission.
            self.write(t_ns)
        elif isinstance(effect, AgentStatus | UploadReport | OrderAnswer | Proposal | MissionEnded):
            self._is_changed = True

    def write(self, t_ns: int) -> None:
        """Queue the state for the writer; a failure becomes an alarm and is tried again."""
        self._written_t_ns = t_ns
        snapshot = Snapshot(t_ns, encode_state(self._command.state))
        self._is_changed = not self.writer.put(partial(self._store, snapshot))

    def close(self) -> None:
        """Wait at most 5 s until the journal is written, and report a failure."""
        self.writer.drain(_CLOSE_S)
        self._report_change()

    def _store(self, snapshot: Snapshot) -> None:
        try:
            self._journal.write(snapshot)
        except JournalError as error:
            self._error = error
        else:
            self._error = None

    def _report_change(self) -> None:
        error = self._error
        if (error is not None) is self._failed:
            return
        self._failed = error is not None
        if error is not None:
            text = f"{error}: a restart would begin from an older state"
            self._service.on_link_news("journal", "alarm", text)
        else:
            self._service.on_link_news("journal", "info", "is written again")
