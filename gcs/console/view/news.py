"""What a console asks of a run, and what it gets.

The console asks again and again, and names the last entry and the last capture that it has. So the run waits
for no console: a slow or stopped one asks later, and gets what is new since; one that has missed more than
the run keeps begins anew.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from gcs.console.view.capture import Capture
from gcs.console.view.page_records import MissionInfo, Work
from gcs.model import Effect, LaggedPicture, Order, Picture, Scan, VehicleState


class NewsRequest(msgspec.Struct, frozen=True):
    """What a console has of a run."""

    run: str = ""
    """Run that it knows; empty at first."""
    cursor: int = 0
    """Number of the last entry that it has."""
    capture: int = 0
    """Number of the last capture that it has."""
    is_watched: bool = False
    """True if a page is open, or a program has asked: only then the state is captured, and scans are kept."""
    is_urgent: bool = False
    """True if the state is wanted as it is now."""

    def after(self, news: News) -> NewsRequest:
        """Return the request for what comes after news that answer this one."""
        captured = news.capture.number if news.capture is not None else 0
        known = 0 if news.begins_anew else self.capture
        return msgspec.structs.replace(self, run=news.run, cursor=news.cursor, capture=captured or known)


@dataclass(frozen=True, slots=True)
class News:
    """What is new of a run, entries in the order in which they came."""

    run: str
    """Identity of the run; another one after a restart of the service, and where a replay begins again."""
    cursor: int
    """Number of the last entry."""
    begins_anew: bool
    """True if it is all that the run keeps: the console knew another run, or has missed something."""
    has_more: bool
    """True if there are more entries."""
    t_ns: int
    """Time of the newest tick; 0 before the first event."""
    start_t_ns: int | None
    """Start of the run; None before its first event."""
    begun_t_ns: int | None
    """Time of the first event since the run, or a replay, has begun (again)."""
    mission: MissionInfo | None
    """What does not change in a run; None unless it begins anew."""
    effects: list[tuple[int, Effect | Order]]
    scans: list[Scan]
    pictures: list[Picture]
    """The last one of each kind, if it is new."""
    lagged: list[LaggedPicture]
    passed: list[tuple[VehicleState, ...]]
    """States now and then, for trails."""
    work: list[tuple[int, Work, float]]
    """Computing times of steps with a scan and with a plan, in milliseconds."""
    capture: Capture | None
    """The last capture, if it is new."""
