"""`gcs run --role bridge`: the MAVLink endpoints of a mission, for a command elsewhere."""

from __future__ import annotations

import asyncio

from rich.console import Console

from gcs.config import parse, read_text
from gcs.errors import ConfigError
from gcs.io.service_manager import watched
from gcs.service.bridge import Bridge
from gcs.service.bridge_process import open_bridge
from gcs.service.bridge_start import bridge_settings
from gcs.service.service import wait_for_interrupt


def serve_bridge(scenario: str, console: Console) -> None:
    """Serve until interrupted.

    Raises
    ------
    ConfigError, LinkError
        When the mission file is wrong or a port cannot be opened.
    """
    text, source = read_text(scenario)
    config = parse(text, source)
    if not config.links.bridge:
        problem = (
            "expected where the bridge listens, such as tcp/127.0.0.1:7449; the same mission file is for all"
        )
        raise ConfigError(source, "links.bridge", problem)
    settings = bridge_settings(config, source, config.mavlink_links)
    with open_bridge(settings) as bridge:
        names = ", ".join(link.name for link in settings.links)
        console.print(
            f"bridge: MAVLink on {names}; command connects to {config.links.bridge}; Ctrl-C ends it",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
        asyncio.run(_serve(bridge))


async def _serve(bridge: Bridge) -> None:
    stop = asyncio.Event()
    undo = wait_for_interrupt(stop)
    try:
        async with watched():
            await bridge.run(stop)
    finally:
        undo()
