"""Keeping the journal of a service, and taking up from it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from rich.console import Console

from gcs.errors import JournalError
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
    Tick,
    UploadReport,
)
from gcs.service.journal import Journal
from gcs.service.service import Service

_EVERY_NS = 5 * NS_PER_S
_NEWS_NS = NS_PER_S // 2
_CLOSE_S = 5.0
_STALE_S = 900.0
"""An older journal is taken up only when `--resume` asks for it."""


def default_path(mission: str) -> Path:
    """Where the journal of a mission lies, beside the recordings."""
    return Path("runs") / f"{mission}.journal"


def take_up(service: Service, journal: Journal, resume: bool | None, now_ns: int, console: Console) -> None:
    """Give a service the memory of the one before, where there is one and it makes sense.

    Parameters
    ----------
    resume
        True: a journal must be there, however old; False: begin clean; None: take up from a fresh one.

    Raises
    ------
    JournalError
        With `resume`, when there is none that can be taken up.
    """
    if resume is False:
        return
    try:
        memory = journal.read()
    except JournalError as error:
        if resume:
            problem = f"{error.problem}; to begin clean, start with --no-resume"
            raise JournalError(error.path, problem) from None
        text = f"{error}; starting clean: nothing is known of the flight before"
        service.on_link_news("journal", "alarm", text)
        return
    if memory is None or memory.ended:
        if resume:
            problem = "there is none to resume from" if memory is None else "its mission has ended"
            raise JournalError(str(journal.path), problem)
        return
    age_s = (now_ns - memory.t_ns) / NS_PER_S
    if resume is None and not -_STALE_S < age_s < _STALE_S:
        console.print(
            f"[yellow]journal {journal.path} is {age_s / 60:.0f} minutes old: starting clean "
            "(--resume takes it up all the same)[/]",
            highlight=False,
            soft_wrap=True,
        )
        return
    service.resume(memory)
    console.print(
        f"taking up from {journal.path}, written {age_s:.0f} s ago (--no-resume: begin clean)",
        markup=False,
        soft_wrap=True,
    )


class JournalSink:
    """Writes the journal, on a thread of its own: at once for a new plan, and soon after other news."""

    def __init__(self, service: Service, journal: Journal) -> None:
        self._service, self._command, self._journal = service, service.command, journal
        self.writer = Writer("journal", 2, "alarm")
        self._outcome: JournalError | None = None
        """Of the last attempt to write."""
        self._written_t_ns: int | None = None
        self._news = False
        self._looked_t_ns = 0
        self._away: dict[int, str] = {}
        self._failed = False

    def event(self, event: Event) -> None:
        """Write when it is time to."""
        if not isinstance(event, Tick):
            return
        self._tell()
        if event.t_ns - self._looked_t_ns >= _NEWS_NS:
            self._looked_t_ns, before = event.t_ns, self._away
            self._away = self._command.untaskable()  # somebody else may have taken a vehicle
            self._news = self._news or self._away != before
        since_ns = event.t_ns - (self._written_t_ns or 0)
        if since_ns >= _EVERY_NS or (self._news and since_ns >= _NEWS_NS):
            self.write(event.t_ns)

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Note what must be remembered."""
        if isinstance(
            effect, Plan
        ):  # comes before the messages that carry it out: it need not be done by then,
            # for what is taken up counts only when the vehicle reads back the same
            self.write(t_ns)
        elif isinstance(effect, AgentStatus | UploadReport | OrderAnswer | Proposal | MissionEnded):
            self._news = True

    def write(self, t_ns: int) -> None:
        """Have written what is known now; a failure is told, the flight goes on, and it is tried again."""
        self._written_t_ns = t_ns
        data = self._journal.encode(self._command.memory(t_ns))
        self._news = not self.writer.put(partial(self._store, data))

    def close(self) -> None:
        """Wait until it is written, for 5 s at most, and tell how it went."""
        self.writer.drain(_CLOSE_S)
        self._tell()

    def _store(self, data: bytes) -> None:
        try:
            self._journal.store(data)
        except JournalError as error:
            self._outcome = error
        else:
            self._outcome = None

    def _tell(self) -> None:
        error = self._outcome
        if (error is not None) is self._failed:
            return
        self._failed = error is not None
        if error is not None:
            text = f"{error}: a restart would begin from older news"
            self._service.on_link_news("journal", "alarm", text)
        else:
            self._service.on_link_news("journal", "info", "is written again")
