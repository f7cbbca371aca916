"""What a bridge leaves to the command that had the lease, and tells the one that gets it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs.core.lease.lease_messages import NO_STANDING, Answer, Ask, NodeId
from gcs.io.cluster.bridge_messages import Down, Up, decode, encode
from gcs.io.links.manager import Links
from gcs.io.zenoh.session import ZenohSession
from gcs.model import NS_PER_S, NoticeCode
from gcs.service import bridge as bridge_module
from gcs.service.bridge import Bridge


class Bus:
    """Nodes, which ask for the lease."""

    def __init__(self) -> None:
        self.on_ask: Callable[[str, bytes, Callable[[bytes], None]], None] = lambda *_: None
        self.ups: list[Up] = []
        """Messages to command."""

    def subscribe(self, _key: str, _callback: Callable[[str, bytes], None]) -> None: ...

    def publish(self, key: str, payload: bytes) -> None:
        if key.endswith("/up"):
            self.ups.append(decode(key, payload, Up))

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


def test_each_command_that_begins_is_told_which_links_are_down() -> None:
    """A bridge opens its links before command is there: a radio that is not plugged in would be no news."""

    async def run() -> None:
        bus = Bus()
        bridge = Bridge(no_links(), (), "m", "main", cast(ZenohSession, bus), 10.0)
        stop = asyncio.Event()
        serving = asyncio.create_task(bridge.run(stop))

        async def told() -> list[tuple[Any, NoticeCode]]:
            await asyncio.sleep(0.1)
            found = [(one.subject, one.code) for up in bus.ups for one in up.notices]
            bus.ups.clear()
            return found

        await asyncio.sleep(0.1)
        for link in ("serial:/dev/ttyUSB0:57600", "tcp:10.0.0.1:5760"):
            bridge.on_notice(link, NoticeCode.LINK_FAILED, problem="cannot be opened")
        await told()  # in vain
        first = (await bus.ask("first")).permit
        assert first is not None
        for _ in range(2):
            bridge.obey(Down(permit=first))
        failed = NoticeCode.LINK_FAILED
        assert await told() == [("serial:/dev/ttyUSB0:57600", failed), ("tcp:10.0.0.1:5760", failed)]
        bridge.on_notice("tcp:10.0.0.1:5760", NoticeCode.LINK_OPEN)
        await told()
        await asyncio.sleep(1.6)  # the lease ends
        second = (await bus.ask("second")).permit
        assert second is not None
        bridge.obey(Down(permit=second))
        assert await told() == [("serial:/dev/ttyUSB0:57600", failed)]
        stop.set()
        await serving

    asyncio.run(run())
