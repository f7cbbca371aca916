"""Feed of the console: a sink on the loop of the service.

The service must not wait for a browser, so the feed only keeps references, in bounded queues. The console's
thread takes them out. Without a page no state is captured.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Final

from gcs.console.capture import Capture
from gcs.model import NS_PER_S, Effect, Event, Kind, Picture, Scan, Send, Tick, Upload, VehicleState

CAPTURE_S: Final = 0.25
"""Minimum time between two captures of the state."""
_MAX_EFFECTS: Final = 5000
_MAX_SCANS: Final = 100
_MAX_PASSED: Final = 100
_PASSED_NS: Final = 2 * NS_PER_S


class Feed:
    """Sink of events and effects.

    Parameters
    ----------
    take : callable
        Returns a capture of the state at a time.
    states : callable
        Returns the vehicles' states now.

    Attributes
    ----------
    is_watched : bool
        True if a page is open; set by the console's thread.
    """

    def __init__(
        self, take: Callable[[int], Capture], states: Callable[[], tuple[VehicleState, ...]]
    ) -> None:
        self.is_watched = False
        self.capture: Capture | None = None
        self.effects: deque[tuple[int, Effect]] = deque(maxlen=_MAX_EFFECTS)
        self.scans: deque[Scan] = deque(maxlen=_MAX_SCANS)
        self.pictures: dict[Kind, Picture] = {}
        self.start_t_ns: int | None = None
        self.passed: deque[tuple[VehicleState, ...]] = deque(maxlen=_MAX_PASSED)
        """States now and then, for the trails of a page that opens later."""
        self._take, self._states = take, states
        self._passed_t_ns = 0
        self._t_ns = 0
        self._due_s = 0.0

    def event(self, event: Event) -> None:
        """Keep scans; capture the state at a tick, if it is due."""
        if isinstance(event, Tick):
            self._t_ns = event.t_ns
            if event.t_ns - self._passed_t_ns >= _PASSED_NS:
                self._passed_t_ns = event.t_ns
                self.passed.append(self._states())
            if self.is_watched and time.monotonic() >= self._due_s:
                self.refresh()
        elif isinstance(event, Scan) and self.is_watched:
            self.scans.append(event)
        if self.start_t_ns is None:
            self.start_t_ns = self._t_ns = event.t_ns

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Keep an effect that a page shows."""
        if isinstance(effect, Send | Upload):
            return
        if isinstance(effect, Picture):
            self.pictures[effect.kind] = effect
        else:
            self.effects.append((t_ns, effect))

    @property
    def is_stale(self) -> bool:
        """True if a capture is overdue: a replay has paused or ended, and no tick makes one."""
        is_old = self.capture is None or self.capture.t_ns < self._t_ns
        return is_old and time.monotonic() >= self._due_s + CAPTURE_S

    def refresh(self) -> None:
        """Capture the state now."""
        self._due_s = time.monotonic() + CAPTURE_S
        self.capture = self._take(self._t_ns)
