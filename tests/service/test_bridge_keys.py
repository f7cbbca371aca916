"""Command learns from its bridge which vehicles have keys, and knows nothing of keys before."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

from gcs.config import load
from gcs.io.cluster.all_bridges import AllBridges
from gcs.io.cluster.bridge_links import BridgeLinks
from gcs.io.cluster.bridge_messages import BridgeStatus, encode
from gcs.io.cluster.bridge_settings import bridge_settings
from gcs.io.cluster.command_lease import CommandLease
from gcs.io.zenoh.session import ZenohSession

CONFIG = load("deterministic")
SETTINGS = bridge_settings(CONFIG, "deterministic", CONFIG.mavlink_links, "main")
LINK = SETTINGS.links[0].name


def test_keys_are_unknown_until_the_bridge_has_told_its_status() -> None:
    taken: dict[str, Callable[[str, bytes], None]] = {}
    bus = SimpleNamespace(subscribe=taken.__setitem__)
    lease = CommandLease("command", ("main",), 0, is_only_node=False)
    bridge = BridgeLinks(SETTINGS, lambda: cast(ZenohSession, bus), lease)
    links = AllBridges([bridge], lease)
    loop = asyncio.new_event_loop()
    bridge.start(loop, cast(Any, None))
    loop.close()
    assert links.is_keyed(LINK, 1) is None
    keyed = frozenset({(LINK, 1)})
    status = BridgeStatus(ports={}, unsent={}, stations={}, counters={}, keyed_vehicles=keyed)
    (key,) = (one for one in taken if one.endswith("status"))
    taken[key](key, encode(status))
    assert links.is_keyed(LINK, 1) is True
    assert links.is_keyed(LINK, 2) is False
