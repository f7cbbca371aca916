"""Publisher of the events of a service for its standby, and of the state on request."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Final

from gcs.core.snapshot import encode_state
from gcs.io.background_writer import BackgroundWriter
from gcs.io.cluster.bridge_messages import ClockTime
from gcs.io.cluster.event_log import MAX_EVENTS, EventBatch, StateCheck, StateReply, digest, encode, packed
from gcs.io.event_loop import on_loop
from gcs.io.zenoh.key_expressions import events_key, snapshot_key
from gcs.io.zenoh.session import ZenohSession
from gcs.model import NS_PER_S, Effect, Event, NoticeCode, NoticeContent, Tick
from gcs.service.service import Service

_MAX_UNSENT: Final = 200
_CHECK_NS: Final = NS_PER_S
"""Between two hashes of the state."""
_MIN_ANSWER_INTERVAL_S: Final = 0.5
"""The whole state is encoded for an answer."""
_END_S: Final = 1.0
_MISSING_S: Final = 20.0
"""Time without a standby until a warning; after a take-over the other node starts again in less."""


class EventPublisher:
    """Sink of a service.

    Parameters
    ----------
    service : Service
    bus : ZenohSession
        Session at which a standby connects.
    fingerprint : str
        Of the mission file and the seed (`gcs.service.journal.fingerprint`).
    """

    def __init__(self, service: Service, bus: ZenohSession, fingerprint: str) -> None:
        self.name = "standby"
        """Name in notices."""
        self.writer = BackgroundWriter(self.name, _MAX_UNSENT)
        self._service = service
        self._bus = bus
        self._fingerprint = fingerprint
        self._loop = asyncio.get_running_loop()
        self._answered_s = -_MIN_ANSWER_INTERVAL_S
        self._number = 0
        """Of the next event."""
        self._t_ns = 0
        self._is_followed = False
        self._is_due = bool(service.config.links.standby)
        """True if the mission has a standby."""
        self._is_told: bool | None = None
        """Whether a standby follows, as operators were told; None: not yet."""
        self._changed_s = monotonic()
        self._first = 0
        self._batch: list[tuple[int, bytes]] = []
        self._check: StateCheck | None = None
        self._checked_t_ns = 0
        bus.answer(snapshot_key(service.config.name), self._on_ask)

    def event(self, event: Event) -> None:
        """Keep an event for the next batch; send the batch at a tick."""
        if isinstance(event, Tick):
            self._flush()
            self._check_state(event)
        if self._is_followed:
            self._batch.append(packed(event))
            if len(self._batch) >= MAX_EVENTS:
                self._flush()
        self._number += 1
        self._t_ns = event.t_ns

    def effect(self, _t_ns: int, effect: Effect) -> None:
        """Ignore effects: a standby computes them itself."""

    def _check_state(self, tick: Tick) -> None:
        """Hash the state before a tick, once a second."""
        if self._is_followed and tick.t_ns - self._checked_t_ns >= _CHECK_NS:
            self._checked_t_ns = tick.t_ns
            self._check = StateCheck(self._number, digest(self._service.engine.state))

    def _flush(self, *, ends: bool = False) -> None:
        if self._batch or ends:
            batch = EventBatch(first=self._first, events=tuple(self._batch), check=self._check, ends=ends)
            key = events_key(self._service.config.name)
            self.writer.put(lambda: self._bus.publish(key, encode(batch)))
        self._batch = []
        self._check = None
        self._first = self._number
        is_followed = self._bus.is_subscribed(events_key(self._service.config.name))
        if is_followed is not self._is_followed:
            self._changed_s = monotonic()
        self._is_followed = is_followed

    def _on_ask(self, _key: str, _payload: bytes, reply: Callable[[bytes], None]) -> None:
        """Take a question for the state, on a thread of zenoh."""
        on_loop(self._loop, self._answer, reply)

    def _answer(self, reply: Callable[[bytes], None]) -> None:
        if monotonic() - self._answered_s < _MIN_ANSWER_INTERVAL_S:
            return  # a standby asks again
        self._answered_s = monotonic()
        answer = StateReply(
            fingerprint=self._fingerprint,
            number=self._number,
            t_ns=self._t_ns,
            clock=ClockTime.of(self._service.clock),
            state=encode_state(self._service.engine.state),
        )
        self.writer.put(partial(reply, encode(answer)))

    def notice(self) -> NoticeContent | None:
        """Return, once, the warning that no standby follows, and the news that one does."""
        if not self._is_due or self._is_followed is self._is_told:
            return None
        if not self._is_followed and monotonic() - self._changed_s < _MISSING_S:
            return None
        self._is_told = self._is_followed
        return (NoticeCode.STANDBY_FOLLOWS if self._is_followed else NoticeCode.STANDBY_MISSING), {}

    def close(self) -> None:
        """Tell a standby that command has ended in order."""
        if self._is_followed:
            self._flush(ends=True)
        self.writer.drain(_END_S)
