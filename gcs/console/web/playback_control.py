"""Control of a replay by its pages: play, pause, speed, position."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Protocol

import msgspec
from msgspec import Meta

from gcs.console.view.page_records import ReplayState
from gcs.model.rounding import rounded


class Playback(Protocol):
    """How a replay is played (`gcs.service.replay`)."""

    speed: float
    is_paused: bool
    duration_s: float | None
    has_ended: bool
    has_snapshots: bool
    is_seeking: bool

    @property
    def shown_s(self) -> float:
        """Time that is asked for or reached."""

    def refusal(self, at_s: float) -> str:
        """Return why a time cannot be shown; an empty text if it can."""

    def seek(self, at_s: float) -> None:
        """Go to a time that is not refused."""


class PlaybackRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request of a page; None leaves a value as it is."""

    paused: bool | None = None
    speed: Annotated[float, Meta(gt=0.0, le=1000.0)] | None = None
    at_s: Annotated[float, Meta(ge=0.0)] | None = None


class PlaybackDesk:
    """Passes requests of pages on to a replay.

    Parameters
    ----------
    playback : Playback or None
        None: the run is live.
    call : callable
        Runs a function on the loop of the replay.
    """

    def __init__(self, playback: Playback | None, call: Callable[[Callable[[], None]], object]) -> None:
        self._playback = playback
        self._call = call
        self.is_moved = False
        """True after a request for another time, until that time is shown."""
        self.peer: PlaybackDesk | None = None
        """Of the other recording of a comparison: a request is for both."""

    def state(self) -> ReplayState | None:
        """Return position and speed; None for a live run."""
        playback = self._playback
        if playback is None:
            return None
        return ReplayState(
            paused=playback.is_paused,
            ended=playback.has_ended,
            speed=rounded(playback.speed, 2),
            at_s=round(playback.shown_s, 1),
            back=playback.has_snapshots,
            duration_s=rounded(playback.duration_s),
        )

    @property
    def is_seeking(self) -> bool:
        """True until a replay has reached the time that was asked for."""
        return self._playback is not None and self._playback.is_seeking

    def carry_out(self, body: bytes) -> str:
        """Carry out a request; return why not, or an empty text."""
        desks = [desk for desk in (self, self.peer) if desk is not None]
        playbacks = [desk._playback for desk in desks if desk._playback is not None]
        if not playbacks:
            return "this run is live"
        try:
            request = msgspec.json.decode(body, type=PlaybackRequest)
        except msgspec.DecodeError as error:
            return str(error)
        if request.at_s is not None:
            if refusal := next(filter(None, (one.refusal(request.at_s) for one in playbacks)), ""):
                return refusal
            for one in playbacks:
                one.seek(request.at_s)
            for desk in desks:
                desk.is_moved = True

        def apply() -> None:
            for one in playbacks:
                one.is_paused = one.is_paused if request.paused is None else request.paused
                one.speed = request.speed or one.speed

        self._call(apply)
        return ""
