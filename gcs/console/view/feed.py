"""Feed of the console: what it takes from a run, how often, and how much at a time.

The run must not wait for a browser, so the feed only keeps references, in bounded and numbered queues.
Consoles ask for what is new (`gcs.console.view.news`). Without a page no state is captured.
"""

from __future__ import annotations

import secrets
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import takewhile
from typing import Final, Generic, TypeVar

from gcs.console.view.capture import Capture
from gcs.console.view.news import News, NewsRequest
from gcs.console.view.page_records import MissionInfo, Work
from gcs.model import (
    NS_PER_S,
    Effect,
    Event,
    Kind,
    LaggedPicture,
    Order,
    Picture,
    Plan,
    Scan,
    Send,
    Tick,
    VehicleState,
)

T = TypeVar("T")

_CAPTURE_S: Final = 0.2
"""Minimum time between two captures of the state."""
_URGENT_S: Final = 0.05
"""The same for consoles that want it at once; those that ask at the same time get one capture."""
_WATCHED_S: Final = 2.0
"""Time for which scans are kept after a console with a page has asked."""
_MAX_EFFECTS: Final = 5000
_MAX_SCANS: Final = 100
_MAX_PASSED: Final = 100
_MAX_WORK: Final = 2000
_MAX_LAGGED: Final = 120
_MAX_EFFECTS_AT_ONCE: Final = 500
"""Effects of one answer; a console that asks late asks again for the rest."""
_MAX_DETECTIONS_AT_ONCE: Final = 50_000
_PASSED_NS: Final = 2 * NS_PER_S


class _Entries(Generic[T]):
    """The last entries of one kind, numbered."""

    def __init__(self, size: int) -> None:
        self._kept: deque[tuple[int, T]] = deque(maxlen=size)
        self.lost = 0
        """Number of the newest entry that is no longer kept."""

    def add(self, number: int, entry: T) -> None:
        """Add an entry; its number is higher than those before."""
        if len(self._kept) == self._kept.maxlen:
            self.lost = self._kept[0][0]
        self._kept.append((number, entry))

    def between(self, after: int, last: int) -> list[T]:
        """Return the entries with numbers above `after`, up to `last`."""
        return [entry for number, entry in self.numbered(after) if number <= last]

    def numbered(self, after: int) -> list[tuple[int, T]]:
        """Return the entries with numbers above `after`, and these."""
        found = list(takewhile(lambda one: one[0] > after, reversed(self._kept)))
        found.reverse()
        return found


class Feed:
    """Sink of events and effects.

    Parameters
    ----------
    mission : MissionInfo
        What does not change in the run.
    take : callable
        Returns a capture of the state at a time.
    states : callable
        Returns the vehicles' states now.
    start_t_ns : int, optional
        Start of the run; by default its first event.
    """

    def __init__(
        self,
        mission: MissionInfo,
        take: Callable[[int], Capture],
        states: Callable[[], tuple[VehicleState, ...]],
        start_t_ns: int | None = None,
    ) -> None:
        self.capture: Capture | None = None
        """The last one."""
        self._mission = mission
        self._take = take
        self._states = states
        self._start_t_ns = start_t_ns
        self._captures = 0
        self._taken_s = -_CAPTURE_S
        self._watched_s = -_WATCHED_S
        self._step_s = 0.0
        self._took_s = 0.0
        self.restart()

    def restart(self) -> None:
        """Forget everything: a replay begins again at another time."""
        self._run = secrets.token_hex(8)
        self._number = 0
        self._effects: _Entries[tuple[int, Effect | Order]] = _Entries(_MAX_EFFECTS)
        self._scans: _Entries[Scan] = _Entries(_MAX_SCANS)
        self._passed: _Entries[tuple[VehicleState, ...]] = _Entries(_MAX_PASSED)
        self._work: _Entries[tuple[int, Work, float]] = _Entries(_MAX_WORK)
        self._pictures: dict[Kind, tuple[int, Picture]] = {}
        self._lagged: _Entries[LaggedPicture] = _Entries(_MAX_LAGGED)
        self._begun_t_ns: int | None = None
        self._passed_t_ns = 0
        self._t_ns = self._start_t_ns or 0
        self.capture = None

    @property
    def t_ns(self) -> int:
        """Time of the newest tick; 0 before the first event."""
        return self._t_ns

    def event(self, event: Event) -> None:
        """Keep scans and orders, and at ticks the vehicles' states."""
        if self._begun_t_ns is None:
            self._begun_t_ns = self._t_ns = event.t_ns
            self._start_t_ns = event.t_ns if self._start_t_ns is None else self._start_t_ns
        if isinstance(event, Tick):
            self._t_ns = event.t_ns
            if event.t_ns - self._passed_t_ns >= _PASSED_NS:
                self._passed_t_ns = event.t_ns
                self._passed.add(self._next(), self._states())
        elif isinstance(event, Scan) and time.monotonic() - self._watched_s < _WATCHED_S:
            self._scans.add(self._next(), event)
        elif isinstance(event, Order):
            self._effects.add(self._next(), (event.t_ns, event))
        self._step_s = time.perf_counter()
        self._took_s = 0.0

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Keep an effect that a page shows."""
        if not self._took_s:  # the first effect of the step
            self._took_s = time.perf_counter() - self._step_s
        if isinstance(effect, Send):
            return
        if isinstance(effect, LaggedPicture):
            self._lagged.add(self._next(), effect)
        elif isinstance(effect, Picture):
            self._pictures[effect.kind] = (self._next(), effect)
            self._work.add(self._next(), (t_ns, "scan", 1e3 * self._took_s))
        else:
            if isinstance(effect, Plan):
                self._work.add(self._next(), (t_ns, "plan", 1e3 * self._took_s))
            self._effects.add(self._next(), (t_ns, effect))

    def pull(self, request: NewsRequest) -> News:
        """Return what is new for a console, at most so much that the run is not delayed."""
        begins_anew = request.run != self._run or request.cursor < self._effects.lost
        after = 0 if begins_anew else request.cursor
        effects = self._effects.numbered(after)
        last = self._number
        if len(effects) > _MAX_EFFECTS_AT_ONCE:
            effects = effects[:_MAX_EFFECTS_AT_ONCE]
            last = effects[-1][0]
        if request.is_watched:
            self._watched_s = time.monotonic()
            self._capture_if_due(is_urgent=request.is_urgent)
        captured = self.capture
        known = 0 if begins_anew else request.capture
        return News(
            run=self._run,
            cursor=last,
            begins_anew=begins_anew,
            has_more=last < self._number,
            t_ns=self._t_ns,
            start_t_ns=self._start_t_ns,
            begun_t_ns=self._begun_t_ns,
            mission=self._mission if begins_anew else None,
            effects=[entry for _, entry in effects],
            scans=list(_newest(self._scans.between(after, last)))[::-1],
            pictures=[picture for number, picture in self._pictures.values() if after < number <= last],
            lagged=self._lagged.between(after, last),
            passed=self._passed.between(after, last),
            work=self._work.between(after, last),
            capture=captured if request.is_watched and captured and captured.number > known else None,
        )

    def _capture_if_due(self, *, is_urgent: bool) -> None:
        """Capture the state now, unless the run has not begun, or a capture is new enough."""
        if not self._t_ns:
            return
        now_s = time.monotonic()
        last = self.capture
        is_old = last is None or (last.t_ns < self._t_ns and now_s - self._taken_s >= _CAPTURE_S)
        if is_old or (is_urgent and now_s - self._taken_s >= _URGENT_S):
            self._taken_s = now_s
            self._captures += 1
            self.capture = replace(self._take(self._t_ns), number=self._captures)

    def _next(self) -> int:
        self._number += 1
        return self._number


def _newest(scans: list[Scan]) -> Iterator[Scan]:
    """Yield the newest scans, the last one first, up to a number of detections."""
    detections = 0
    for scan in reversed(scans):
        detections += len(scan.z_m)
        if detections > _MAX_DETECTIONS_AT_ONCE:
            return
        yield scan
