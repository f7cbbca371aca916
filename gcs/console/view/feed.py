"""Feed of the console: a sink on the loop of the service.

The service must not wait for a browser, so the feed only keeps references, in bounded queues. The console's
thread takes them out. Without a page no state is captured.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gcs.console.view.capture import Capture
from gcs.console.view.schema import Work
from gcs.model import (
    NS_PER_S,
    Effect,
    Event,
    Kind,
    Order,
    Picture,
    Plan,
    Scan,
    Send,
    Tick,
    VehicleState,
)

CAPTURE_S: Final = 0.25
"""Minimum time between two captures of the state."""
_MAX_EFFECTS: Final = 5000
_MAX_SCANS: Final = 100
_MAX_PASSED: Final = 100
_MAX_WORK: Final = 2000
_PASSED_NS: Final = 2 * NS_PER_S


@dataclass(slots=True)
class News:
    """What the feed has kept since the run began, or since a replay began again at another time."""

    capture: Capture | None = None
    effects: deque[tuple[int, Effect | Order]] = field(default_factory=lambda: deque(maxlen=_MAX_EFFECTS))
    scans: deque[Scan] = field(default_factory=lambda: deque(maxlen=_MAX_SCANS))
    pictures: dict[Kind, Picture] = field(default_factory=dict)
    passed: deque[tuple[VehicleState, ...]] = field(default_factory=lambda: deque(maxlen=_MAX_PASSED))
    """States now and then, for the trails of a page that opens later."""
    work: deque[tuple[int, Work, float]] = field(default_factory=lambda: deque(maxlen=_MAX_WORK))
    """Computing times of steps with a scan and with a plan, in milliseconds."""
    begun_t_ns: int | None = None
    """Time of the first event; None before it."""


class Feed:
    """Sink of events and effects.

    Parameters
    ----------
    take : callable
        Returns a capture of the state at a time.
    states : callable
        Returns the vehicles' states now.
    start_t_ns : int, optional
        Start of the run; by default its first event.

    Attributes
    ----------
    is_watched : bool
        True if a page is open; set by the console's thread.
    t_ns : int
        Time of the newest tick; 0 before the first event.
    """

    def __init__(
        self,
        take: Callable[[int], Capture],
        states: Callable[[], tuple[VehicleState, ...]],
        start_t_ns: int | None = None,
    ) -> None:
        self.is_watched = False
        self.start_t_ns = start_t_ns
        self.news = News()
        self._take = take
        self._states = states
        self._passed_t_ns = 0
        self.t_ns = start_t_ns or 0
        self._due_s = 0.0
        self._step_s = 0.0
        self._took_s = 0.0

    def restart(self) -> None:
        """Forget everything: a replay begins again at another time."""
        self.news = News()
        self._passed_t_ns = 0
        self.t_ns = self.start_t_ns or 0
        self._due_s = 0.0

    def event(self, event: Event) -> None:
        """Keep scans and orders; capture the state at a tick, if it is due."""
        if isinstance(event, Tick):
            self.t_ns = event.t_ns
            if event.t_ns - self._passed_t_ns >= _PASSED_NS:
                self._passed_t_ns = event.t_ns
                self.news.passed.append(self._states())
            if self.is_watched and time.monotonic() >= self._due_s:
                self.refresh()
        elif isinstance(event, Scan) and self.is_watched:
            self.news.scans.append(event)
        elif isinstance(event, Order):
            self.news.effects.append((event.t_ns, event))
        if self.start_t_ns is None:
            self.start_t_ns = event.t_ns
        if self.news.begun_t_ns is None:
            self.news.begun_t_ns = self.t_ns = event.t_ns
        self._step_s = time.perf_counter()
        self._took_s = 0.0

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Keep an effect that a page shows."""
        if not self._took_s:  # the first effect of the step
            self._took_s = time.perf_counter() - self._step_s
        if isinstance(effect, Send):
            return
        if isinstance(effect, Picture):
            self.news.pictures[effect.kind] = effect
            self.news.work.append((t_ns, "scan", 1e3 * self._took_s))
        else:
            if isinstance(effect, Plan):
                self.news.work.append((t_ns, "plan", 1e3 * self._took_s))
            self.news.effects.append((t_ns, effect))

    @property
    def capture(self) -> Capture | None:
        """The last capture."""
        return self.news.capture

    @property
    def is_stale(self) -> bool:
        """True if a capture is overdue: a replay has paused or ended, and no tick makes one."""
        is_old = self.capture is None or self.capture.t_ns < self.t_ns
        return is_old and time.monotonic() >= self._due_s + CAPTURE_S

    def refresh(self) -> None:
        """Capture the state now, unless the run has not begun."""
        if not self.t_ns:
            return
        self._due_s = time.monotonic() + CAPTURE_S
        self.news.capture = self._take(self.t_ns)
