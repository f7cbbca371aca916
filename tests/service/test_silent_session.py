"""A node would wait for ever beside a bridge if its session did not come back, and not know who commands."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any, cast

import pytest

from gcs.config import load
from gcs.core.lease.bridge_lease import answer_ask, start_lease
from gcs.core.lease.lease_messages import Ask
from gcs.io.clock import steady_ns
from gcs.io.cluster import bridge_links
from gcs.io.cluster.all_bridges import AllBridges
from gcs.io.cluster.bridge_links import BridgeLinks
from gcs.io.cluster.bridge_messages import decode, encode
from gcs.io.cluster.bridge_settings import bridge_settings
from gcs.io.cluster.command_lease import CommandLease
from gcs.io.zenoh.session import ZenohSession
from gcs.model import NS_PER_S
from gcs.service.standby import IgnoredLinks

CONFIG = load("deterministic")
SETTINGS = bridge_settings(CONFIG, "deterministic", CONFIG.mavlink_links, "main")


class Bus:
    """A session to a bridge."""

    def __init__(self, *, is_silent: bool) -> None:
        self.lease = start_lease(1, steady_ns(), is_only_bridge=True)
        self.is_silent = is_silent
        self.is_closed = False
        self.subscribed: list[str] = []

    def subscribe(self, key: str, _callback: object) -> None:
        self.subscribed.append(key.rpartition("/")[2])

    def ask(self, key: str, payload: bytes, _within_s: float, answered: Callable[..., None], _: Any) -> None:
        if not self.is_silent:
            self.lease, answer = answer_ask(self.lease, decode(key, payload, Ask), steady_ns())
            answered(key, encode(answer))

    def publish(self, _key: str, _payload: bytes) -> None: ...

    def close(self) -> None:
        self.is_closed = True


def test_a_session_that_hears_nothing_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bridge_links, "_SILENT_NS", NS_PER_S // 2)
    buses = [Bus(is_silent=True), Bus(is_silent=False)]
    coming = iter(buses)

    async def wait_for_lease() -> bool:
        lease = CommandLease("command", ("main",), 0, is_only_node=False)
        bridge = BridgeLinks(SETTINGS, lambda: cast(ZenohSession, next(coming)), lease)
        links = AllBridges([bridge], lease)
        links.start(asyncio.get_running_loop(), IgnoredLinks())
        deadline = time.monotonic() + 10.0
        while not links.may_command() and time.monotonic() < deadline:
            links.ask_for_lease()
            await asyncio.sleep(0.02)
        return links.may_command()

    assert asyncio.run(wait_for_lease())
    assert buses[0].is_closed
    assert [bus.subscribed for bus in buses] == [["up", "status"]] * 2
