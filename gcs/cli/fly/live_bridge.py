"""`gcs run --role bridge`: the MAVLink endpoints of a mission, for a command elsewhere."""

from __future__ import annotations

import asyncio

from rich.console import Console

from gcs.config import Config, parse, read_text
from gcs.errors import ConfigError
from gcs.io.cluster.bridge_settings import bridge_settings
from gcs.io.recording.folder import RUNS_FOLDER
from gcs.io.systemd import watched
from gcs.mistake_codes import MistakeCode
from gcs.service.bridge import Bridge
from gcs.service.bridge_process import open_bridge
from gcs.service.signals import wait_for_interrupt


def serve_bridge(scenario: str, bridge: str | None, console: Console) -> None:
    """Serve until interrupted.

    Parameters
    ----------
    bridge : str, optional
        Its name, where the mission file has several.

    Raises
    ------
    ConfigError, LinkError
        When the mission file is wrong or a port cannot be opened.
    """
    text, source = read_text(scenario)
    config = parse(text, source)
    name = _name(config, source, bridge)
    settings = bridge_settings(config, source, config.mavlink_links, name, RUNS_FOLDER)
    with open_bridge(settings) as opened:
        names = ", ".join(link.name for link in settings.links)
        console.print(
            f"bridge {name}: MAVLink on {names}; command connects to {settings.zenoh}; Ctrl-C ends it",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
        asyncio.run(_serve(opened))


def _name(config: Config, source: str, bridge: str | None) -> str:
    """Return the name of the bridge that is to be run."""
    names = [one.name for one in config.links.bridges]
    listed = ", ".join(names)
    if not names:
        problem = "expected a table with the bridge's name and where it listens"
        raise ConfigError(source, "links.bridges", MistakeCode.MISSING_KEY, problem)
    if bridge is None and len(names) > 1:
        raise ConfigError(
            source,
            "links.bridges",
            MistakeCode.MISSING_KEY,
            f"has several bridges: choose one by --bridge ({listed})",
        )
    if bridge is not None and bridge not in names:
        raise ConfigError(
            source, "links.bridges", MistakeCode.UNKNOWN_NAME, f"has no bridge {bridge}; there is {listed}"
        )
    return bridge or names[0]


async def _serve(bridge: Bridge) -> None:
    stop = asyncio.Event()
    undo = wait_for_interrupt(stop)
    try:
        async with watched():
            await bridge.run(stop)
    finally:
        undo()
