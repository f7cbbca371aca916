"""When a standby asks for the lease: not while command is well and the bridge was only slow."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import cast

import pytest

from gcs.config import parse, read_text
from gcs.core.engine import Engine
from gcs.core.snapshot import encode_state
from gcs.io.cluster.bridge_messages import ClockTime
from gcs.io.cluster.event_log import EventBatch, StateReply, encode, packed
from gcs.io.zenoh.key_expressions import events_key
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import NS_PER_S, NoticeContent, Tick
from gcs.service.standby import Standby

CONFIG = parse(*read_text("deterministic"))
BATCH = encode(EventBatch(first=0))
LEASE_S = 1.5


class Bus:
    """Command: gives its state, and a batch of events when the test says so."""

    def __init__(self, way_s: float = 0.0, t_ns: int = 0) -> None:
        self.on_batch: Callable[[str, bytes], None] = lambda *_: None
        self._way_s = way_s
        self._t_ns = t_ns
        """Time that a message takes, and command's time when it is asked."""
        self.passed_s = 0.0
        """Time that the messages took."""

    def subscribe(self, _key: str, callback: Callable[[str, bytes], None]) -> Callable[[], None]:
        self.on_batch = callback
        return lambda: None

    def ask(
        self,
        key: str,
        _payload: bytes,
        _within_s: float,
        answered: Callable[[str, bytes], None],
        _ended: Callable[[], None],
    ) -> None:
        state = encode_state(Engine(CONFIG, 1).state)
        clock = ClockTime(self._t_ns + int(self._way_s * NS_PER_S), 1.0)
        reply = encode(StateReply(fingerprint="f", number=0, t_ns=self._t_ns, clock=clock, state=state))
        self.passed_s += 2.0 * self._way_s
        answered(key, reply)


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


class FreeBridge(Bridge):
    """A bridge whose lease is free from the beginning."""

    def may_command(self) -> bool:
        return True


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


class RealBus(Bus):
    """As `Bus`, with the subscriptions of a real session."""

    def __init__(self, session: ZenohSession) -> None:
        super().__init__()
        self._session = session

    def subscribe(self, key: str, callback: Callable[[str, bytes], None]) -> Callable[[], None]:
        return self._session.subscribe(key, callback)


def test_a_node_that_took_over_is_not_its_own_standby() -> None:
    """It told that a standby follows, and never warned that none does."""
    with ZenohSession(listen=free_endpoint()) as session:
        standby = Standby(CONFIG, 1, cast(ZenohSession, RealBus(session)), "f", lambda _: None)
        assert asyncio.run(standby.follow(FreeBridge(), asyncio.Event())) is not None
        assert not session.is_subscribed(events_key(CONFIG.name))


@pytest.mark.parametrize("way_s", [0.0, 0.8])
def test_the_clock_goes_on_however_long_the_state_was_on_its_way(
    way_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sensors' scans would come from the future, the more with each take-over, and vehicles get no tracks."""
    t_ns = 1_000 * NS_PER_S
    bus = Bus(way_s, t_ns)
    monkeypatch.setattr("gcs.service.standby.monotonic", lambda: bus.passed_s)
    standby = Standby(CONFIG, 1, cast(ZenohSession, bus), "f", lambda _: None)
    taken = asyncio.run(standby.follow(FreeBridge(), asyncio.Event()))
    assert taken is not None
    shown_s = (taken.clock.start_t_ns - t_ns) / NS_PER_S  # when the state came
    assert shown_s == pytest.approx(bus.passed_s)


def test_the_clock_is_not_behind_the_events_of_command() -> None:
    t_ns = time.time_ns() + 1_000 * NS_PER_S
    standby = Standby(CONFIG, 1, cast(ZenohSession, Bus()), "f", lambda _: None)
    standby._number = 0
    standby._apply(EventBatch(first=0, events=(packed(Tick(t_ns)),)))
    assert standby._take_over().clock.now_ns() >= t_ns
