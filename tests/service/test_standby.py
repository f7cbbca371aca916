"""When a standby asks for the lease: not while command is well and the bridge was only slow."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import cast

import pytest

from gcs.config import parse, read_text
from gcs.core.engine import Engine
from gcs.core.snapshot import encode_state
from gcs.io.cluster.bridge_messages import ClockTime
from gcs.io.cluster.event_log import EventBatch, StateReply, encode
from gcs.io.zenoh.session import ZenohSession
from gcs.model import NoticeContent
from gcs.service.standby import Standby

CONFIG = parse(*read_text("deterministic"))
BATCH = encode(EventBatch(first=0))
LEASE_S = 1.5


class Bus:
    """Command: gives its state, and a batch of events when the test says so."""

    def __init__(self) -> None:
        self.on_batch: Callable[[str, bytes], None] = lambda *_: None

    def subscribe(self, _key: str, callback: Callable[[str, bytes], None]) -> None:
        self.on_batch = callback

    def ask(
        self,
        key: str,
        _payload: bytes,
        _within_s: float,
        answered: Callable[[str, bytes], None],
        _ended: Callable[[], None],
    ) -> None:
        state = encode_state(Engine(CONFIG, 1).state)
        answered(
            key,
            encode(StateReply(fingerprint="f", number=0, t_ns=0, clock=ClockTime(0, 1.0), state=state)),
        )


class Bridge:
    """A bridge that is not steady: it stood still, or it starts."""

    def __init__(self) -> None:
        self.asks = 0
        self.starts = 0
        self.steady = False

    def ask_for_lease(self) -> None:
        self.asks += 1

    def may_command(self) -> bool:
        return False

    def is_steady(self) -> bool:
        return self.steady

    def supervise(self) -> NoticeContent | None:
        self.starts += 1
        return None


async def follow(bus: Bus, bridge: Bridge, seconds: float, *, hears_command: bool) -> None:
    standby = Standby(CONFIG, 1, cast(ZenohSession, bus), "f", lambda _: None)
    stop = asyncio.Event()
    following = asyncio.create_task(standby.follow(bridge, stop))
    for _ in range(int(seconds / 0.1)):
        await asyncio.sleep(0.1)
        if hears_command:
            bus.on_batch("events", BATCH)
    stop.set()
    assert await following is None


@pytest.mark.parametrize(("is_steady", "asks"), [(False, False), (True, True)])
def test_while_command_is_heard_only_a_steady_bridge_is_asked(is_steady: bool, asks: bool) -> None:
    bridge = Bridge()
    bridge.steady = is_steady
    asyncio.run(follow(Bus(), bridge, LEASE_S + 0.5, hears_command=True))
    assert (bridge.asks > 0) is asks
    assert bridge.starts == 0


def test_a_silent_command_is_replaced_and_its_bridge_looked_after() -> None:
    bridge = Bridge()
    asyncio.run(follow(Bus(), bridge, 2.0 * LEASE_S + 0.5, hears_command=False))
    assert bridge.asks > 0
    assert bridge.starts > 0
