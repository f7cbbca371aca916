"""Resume of a service from the journal of the one before, if that is not too old."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from gcs.core.snapshot import decode_state
from gcs.core.state import State
from gcs.errors import JournalError, WireError
from gcs.io.recording.folder import RUNS_FOLDER
from gcs.model import NS_PER_S, NoticeCode, Snapshot
from gcs.service.journal import Journal
from gcs.service.service import Service

_STALE_S = 900.0
"""An older journal is used with `--resume` only."""


def default_path(mission: str) -> Path:
    """Return the default path of a mission's journal, in the folder of the recordings."""
    return RUNS_FOLDER / f"{mission}.journal"


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
            if snapshot is not None and abs(now_ns - snapshot.t_ns) < _STALE_S * NS_PER_S:
                console.print(
                    f"the mission in {journal.path} has ended: a new one begins, with new tasks",
                    markup=False,
                    soft_wrap=True,
                )
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
        service.on_notice("journal", NoticeCode.JOURNAL_REFUSED, problem=str(error))
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
