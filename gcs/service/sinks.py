"""What the service gives its events and effects to: the recorder, sinks, and outputs that may fail."""

from __future__ import annotations

from typing import Protocol

from gcs.io.recording.disk_space import DiskSpace
from gcs.model import (
    Effect,
    Event,
    NoticeContent,
    Snapshot,
    Truth,
)


class Recording(Protocol):
    """Recorder of events and effects; every method may raise `RecordingError`."""

    @property
    def space(self) -> DiskSpace | None:
        """Space of the recording; None if it is not known."""

    def record_event(self, event: Event) -> None:
        """Record an event before the engine gets it."""

    def record_effect(self, t_ns: int, effect: Effect, payload: bytes = b"") -> None:
        """Record an effect of the engine; `payload` is its JSON if it is known."""

    def record_truth(self, truth: Truth) -> None:
        """Record the ground truth of a simulated world."""

    def record_snapshot(self, snapshot: Snapshot) -> None:
        """Record the state before the next event."""


class Sink(Protocol):
    """Receiver of all events and effects, in order."""

    def event(self, event: Event) -> None:
        """Receive an event before the engine gets it."""

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Receive an effect."""


class Output(Protocol):
    """Output whose failure becomes a notice."""

    name: str

    def notice(self) -> NoticeContent | None:
        """Return the next notice, if any."""
