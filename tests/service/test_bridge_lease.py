"""A bridge that stood still leaves the lease to the command that had it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs.core.lease.lease_messages import NO_STANDING, Answer, Ask, NodeId
from gcs.io.cluster.bridge_messages import decode, encode
from gcs.io.links.manager import Links
from gcs.io.zenoh.session import ZenohSession
from gcs.model import NS_PER_S
from gcs.service import bridge as bridge_module
from gcs.service.bridge import Bridge


class Bus:
    """Nodes, which ask for the lease."""

    def __init__(self) -> None:
        self.on_ask: Callable[[str, bytes, Callable[[bytes], None]], None] = lambda *_: None

    def subscribe(self, _key: str, _callback: Callable[[str, bytes], None]) -> None: ...

    def publish(self, _key: str, _payload: bytes) -> None: ...

    def answer(self, _key: str, callback: Callable[[str, bytes, Callable[[bytes], None]], None]) -> None:
        self.on_ask = callback

    async def ask(self, name: str) -> Answer:
        answers: list[bytes] = []
        self.on_ask("lease", encode(Ask(NodeId(name, 1), 0, 0, NO_STANDING)), answers.append)
        while not answers:
            await asyncio.sleep(0.01)
        return decode("lease", answers[0], Answer)


def no_links() -> Links:
    nothing: Callable[..., dict[str, Any]] = lambda *_: {}  # noqa: E731
    names = ("start", "tick", "send", "ports", "unsent", "ground_stations", "counters", "close")
    methods = dict.fromkeys((*names, "signing_counters"), nothing)
    return cast(Links, SimpleNamespace(links=(), **methods))


def test_after_a_stop_the_command_renews_its_lease_before_a_standby_gets_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = SimpleNamespace(now_ns=NS_PER_S)
    monkeypatch.setattr(bridge_module, "steady_ns", lambda: clock.now_ns)

    async def run() -> None:
        bus = Bus()
        bridge = Bridge(no_links(), (), "m", "main", cast(ZenohSession, bus), 10.0)
        stop = asyncio.Event()
        serving = asyncio.create_task(bridge.run(stop))
        await asyncio.sleep(0.1)
        assert (await bus.ask("command")).permit is not None
        clock.now_ns += 4 * NS_PER_S
        assert (await bus.ask("standby")).permit is None
        assert (await bus.ask("command")).permit is not None
        for _ in range(4):  # command is gone, and the bridge runs
            clock.now_ns += NS_PER_S // 2
            await asyncio.sleep(0.1)
        assert (await bus.ask("standby")).permit is not None
        stop.set()
        await serving

    asyncio.run(run())


def test_a_standby_gets_an_answer_while_a_command_that_is_stopped_blocks_what_is_published() -> None:
    goes_on = threading.Event()

    class StoppedCommand(Bus):
        def publish(self, _key: str, _payload: bytes) -> None:
            goes_on.wait(20.0)

    async def run() -> None:
        bus = StoppedCommand()
        bridge = Bridge(no_links(), (), "m", "main", cast(ZenohSession, bus), 10.0)
        stop = asyncio.Event()
        serving = asyncio.create_task(bridge.run(stop))
        await asyncio.sleep(0.1)  # its status is being published
        assert (await asyncio.wait_for(bus.ask("standby"), 5.0)).permit is not None
        stop.set()
        await serving

    try:
        asyncio.run(run())
    finally:
        goes_on.set()
