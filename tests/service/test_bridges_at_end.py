"""All vehicles would lose the heartbeats when command ends by a program error, as they do not by a kill."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, cast

import pytest

from gcs.config import load
from gcs.core.lease.bridge_lease import answer_ask, start_lease
from gcs.core.lease.lease_messages import Ask
from gcs.io.clock import RunClock, steady_ns
from gcs.io.cluster.all_bridges import AllBridges
from gcs.io.cluster.bridge_links import BridgeLinks
from gcs.io.cluster.bridge_messages import Down, decode, encode
from gcs.io.cluster.bridge_settings import bridge_settings
from gcs.io.cluster.command_lease import CommandLease
from gcs.io.zenoh.session import ZenohSession
from gcs.service.service import Service

CONFIG = load("deterministic")
SETTINGS = bridge_settings(CONFIG, "deterministic", CONFIG.mavlink_links, "main")


class Bus:
    """A bridge that grants the lease, and keeps what it is told."""

    def __init__(self) -> None:
        self.lease = start_lease(1, steady_ns(), is_only_bridge=True)
        self.down: list[Down] = []

    def subscribe(self, *_: Any) -> None: ...

    def watch_nodes(self, *_: Any) -> None: ...

    def ask(self, key: str, payload: bytes, _within_s: float, answered: Callable[..., None], _: Any) -> None:
        self.lease, answer = answer_ask(self.lease, decode(key, payload, Ask), steady_ns())
        answered(key, encode(answer))

    def publish(self, key: str, payload: bytes) -> None:
        if key.endswith("down"):
            self.down.append(decode(key, payload, Down))


async def fly(bus: Bus, fails_at: int | None) -> AllBridges:
    """Run a service for a second, or until a program error at an event."""
    session = cast(ZenohSession, bus)
    lease = CommandLease("command", ("main",), 0, is_only_node=False)
    bridge = BridgeLinks(SETTINGS, lambda: session, lease)
    links = AllBridges([bridge], lease)
    service = Service(CONFIG, 1, links, session)
    effects = service.engine.effects
    events: list[Any] = []

    def counted(event: Any, *rest: Any) -> Any:
        events.append(event)
        if len(events) == fails_at:
            raise RuntimeError("program error")
        return effects(event, *rest)

    service.engine.effects = counted  # type: ignore[method-assign]
    stop = asyncio.Event()
    asyncio.get_running_loop().call_later(1.0, stop.set)
    try:
        await service.run(RunClock(), stop)
    except* RuntimeError:
        assert fails_at is not None
    return links


@pytest.mark.parametrize("fails_at", [None, 10], ids=["in order", "by an error"])
def test_only_an_end_in_order_ends_the_heartbeats_of_a_bridge(fails_at: int | None) -> None:
    bus = Bus()
    links = asyncio.run(fly(bus, fails_at))
    assert bus.down
    assert [one.ends for one in bus.down if one.ends] == ([True] if fails_at is None else [])
    assert links.go_on is (fails_at is not None)
