"""What a bridge's connection lost, or delivered late, was told as one number, mostly the wrong one."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import cast

from gcs.config import load
from gcs.io.clock import steady_ns
from gcs.io.cluster.bridge_links import BridgeLinks
from gcs.io.cluster.bridge_messages import Packet, Up, encode
from gcs.io.cluster.bridge_settings import bridge_settings
from gcs.io.cluster.command_lease import CommandLease
from gcs.io.zenoh.session import ZenohSession
from gcs.model import NS_PER_S, NoticeCode
from gcs.service.standby import IgnoredLinks

CONFIG = load("deterministic")
SETTINGS = bridge_settings(CONFIG, "deterministic", CONFIG.mavlink_links, "main")
PACKET = Packet(SETTINGS.links[0].name, "127.0.0.1:1", b"\xfd")


def told(*messages: tuple[int, int, float]) -> list[tuple[NoticeCode, dict[str, object]]]:
    """Return the notices after messages, each with its number, the bridge's start, and its age in seconds."""
    taken: dict[str, Callable[[str, bytes], None]] = {}
    bus = SimpleNamespace(subscribe=taken.__setitem__)

    async def hear() -> list[tuple[NoticeCode, dict[str, object]]]:
        lease = CommandLease("command", ("main",), 0, is_only_node=False)
        bridge = BridgeLinks(SETTINGS, lambda: cast(ZenohSession, bus), lease)
        bridge.start(asyncio.get_running_loop(), IgnoredLinks())
        (key,) = (one for one in taken if one.endswith("up"))
        for number, boot, age_s in messages:
            sent_ns = steady_ns() - round(age_s * NS_PER_S)
            taken[key](key, encode(Up(number=number, boot=boot, sent_ns=sent_ns, packets=(PACKET,))))
        await asyncio.sleep(0.0)
        await asyncio.sleep(0.0)
        notices = []
        while notice := bridge.notice():
            notices.append((notice[0], dict(notice[1])))
        return notices

    return asyncio.run(hear())


def test_messages_that_never_came_are_counted() -> None:
    assert told((0, 1, 0.0), (1, 1, 0.0), (4, 1, 0.0)) == [(NoticeCode.BRIDGE_LOSSES, {"missed": 2})]
    assert told((0, 1, 0.0), (1, 1, 0.0)) == []


def test_datagrams_that_came_late_are_counted_by_themselves() -> None:
    assert told((0, 1, 0.0), (1, 1, 5.0), (2, 1, 5.0)) == [(NoticeCode.BRIDGE_LATE, {"late": 2})]


def test_both_are_told() -> None:
    notices = told((0, 1, 0.0), (2, 1, 5.0))
    assert notices == [(NoticeCode.BRIDGE_LATE, {"late": 1}), (NoticeCode.BRIDGE_LOSSES, {"missed": 1})]


def test_a_bridge_that_started_again_has_lost_nothing() -> None:
    assert told((700, 1, 0.0), (0, 2, 0.0), (1, 2, 0.0)) == []
