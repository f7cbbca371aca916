"""Standby: a second engine that applies the events of command, and commands when command is gone.

It asks command for its state, and applies the events after it. Once a second it compares a hash of its state
with that of command. When the lease of the bridge runs out, and the standby has the state, it asks for the
lease; with it, it continues as a service that resumes (`gcs.core.restart`).
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import monotonic
from typing import Final, Protocol

from gcs.config import Config
from gcs.core.engine import Engine
from gcs.core.lease.lease_messages import TIMES
from gcs.core.snapshot import decode_state, encode_state
from gcs.core.state import State
from gcs.errors import LinkError, WireError
from gcs.io.clock import RunClock
from gcs.io.cluster.event_log import (
    EventBatch,
    StateCheck,
    StateReply,
    decode_batch,
    decode_reply,
    digest,
    unpacked,
)
from gcs.io.event_loop import on_loop
from gcs.io.zenoh.key_expressions import events_key, snapshot_key
from gcs.io.zenoh.session import ZenohSession
from gcs.mavlink.frames.codec import FrameTable
from gcs.model import NS_PER_S, NoticeCode, NoticeContent, Parameter, Snapshot

_TICK_S: Final = 0.05
_MAX_BATCHES: Final = 2_000
"""Batches that wait for the state; a command sends twenty a second."""
_ASK_EVERY_S: Final = 1.0
_ANSWER_S: Final = 5.0
_LEASE_S: Final = TIMES.lease_ns / NS_PER_S
_SILENT_S: Final = 3.0
"""Time without events after which a standby looks after the bridge: command is stopped or gone."""


class Lease(Protocol):
    """What a standby needs of the links in bridges."""

    def ask_for_lease(self) -> None:
        """Ask for the lease when it has run out."""

    def may_command(self) -> bool:
        """Return True if this node has the lease."""

    def is_steady(self) -> bool:
        """Return True if the bridge is heard, and was for a lease without a silence."""

    def supervise(self) -> NoticeContent | None:
        """Start a bridge on this machine again that has ended; return an alarm of its end."""


class IgnoredLinks:
    """Takes nothing of the links: a standby gets the datagrams that command has consumed."""

    clock = RunClock()

    def now_ns(self) -> int:
        """Return the run time now."""
        return self.clock.now_ns()

    def on_datagram(self, link: str, peer: str, frames: FrameTable) -> None:
        """Ignore a datagram."""

    def on_notice(self, subject: str, code: NoticeCode, /, **parameters: Parameter) -> None:
        """Ignore a notice."""


@dataclass(frozen=True, slots=True)
class TakeOver:
    """Where a standby continues."""

    snapshot: Snapshot
    state: State
    clock: RunClock
    is_newest: bool
    """False if the state was not in step with that of command."""


class Standby:
    """A standby of one mission.

    Parameters
    ----------
    config : Config
        The mission, equal to that of command.
    seed : int
        Seed of the map's random obstacles.
    bus : ZenohSession
        Session that reaches command.
    fingerprint : str
        Of the mission file and the seed (`gcs.service.journal.fingerprint`).
    tell : callable
        Shows a line to the operator.
    """

    def __init__(
        self, config: Config, seed: int, bus: ZenohSession, fingerprint: str, tell: Callable[[str], None]
    ) -> None:
        self.engine = Engine(config, seed)
        self._bus = bus
        self._mission = config.name
        self._fingerprint = fingerprint
        self._tell = tell
        self._has_state = False
        self._number: int | None = None
        """Of the next event; None while the state is not that of command."""
        self._t_ns = 0
        self._clock = RunClock()
        self._batches: deque[EventBatch] = deque(maxlen=_MAX_BATCHES)
        self._reply: tuple[StateReply, RunClock] | None = None
        self._asked_s = -_ASK_EVERY_S
        self._heard_s = monotonic()
        self._has_ended = False
        self._problem = ""

    async def follow(self, lease: Lease, stop: asyncio.Event) -> TakeOver | None:
        """Follow command until it is gone; return None when `stop` is set or command has ended in order.

        Raises
        ------
        LinkError
            If command flies another mission file.
        """
        loop = asyncio.get_running_loop()

        def on_batch(key: str, payload: bytes) -> None:
            with contextlib.suppress(WireError):
                on_loop(loop, self._take_batch, decode_batch(key, payload))

        end = self._bus.subscribe(events_key(self._mission), on_batch)
        try:
            return await self._until_gone(lease, stop)
        finally:
            end()  # a node that commands would take itself for its standby

    async def _until_gone(self, lease: Lease, stop: asyncio.Event) -> TakeOver | None:
        while not stop.is_set() and not self._has_ended:
            self._take_state()
            while self._batches and self._number is not None:
                self._apply(self._batches.popleft())
                await asyncio.sleep(0.0)  # a slow batch does not delay the lease
            if self._has_state:
                self._look_after_bridge(lease)
                if self._silent_s() > _LEASE_S or lease.is_steady():
                    lease.ask_for_lease()
                if lease.may_command():
                    return self._take_over()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), _TICK_S)
        return None

    def _silent_s(self) -> float:
        """Return the time since command was heard.

        While it is heard, it is to get a bridge that stood still or starts: the standby waits for some time.
        """
        return monotonic() - self._heard_s

    def _look_after_bridge(self, lease: Lease) -> None:
        """Start the bridge again when that and command have ended: without it there is no lease."""
        if self._silent_s() > _SILENT_S and lease.supervise() is not None:
            self._say("command is silent and the bridge has ended; it is started again")

    def _take_batch(self, batch: EventBatch) -> None:
        self._heard_s = monotonic()
        self._batches.append(batch)
        self._has_ended = self._has_ended or batch.ends

    def _take_over(self) -> TakeOver:
        state = self.engine.state
        snapshot = Snapshot(self._t_ns, encode_state(state))
        return TakeOver(snapshot, state, self._clock, is_newest=self._number is not None)

    # ------------------------------------------------------------ state

    def _take_state(self) -> None:
        """Ask for the state while there is none; begin with the one that has come."""
        reply = self._reply
        self._reply = None
        if self._number is None and reply is not None:
            self._begin(*reply)
        if self._number is None and monotonic() - self._asked_s >= _ASK_EVERY_S:
            self._asked_s = monotonic()
            on_reply = partial(self._on_reply, self._asked_s)
            self._bus.ask(snapshot_key(self._mission), b"", _ANSWER_S, on_reply, lambda: None)

    def _on_reply(self, asked_s: float, key: str, payload: bytes) -> None:
        """Keep the state and command's clock, on a thread of zenoh; both ways took equal times."""
        answered_s = 0.5 * (asked_s + monotonic())
        with contextlib.suppress(WireError):
            reply = decode_reply(key, payload)
            self._reply = reply, reply.clock.clock(monotonic() - answered_s)

    def _begin(self, reply: StateReply, clock: RunClock) -> None:
        if reply.fingerprint != self._fingerprint:
            raise LinkError(
                "standby", "command flies another mission file, or another seed; use the same here"
            )
        try:
            self.engine.state = decode_state("command", reply.state)
        except (WireError, ValueError) as error:
            self._say(f"the state of command cannot be used: {error}")
            return
        self._has_state = True
        self._number = reply.number
        self._t_ns = reply.t_ns
        self._clock = clock
        self._say("has the state of command and follows it")

    def _lose(self, why: str) -> None:
        """Ask for the state again. If command is gone, the standby continues with the one that it has."""
        self._number = None
        self._say(f"{why}; it asks for the state again")

    def _apply(self, batch: EventBatch) -> None:
        """Apply the events that are new."""
        if self._number is None or batch.first + len(batch.events) <= self._number:
            return
        if batch.first > self._number:
            self._lose(f"{batch.first - self._number} events of command are missing")
            return
        for kind, data in batch.events[self._number - batch.first :]:
            if self._differs(batch.check):
                self._lose("the state differs from that of command")
                return
            try:
                event = unpacked(kind, data)
            except WireError as error:
                self._lose(str(error))
                return
            try:
                self.engine.step(event)
            except Exception as error:  # as in `Service`, which then goes on without the state
                self._lose(f"the state makes no sense ({error!r})")
                return
            self._number += 1
            self._t_ns = event.t_ns
            self._clock = self._clock.not_before(event.t_ns)

    def _differs(self, check: StateCheck | None) -> bool:
        """Return True if the state is not that of command before the same event."""
        is_here = check is not None and check.number == self._number
        return is_here and check is not None and check.digest != digest(self.engine.state)

    def _say(self, text: str) -> None:
        """Tell the operator, unless it was said last."""
        if text != self._problem:
            self._problem = text
            self._tell(text)
