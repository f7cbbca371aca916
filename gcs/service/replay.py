"""Replay: recorded events through a new engine, as fast as possible or at a speed; moved back and forth.

Events enter in their recorded order and effects go to the sinks. Nothing is sent. Recorded effects are only
compared with those of the replay. A replay that begins with a snapshot continues from its state.
"""

from __future__ import annotations

import asyncio
import itertools
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Protocol

from gcs.config import Config
from gcs.core.engine import Engine
from gcs.core.snapshot import decode_state
from gcs.core.state import State
from gcs.errors import RecordingError, WireError
from gcs.io.record_json import encode
from gcs.io.recording.reader import Damage, Record
from gcs.io.recording.topics import topic_of
from gcs.model import NS_PER_S, Effect, Event, LaggedPicture, Notice, NoticeCode, Snapshot, Truth
from gcs.report.run.verification import Output, Verification
from gcs.service.sinks import Sink

_YIELD_S = 0.02
_NAP_S = 0.1
_NEAR_S = 20.0
"""Later times within this are reached by processing all events until then."""
_AHEAD_S = 0.2
"""Of two replays that are compared, one is ahead of the other by this time at most."""
_PEER_NAP_S = 0.002


@dataclass(frozen=True, slots=True)
class Window:
    """Part of a recording to show and verify, in seconds from its start. Earlier events are processed too."""

    from_s: float = 0.0
    to_s: float = math.inf


class Watcher(Protocol):
    """Compares replayed effects with recorded ones."""

    def event(self, number: int, t_ns: int, effects: list[Effect], *, in_window: bool) -> None:
        """Add the effects of an event; `in_window`: True if they are compared."""

    def recorded(self, record: Record, effect: Effect) -> None:
        """Add a recorded effect."""

    def end(self, number: int, t_ns: int, *, broken_off: bool) -> None:
        """End the comparison, at the end of the recording or of the window."""


@dataclass(slots=True)
class Playback:
    """How a replay is played; it may be changed while the replay runs, on its loop."""

    speed: float = math.inf
    """Multiple of real time."""
    is_paused: bool = False
    at_s: float = 0.0
    """Seconds from the start of the recording."""
    duration_s: float | None = None
    """None if it is not known."""
    fast_until_s: float = 0.0
    """What comes before this time is processed at full speed."""
    stays_at_end: bool = False
    """True if the last state stays on display until the replay is stopped."""
    has_ended: bool = False
    has_snapshots: bool = False
    """True if the replay may begin again at any time."""
    restart_s: float | None = None
    """Time at which the replay is to begin again; None: it goes on."""
    is_seeking: bool = False
    """True until the time that was asked for is reached."""
    next_s: float = 0.0
    """Time of the event that is processed next."""
    peer: Playback | None = field(default=None, repr=False, compare=False)
    """Playback of the other recording of a comparison: both show the same time."""

    @property
    def shown_s(self) -> float:
        """Time that is asked for or reached, in seconds from the start of the recording."""
        return self.fast_until_s if self.is_seeking else self.at_s

    @property
    def is_ahead(self) -> bool:
        """True if the other recording of a comparison must be played first."""
        peer = self.peer
        if peer is None:
            return False
        return peer.is_seeking or (not peer.has_ended and peer.next_s < self.next_s - _AHEAD_S)

    def refusal(self, at_s: float) -> str:
        """Return why a time cannot be shown; an empty text if it can."""
        if self.has_snapshots or at_s >= self.at_s:
            return ""
        return "this replay goes forward only: start it again to see earlier times"

    def seek(self, at_s: float) -> None:
        """Go to another time that is not refused; at the end, later times change nothing."""
        if self.has_ended and self.at_s <= at_s and self.restart_s is None:
            return
        is_near = self.at_s <= at_s < self.at_s + _NEAR_S and self.restart_s is None
        restarts = self.has_snapshots and not is_near
        self.fast_until_s = at_s
        if restarts:
            self.restart_s = at_s
        self.is_seeking = restarts or not self.has_ended


class Replay:
    """Replay of one recording.

    Parameters
    ----------
    config, seed
        Mission and seed of the recording.
    records
        Records in the order of the engine's events; a `Damage` ends them.
    window
        Part to show.
    start_t_ns
        Start of the run; by default the time of the first event.
    records_from
        Returns the records from the last snapshot before a time on, or from the first one: to go back.
    """

    def __init__(
        self,
        config: Config,
        seed: int,
        records: Iterable[Record],
        window: Window,
        start_t_ns: int | None = None,
        records_from: Callable[[int], Iterable[Record]] | None = None,
    ) -> None:
        self.config = config
        self.engine = Engine(config, seed)
        self.sinks: list[Sink] = []
        self.playback = Playback(fast_until_s=window.from_s, has_snapshots=records_from is not None)
        self.on_restart: list[Callable[[], None]] = []
        """Called when the replay begins again at another time: what sinks have gathered is out of date."""
        self.links = None
        """A replay has no links."""
        self.watchers: list[Watcher] = []
        self.damage: Damage | None = None
        self.events = 0
        self.effects = 0
        self.start_t_ns = start_t_ns
        self.begin_t_ns = 0
        """Time of the first processed event."""
        self.t_ns = 0
        self._records = records
        self._records_from = records_from
        self._window = window

    @property
    def duration_s(self) -> float:
        """Replayed run time in seconds."""
        return 0.0 if self.start_t_ns is None else (self.t_ns - self.start_t_ns) / NS_PER_S

    async def run(self, stop: asyncio.Event, speed: float) -> None:
        """Play to the end of the window, of the recording, or until `stop` is set."""
        playback = self.playback
        records = self._records
        playback.speed = speed
        while True:
            number = await self._play(records, stop)
            playback.has_ended = playback.restart_s is None
            playback.is_seeking = not playback.has_ended
            while playback.stays_at_end and playback.restart_s is None and not stop.is_set():
                await asyncio.sleep(_NAP_S)
            if playback.restart_s is None or stop.is_set():
                break
            at_s = playback.restart_s
            playback.restart_s = None
            records = self._records_at(at_s)
        broken_off = self.damage is not None or stop.is_set()
        for watcher in self.watchers:
            watcher.end(number, self.t_ns, broken_off=broken_off)

    def _records_at(self, at_s: float) -> Iterable[Record]:
        """Return the records from the last snapshot before a time on; sinks begin again."""
        assert self._records_from is not None
        assert self.start_t_ns is not None
        records = iter(self._records_from(self.start_t_ns + round(at_s * NS_PER_S)))
        first = next(records)
        if not isinstance(first.value, Snapshot):
            self.engine.state = State.initial(agent.vehicle for agent in self.config.agents)
        self.events = 0
        self.damage = None
        self._window = replace(self._window, from_s=0.0)
        self.playback.at_s = at_s
        self.playback.has_ended = False
        for notify in self.on_restart:
            notify()
        return itertools.chain([first], records)

    async def _play(self, records: Iterable[Record], stop: asyncio.Event) -> int:
        """Play until the end, `stop`, or a restart; return the number of the last record."""
        pace = _Pace(self.playback)
        number = 0
        for record in records:
            if stop.is_set() or self.playback.restart_s is not None:
                break
            value = record.value
            number = record.sequence
            if isinstance(value, Damage):
                self.damage = value
                break
            if isinstance(value, Event):
                if self.start_t_ns is None:
                    self.start_t_ns = value.t_ns
                if not self.events:
                    self.begin_t_ns = self.t_ns = value.t_ns
                at_s = (value.t_ns - self.start_t_ns) / NS_PER_S
                if at_s > self._window.to_s:
                    break
                await pace.until(at_s, stop)
                if self.playback.restart_s is not None:
                    break
                self._event(number, value, shown=at_s >= self._window.from_s)
            elif isinstance(value, Snapshot):
                if not self.events:
                    self._restore(value)
            elif not isinstance(value, Truth):
                self._recorded(record, value)
        return number

    def _restore(self, snapshot: Snapshot) -> None:
        try:
            self.engine.state = decode_state("its snapshot", snapshot.data)
        except (WireError, ValueError) as error:
            problem = f"has a snapshot that cannot be used: {error}; replay it from its start"
            raise RecordingError("the recording", problem) from None

    def _event(self, number: int, event: Event, *, shown: bool) -> None:
        for sink in self.sinks:
            sink.event(event)
        effects = self.engine.step(event)
        self.t_ns = max(self.t_ns, event.t_ns)
        self.events += 1
        self.effects += len(effects)
        for watcher in self.watchers:
            watcher.event(number, event.t_ns, effects, in_window=shown)
        if shown:
            for effect in effects:
                for sink in self.sinks:
                    sink.effect(event.t_ns, effect)

    def _recorded(self, record: Record, effect: Effect) -> None:
        if isinstance(effect, Notice) and effect.code is NoticeCode.SERVICE_SLOW:
            return  # a notice of the service, not of the engine
        for watcher in self.watchers:
            watcher.recorded(record, effect)


class Verifier:
    """Compares effects byte for byte, in their recorded form.

    Lagged pictures are not compared: the scans before a snapshot, which they need, are not in it.
    """

    def __init__(self) -> None:
        self.result = Verification()

    def event(self, number: int, t_ns: int, effects: list[Effect], *, in_window: bool) -> None:
        """Add the effects of an event."""
        compared = [effect for effect in effects if not isinstance(effect, LaggedPicture)]
        outputs = [Output(topic_of(effect), encode(effect)) for effect in compared] if in_window else None
        self.result.event(number, t_ns, outputs)

    def recorded(self, record: Record, effect: Effect) -> None:
        """Add a recorded effect."""
        if not isinstance(effect, LaggedPicture):
            self.result.recorded(record.sequence, record.t_ns, Output(topic_of(effect), record.payload))

    def end(self, number: int, t_ns: int, *, broken_off: bool) -> None:
        """End the comparison."""
        self.result.end(number, t_ns, broken_off=broken_off)


class _Pace:
    """Waits between events; the views are drawn and Ctrl-C is handled during waits."""

    def __init__(self, playback: Playback) -> None:
        self._playback = playback
        self._anchor: tuple[float, float, float] | None = None
        """Speed, and a time of the recording that was due at a monotonic time; None after a jump."""
        self._yielded_s = time.monotonic()

    async def until(self, at_s: float, stop: asyncio.Event) -> None:
        """Wait until `at_s` of the run is due."""
        playback = self._playback
        playback.next_s = at_s
        while not stop.is_set() and playback.restart_s is None and (left_s := self._left_s(at_s)) > 0.0:
            await asyncio.sleep(min(left_s, _NAP_S))
            self._yielded_s = time.monotonic()
        playback.at_s = at_s
        if time.monotonic() - self._yielded_s > _YIELD_S:
            await asyncio.sleep(0)
            self._yielded_s = time.monotonic()

    def _left_s(self, at_s: float) -> float:
        """Return the time until `at_s` is due, as far as is known now."""
        playback = self._playback
        now_s = time.monotonic()
        if at_s < playback.fast_until_s:
            self._anchor = None
            return 0.0
        playback.is_seeking = playback.restart_s is not None
        if playback.is_paused or playback.is_ahead:
            self._anchor = None
            return _NAP_S if playback.is_paused else _PEER_NAP_S
        if not math.isfinite(playback.speed):
            return 0.0
        if self._anchor is None or self._anchor[0] != playback.speed:
            self._anchor = (playback.speed, max(playback.at_s, playback.fast_until_s), now_s)
        speed, from_s, began_s = self._anchor
        return began_s + (at_s - from_s) / speed - now_s
